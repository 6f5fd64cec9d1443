"""./dev bench learned dynamics: forces learnt where the catalogue has no entry for what is hidden, by tiller learn.

    PYTHONPATH=build/release/python_package python bench/learned/dynamics_rows.py [--seeds N] [--tune] [--quick]
        [--plants p,..] [--kinds k,..] [--options "--form network"] [--csv FILE] [--worlds FOLDER]

Nine kinds of physics in ODE plants (bench_learned_worlds). Each world's work logs are learnt from; its scoring runs,
which nothing was fitted to, judge from their true states: error of rollouts of one second after learning, over the
error of the model whose parameters were fitted to the same logs. A case is a line of build/dynamics_rows.csv; a run that was
cut goes on behind the last one."""
import argparse
import csv
import json
import os
import resource
import shlex
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import tomlkit

from tiller._command import run as run_tiller

ROOT = Path(__file__).resolve().parents[2]
GOALS = {"median": 0.35, "worst": 1.0, "covered": 0.85, "spread": 1.5}
COLUMNS = ("key", "before", "after", "covered", "spread", "cpu_s", "chosen")


def write_log(path, names, rows, time_s):
    lines = [",".join(["time_s", *names])]
    lines += [",".join([f"{t:.3f}", *("" if v is None else f"{v:.17g}" for v in row)])
              for t, row in zip(time_s, zip(*rows, strict=True), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def logs_of(case, which, columns, folder):
    names = case["states" if columns == "truth" else "measured"] + case["inputs"]
    return [write_log(folder / f"{which}_{columns}_{i}.csv", names, run[columns] + run["input"], run["time_s"])
            for i, run in enumerate(case[which])]


def judge(robot, case, folder):
    """Rollouts from the scoring runs' true states."""
    out = folder / "judged.json"
    run_tiller(["data", "learn", str(robot), *logs_of(case, "score", "measured", folder), "-o", str(out), "--starts",
                *logs_of(case, "score", "truth", folder)])
    return json.loads(out.read_text(encoding="utf-8"))


def with_params(text, names, values):
    """The robot file with these numbers in its priors' places."""
    document = tomlkit.parse(text)
    for name, value in zip(names, values, strict=True):
        document["parameters"][name] = value
    return tomlkit.dumps(document)


def measure(path, options):
    case = json.loads(path.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        robot = folder / "robot.toml"
        robot.write_text(case["robot_toml"], encoding="utf-8")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        ended = subprocess.run([sys.executable, "-m", "tiller.labs", "learn", str(robot),
                                *logs_of(case, "work", "measured", folder), "-o", str(folder / "out"), "--quiet",
                                *options], capture_output=True, text=True, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if not (folder / "out/learn.json").exists():
            raise RuntimeError(ended.stdout + ended.stderr)
        found = json.loads((folder / "out/learn.json").read_text(encoding="utf-8"))
        plain = folder / "plain.toml"
        plain.write_text(with_params(case["robot_toml"], *found["fitted"].values()), encoding="utf-8")
        first = judge(plain, case, folder)
        last = judge(found["robot_file"], case, folder) if found["chosen"] else first
    one = next((c for c in found["candidates"] if c["name"] == found["chosen"]), {})
    case["before_sigma"] = first["rms_sigma"]  # for bench/peers/dynamics_peer.py
    path.write_text(json.dumps(case) + "\n", encoding="utf-8")
    return dict(zip(COLUMNS, (path.stem, first["rms_sigma"], last["rms_sigma"], last["covered"],
                              one.get("spread_ratio") or "", after.ru_utime - before.ru_utime + after.ru_stime
                              - before.ru_stime, found["chosen"] or "refused"), strict=True))


def report(rows):
    ratios = [float(row["after"]) / float(row["before"]) for row in rows]
    for row, ratio in zip(rows, ratios, strict=True):
        print(f"  {row['key']:42s} {float(row['before']):8.3g} -> {float(row['after']):8.3g} sigma  {ratio:5.2f}  "
              f"90 % hold {float(row['covered']):.2f}  {float(row['cpu_s']):5.0f} s  {row['chosen']}")
    spreads = [float(row["spread"]) for row in rows if row["spread"]]
    found = {"median": statistics.median(ratios), "worst": max(ratios),
             "covered": statistics.mean(float(row["covered"]) for row in rows),
             "spread": statistics.median(spreads) if spreads else float("nan")}
    for name, value in found.items():
        met = value <= GOALS[name] if name in ("median", "worst") else value >= GOALS[name]
        print(f"  {name:10s} {value:8.3f}   goal {GOALS[name]}: {'met' if met else 'short'}")
    refused = sum(row["chosen"] == "refused" for row in rows)
    print(f"  refused {refused} of {len(rows)}; CPU {statistics.median(float(row['cpu_s']) for row in rows):.0f} s",
          flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("seeds", "plants", "kinds"):
        parser.add_argument(f"--{name}")
    parser.add_argument("--tune", action="store_true", help="seeds from 100001 on")
    parser.add_argument("--quick", action="store_true", help="one seed of the pendulum")
    parser.add_argument("--options", default="", help="of tiller learn")
    parser.add_argument("--csv", type=Path, default=ROOT / "build/dynamics_rows.csv")
    parser.add_argument("--worlds", type=Path, default=ROOT / "build/learned_worlds")
    parser.add_argument("--build", type=Path, default=ROOT / "build/release")
    a = parser.parse_args()
    if a.quick:
        a.seeds, a.plants = a.seeds or "1", a.plants or "pendulum"
    wanted = [word for name in ("seeds", "plants", "kinds") if getattr(a, name)
              for word in (f"--{name}", getattr(a, name))] + (["--tune"] if a.tune else [])
    listed = subprocess.run([a.build / "bench/bench_learned_worlds", "--out", a.worlds, *wanted], check=True,
                            stdout=subprocess.PIPE, text=True).stdout.split()
    rows = []
    if a.csv.exists():
        with open(a.csv, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file, COLUMNS))
    done = {row["key"] for row in rows}
    for path in map(Path, listed):
        if path.stem in done:
            continue
        rows.append(measure(path, shlex.split(a.options)))
        with open(a.csv, "a", encoding="utf-8", newline="") as file:
            csv.DictWriter(file, COLUMNS).writerow(rows[-1])
        print(f"{rows[-1]}", file=sys.stderr, flush=True)
    keys = {Path(path).stem for path in listed}
    report([row for row in rows if row["key"] in keys])
    return 0


if __name__ == "__main__":
    os.chdir(ROOT)
    sys.exit(main())
