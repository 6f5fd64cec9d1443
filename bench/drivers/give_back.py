# programs: tiller_command
"""./dev bench give_back: a Panda in MuJoCo that is tuned otherwise than its MJCF says; `tiller gap` has to patch the MJCF.

    --seeds N      tuned arms, seeds from 31 (1)
    --threads N    threads of `tiller gap` (2)
    --only KINDS   effects that `tiller gap` considers (all)
    --out FOLDER   rows and files (build/bench_give_back)

The MJCF is that of robosuite (PyPI, installed once below build/bench_peers). Dry friction at one joint, more damping at a
second and a weaker drive at a third are hidden (bench/peers/mujoco_give_back.py). `tiller import` reads the MJCF, `tiller
gap --write-mjcf` four logs of 10 s at 100 Hz with 0.5 mrad of noise. MuJoCo then rolls out 1 s at a time of a fifth log,
from the true states under its commands, by the MJCF as it was and as it was patched. A row of rows.csv for each arm; a run
that was cut goes on from there.
"""

import argparse
import csv
import json
import os
import pathlib
import subprocess
import sys
import time

from _driver import ONE_THREAD, PEERS, ROOT, need_environment, note, python_of, site_packages, summary
from _gap_mujoco import Table

TILLER = ROOT / "build/release/tools/tiller"
FIELDS = ["seed", "truth", "answer", "verdict", "before_mrad", "after_mrad", "cpu_s", "wall_s"]


def run_arm(seed, mjcf, options):
    python, folder = python_of("robots"), options.out / str(seed)
    environment = dict(os.environ, TILLER_PYTHON=str(python), **ONE_THREAD)
    maker = PEERS / "mujoco_give_back.py"
    subprocess.run([python, maker, "record", mjcf, str(seed), folder], check=True)
    began = time.monotonic()
    patched = mjcf.with_name(f"found_{seed}.xml")  # beside the meshes
    patched.unlink(missing_ok=True)
    only = ["--only", options.only] if options.only else []
    done = subprocess.run([TILLER, "gap", options.out / "model/robot.toml", *sorted(folder.glob("log_*.csv")), "--threads",
                           str(options.threads), *only, "-o", folder / "gap", "--description", mjcf, "--write-mjcf", patched,
                           "--json"], capture_output=True, text=True, check=False, env=environment)
    (folder / "said.txt").write_text(done.stderr, encoding="utf-8")
    found = json.loads(done.stdout)
    judged = subprocess.run([python, maker, "judge", folder, mjcf, *([patched] if patched.exists() else [])], check=True,
                            capture_output=True, text=True)
    errors = [1e3 * json.loads(line)["rms_rad"] for line in judged.stdout.splitlines()]
    truth = json.loads((folder / "sealed/truth.json").read_text(encoding="utf-8"))
    return {"seed": seed, "truth": " ".join(f"{kind}@{joint}={value:.4g}" for kind, (joint, value) in truth.items()),
            "answer": found["sentence"].replace(",", ";"), "verdict": found["verdict"], "before_mrad": f"{errors[0]:.4g}",
            "after_mrad": f"{errors[-1]:.4g}", "cpu_s": found["cost"]["cpu_s"], "wall_s": f"{time.monotonic() - began:.3g}"}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, metavar="N")
    parser.add_argument("--threads", type=int, default=2, metavar="N")
    parser.add_argument("--only", default="", metavar="KINDS")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "build/bench_give_back", metavar="FOLDER")
    options = parser.parse_args()
    if not need_environment("robots") or not need_environment("robot_models", "--no-deps"):
        sys.exit("give_back: without MuJoCo and the MJCF there is nothing to look at")
    options.out = options.out.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    mjcf = site_packages("robot_models") / "robosuite/models/assets/robots/panda/robot.xml"
    if not (options.out / "model/robot.toml").exists():
        subprocess.run([TILLER, "import", mjcf, "-o", options.out / "model", "--force"], check=True, stdout=subprocess.DEVNULL,
                       env=dict(os.environ, TILLER_PYTHON=str(python_of("robots"))))
    path, rows = options.out / "rows.csv", []
    if path.exists():
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    with open(path, "a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if file.tell() == 0:
            writer.writeheader()
        for seed in range(31, 31 + options.seeds):
            if str(seed) in {str(row["seed"]) for row in rows}:
                continue
            rows.append(run_arm(seed, mjcf, options))
            writer.writerow(rows[-1])
            file.flush()
            note(f"{seed}: {rows[-1]['before_mrad']} -> {rows[-1]['after_mrad']} mrad, {rows[-1]['answer']}")
    table = Table("give_back")
    table.heading("a Panda in MuJoCo, rollouts of 1 s by its MJCF")
    for row in rows:
        before, after = float(row["before_mrad"]), float(row["after_mrad"])
        table.row(f"seed {row['seed']}: as it was", before, "mrad")
        table.row(f"seed {row['seed']}: patched, of that", 100 * after / before, "%", "<= 20")
    summary(table.rows)


if __name__ == "__main__":
    main()
