# programs: tiller_command
"""./dev bench robots_gap: a hidden effect at one joint of an imported UR5 that MuJoCo moves; `tiller gap` has to name it.

    --seeds N      seeds of each kind and joint (1)
    --tune         seeds for tuning, from 100001; those of the score begin at 31
    --only TEXT    cases whose id contains it
    --nulls N      arms with nothing hidden (3)
    --threads N    threads of `tiller gap` (1)
    --out FOLDER   rows and what was not answered exactly (build/bench_robots_gap)

The UR5 is that of example-robot-data (PyPI, installed once below build/bench_peers). `tiller import` writes model and robot
file, which is used as it is. Six kinds at six joints: viscous and Coulomb friction, a spring, a rotor's inertia, a drive's
gain and a drive's lag (bench/peers/mujoco_arm_worlds.py says how strong). Logs: four of 10 s at 100 Hz, positions with
0.5 mrad of noise, all joints at once. A row of score.csv or tuning.csv for each case; a run that was cut goes on from there.

Exact: the reported set holds the truth, and all that it holds is of the truth's kind or an alias of it by the catalogue.
In the set: the truth is one of several kinds. Wrong: another kind or joint is named, or one is where nothing is hidden.
"""

import argparse
import collections
import csv
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time
import xml.etree.ElementTree as xml

from _driver import ONE_THREAD, PEERS, ROOT, need_environment, note, python_of, site_packages, summary
from _gap_mujoco import Table, judge, share

TILLER = ROOT / "build/release/tools/tiller"
KINDS = ["viscous_friction", "coulomb_friction", "linear_spring", "joint_inertia", "actuator_gain", "actuator_lag"]
JOINTS = 6
ARMATURE = "*=0.1"  # kg m^2, as in mujoco_arm_worlds.py
FIELDS = ["id", "kind", "joint", "seed", "r", "outcome", "verdict", "answer", "truth", "nominal_sigma", "remaining_sigma",
          "wall_s", "cpu_s"]


def cases_of(options):
    first = 100001 if options.tune else 31
    for seed in range(first, first + options.seeds):
        for n, kind in enumerate(KINDS):  # joints in another order for every kind: a run that is cut has seen all of them
            for k in range(JOINTS):
                yield {"id": f"{kind}-{(n + k) % JOINTS + 1}-{seed}", "kind": kind, "joint": (n + k) % JOINTS, "seed": seed}
    for n in range(options.nulls):
        yield {"id": f"none-{first + n}", "kind": None, "joint": 0, "seed": first + n}


def import_arm(folder):
    """(the description, largest torque of each joint); model and robot file lie in `folder`."""
    urdf = next(site_packages("robots").rglob("ur_description/urdf/ur5_robot.urdf"))
    subprocess.run([TILLER, "import", urdf, "-o", folder, "--force", "--armature", ARMATURE, "--any-inertia"], check=True,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    joints = [j for j in xml.parse(urdf).getroot().iter("joint") if j.get("type") == "revolute"]
    return urdf, [float(j.find("limit").get("effort")) for j in joints]


def run_case(case, maker, arm, options):
    folder, row = options.out / case["id"], {k: case[k] for k in ("id", "kind", "joint", "seed")}
    row.update(kind=case["kind"] or "none", joint=case["joint"] + 1 if case["kind"] else "")
    maker.stdin.write(json.dumps(dict(case, folder=str(folder), urdf=str(arm[0]), efforts=arm[1])) + "\n")
    maker.stdin.flush()
    made = json.loads(maker.stdout.readline())
    if made["error"]:
        return dict(row, outcome="not_made", verdict=made["error"])
    sealed = json.loads((folder / "sealed/case.json").read_text(encoding="utf-8"))
    truth = [f"{e['kind']}@{e['port']}" for e in sealed["effects"]]
    row.update(r=f"{made['r']:.4g}", truth="+".join(truth) or "none")
    began = time.monotonic()
    done = subprocess.run([TILLER, "gap", options.out / "model/robot.toml", *sorted(folder.glob("log_*.csv")), "--json",
                           "--threads", str(options.threads)], capture_output=True, text=True, check=False,
                          env=dict(os.environ, **ONE_THREAD))
    row["wall_s"] = f"{time.monotonic() - began:.3g}"
    (folder / "gap.json").write_text(done.stdout, encoding="utf-8")
    (folder / "said.txt").write_text(done.stderr, encoding="utf-8")
    try:
        result = json.loads(done.stdout)
    except json.JSONDecodeError:
        return dict(row, outcome="failed", verdict=" ".join(done.stderr.split())[-200:])
    outcome, sets = judge(truth, result)
    if outcome == "exact" or (not truth and outcome == "none"):
        shutil.rmtree(folder)
    figure = lambda part, key: "" if part.get(key) is None else f"{part[key]:.4g}"
    return dict(row, outcome=outcome, verdict=result["verdict"], answer=" or ".join("+".join(s) for s in sets),
                nominal_sigma=figure(result["gate"], "nominal_sigma"), remaining_sigma=figure(result, "remaining_sigma"),
                cpu_s=figure(result["cost"], "cpu_s"))


def run_cases(cases, path, options):
    """Rows of all cases, those of an earlier run included."""
    rows = []
    if path.exists():
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    done, wanted = {row["id"] for row in rows}, {case["id"] for case in cases}
    rows, left = [row for row in rows if row["id"] in wanted], [case for case in cases if case["id"] not in done]
    if not left:
        return rows
    arm = import_arm(options.out / "model")
    maker = subprocess.Popen([python_of("robots"), PEERS / "mujoco_arm_worlds.py"], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, text=True, env=dict(os.environ, **ONE_THREAD))
    with open(path, "a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if file.tell() == 0:
            writer.writeheader()
        for n, case in enumerate(left):
            rows.append(run_case(case, maker, arm, options))
            writer.writerow(rows[-1])
            file.flush()
            note(f"{n + 1} of {len(left)}: {case['id']}: {rows[-1]['outcome']} ({rows[-1].get('answer') or rows[-1]['verdict']}), "
                 f"{rows[-1].get('wall_s', '')} s")
    maker.stdin.close()
    maker.wait()
    return rows


def tell(rows):
    table = Table("robots_gap")
    answered = [row for row in rows if row["outcome"] != "not_made"]
    hidden = [row for row in answered if row["kind"] != "none"]
    table.heading("one hidden effect of six kinds at one of six joints of a UR5 in MuJoCo")
    if hidden:
        table.row(f"exact, n = {len(hidden)}", share(hidden, ["exact"]), "%", ">= 85")
        table.row("truth in the reported set", share(hidden, ["exact", "in_set"]), "%")
        table.row("wrong kind or joint", share(hidden, ["wrong"]), "%", "<= 3")
        table.row("logs refused, or no answer", share(hidden, ["unfit", "failed"]), "%")
        for what in ("kind", "joint"):
            for name in sorted({str(row[what]) for row in hidden}):
                part = [row for row in hidden if str(row[what]) == name]
                told = collections.Counter(row["outcome"] for row in part)
                print(f"  {what} {name}: " + ", ".join(f"{n} {outcome}" for outcome, n in told.most_common()), flush=True)
    if seconds := sorted(float(row["cpu_s"]) for row in answered if row.get("cpu_s")):
        table.row("median processor time of a case", seconds[len(seconds) // 2], "s")
        table.row("slowest", seconds[-1], "s")
    if nulls := [row for row in answered if row["kind"] == "none"]:
        table.heading("nothing hidden")
        table.row(f"false alarms, n = {len(nulls)}", 100.0 - share(nulls, ["none"]), "%")
    if len(answered) < len(rows):
        print(f"  {len(rows) - len(answered)} cases were not made; the rows say why")
    return table.rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, metavar="N")
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--nulls", type=int, default=3, metavar="N")
    parser.add_argument("--threads", type=int, default=1, metavar="N")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "build/bench_robots_gap", metavar="FOLDER")
    options = parser.parse_args()
    if not need_environment("robots"):
        sys.exit("robots_gap: without MuJoCo there is nothing to look at")
    options.out = options.out.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    cases = [case for case in cases_of(options) if options.only in case["id"]]
    rows = run_cases(cases, options.out / ("tuning.csv" if options.tune else "score.csv"), options)
    summary(tell(rows))
    return 1 if any(row["outcome"] in ("failed", "not_made") for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
