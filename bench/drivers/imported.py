# programs: tiller_command
"""./dev bench imported: thirteen robots that no other benchmark has, from their descriptions to parameters from logs.

    --only NAME    robots whose name contains it
    --seeds N      simulated robots of each, drawn from the priors (1)
    --first N      seed to begin with (1)
    --seconds S    of each run (8)

Nine descriptions are bench/imported's own; four are URDFs of example-robot-data (PyPI, installed once below
build/bench_peers). Each robot is imported with one or two unknowns, checked, run on the simulated plant that the import
chose, and identified from the logs of two such runs (the second to other targets). All of it with what `tiller import`
writes: nothing of the robot file is changed but the targets of the second run. A row for each robot and seed:

    ACTIVE    both runs end ACTIVE, and `check` finds nothing wrong
    alarm     the adequacy test raises no alarm against the untouched plant
    covered   the 90 % intervals of `identify` that hold the plant's parameter, of all

Rows are kept below build/bench_peers/imported; a run that was cut goes on from there.
"""

import argparse
import csv
import json
import math
import os
import re
import subprocess
import sys

from _driver import BENCH, HOME, ONE_THREAD, ROOT, need_environment, note, python_of, site_packages, summary

TILLER = ROOT / "build/release/tools/tiller"
OWN = BENCH / "imported"
# name, description (of this folder, or of example-robot-data), what the import is told
ROBOTS = [
    ("hopping leg", OWN / "hopping_leg.xml", ["--frame", "foot", "--unknown", "mass:shank"]),
    ("servo arm", OWN / "servo_arm.xml", ["--frame", "tool", "--unknown", "payload=0.8"]),
    ("satellite", OWN / "satellite.xml", ["--base", "free", "--unknown", "mass:boom"]),
    ("gantry", OWN / "gantry.xml", ["--unknown", "mass:carriage,gain:x"]),
    ("pan tilt", OWN / "pan_tilt.urdf", ["--unknown", "friction:tilt"]),
    ("gripper arm", OWN / "gripper_arm.urdf", ["--frame", "palm", "--unknown", "payload=1"]),
    ("trolley crane", OWN / "trolley_crane.urdf", ["--unknown", "mass:load"]),
    ("scara", OWN / "scara.urdf", ["--frame", "tool", "--unknown", "payload=2"]),
    ("air bearing", OWN / "air_bearing.urdf", ["--base", "planar", "--unknown", "mass:outer"]),
    ("two dof", "asr_twodof_description/urdf/TwoDofs.urdf", ["--unknown", "payload=1", "--armature", "*=0.05"]),
    ("so100", "so_arm_description/urdf/so100.urdf", ["--unknown", "payload=0.3", "--armature", "*=0.01"]),
    ("solo8 legs", "solo_description/robots/solo.urdf", ["--unknown", "gain:FL_HFE", "--armature", "*=0.005"]),
    ("ur3 with ends", "ur_description/urdf/ur3_joint_limited_robot.urdf", ["--unknown", "payload=2", "--armature", "*=0.1"]),
]
ROWS = []


def row(heading, name, figure, unit, goal, bound):
    met = figure >= bound if goal == ">=" else figure <= bound
    ROWS.append({"section": "imported", "heading": heading, "row": name, "figure": figure, "unit": unit,
                 "goal": f"{goal} {bound:g}", "met": met})


def described(file):
    if not isinstance(file, str):
        return file
    return next(iter(site_packages("robots").rglob(file)), None)


def tiller(*arguments):
    return subprocess.run([str(a) for a in (TILLER, *arguments)], capture_output=True, text=True, check=False,
                          env=dict(os.environ, TILLER_PYTHON=str(python_of("robots")), **ONE_THREAD))


def other_way(text):
    """The task of the second run: every target on the other side of the start, so that the logs tell more."""
    start = dict(re.findall(r"(\w+) = ([-\d.e]+)", re.search(r"^\[start\]\nstate = \{(.*)\}", text, re.M)[1]))
    back = lambda found: f"{found[1]} = {2 * float(start.get(found[1], 0)) - float(found[2]):g}"
    return re.sub(r"^target = \{.*\}", lambda line: re.sub(r"(\w+) = ([-\d.e]+)", back, line[0]), text, count=1, flags=re.M)


def last_row(log):
    with open(log, encoding="utf-8") as file:
        return list(csv.DictReader(file))[-1]


def run(name, file, how, seed, seconds, folder):
    """Import, check, two runs, identify."""
    result = {"robot": name, "seed": seed, "said": "", "active": False, "alarm": False, "covered": {}}
    done = tiller("import", file, "-o", folder, "--force", *how)
    if done.returncode != 0:
        return dict(result, said=done.stderr.strip())
    robot, other = folder / "robot.toml", folder / "other.toml"
    other.write_text(other_way(robot.read_text(encoding="utf-8")), encoding="utf-8")
    done = tiller("check", robot)
    if done.returncode != 0:
        return dict(result, said=done.stderr.strip() or done.stdout.strip())
    logs, truth, ends, active = [], {}, [], True
    for which in (robot, other):
        logs.append(which.with_suffix(f".{seed}.csv"))
        done = tiller("run", which, "--sim", "--seconds", seconds, "--seed", seed, "--quiet", "--log", logs[-1], "--alarm-seconds",
                      "0")
        if done.returncode not in (0, 3):  # 3: ended in SAFE, which is a result
            return dict(result, said=done.stderr.strip() or done.stdout.strip())
        last = last_row(logs[-1])
        ends.append(last["state"])
        result["alarm"] = result["alarm"] or "the model does not explain" in done.stderr + done.stdout
        truth = {k[4:]: float(last["true." + k[4:]]) for k in last if k.startswith("q05.")}
    result["active"] = ends == ["ACTIVE", "ACTIVE"]
    done = tiller("identify", robot, *logs, "--json")
    if done.returncode != 0:
        return dict(result, said=done.stderr.strip())
    for p in json.loads(done.stdout)["candidates"][-1]["parameters"]:
        if p["name"] in truth and not p["fixed"]:
            low, high = p["interval_90"]
            result["covered"][p["name"]] = [low, truth[p["name"]], high]
    return result


def told(result):
    hits = [low <= true <= high for low, true, high in result["covered"].values()]
    intervals = "; ".join(f"{k} {low:.4g} .. {high:.4g}, is {true:.4g}" for k, (low, true, high) in result["covered"].items())
    return (f"{result['robot']}, seed {result['seed']}: {'ACTIVE' if result['active'] else 'NOT ACTIVE'}, "
            f"{'ALARM' if result['alarm'] else 'no alarm'}, {sum(hits)} of {len(hits)} covered: {intervals}{result['said']}")


def tell(results):
    good = lambda r: r["active"] and not r["alarm"] and bool(r["covered"]) and not r["said"]
    names = {r["robot"] for r in results}
    hits = [low <= true <= high for r in results for low, true, high in r["covered"].values()]
    row("import, check, run, identify", "robots ACTIVE to the end without an alarm, in all their runs",
        sum(all(good(r) for r in results if r["robot"] == n) for n in names), "", ">=", len(names))
    # of 90 % intervals, one time in a hundred fewer than this hold
    short = 0.9 * len(hits) - 2.33 * math.sqrt(0.09 * len(hits))
    row("import, check, run, identify", f"90 % intervals that hold the plant's parameter, of {len(hits)}", sum(hits), "", ">=",
        math.ceil(short))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="NAME")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=8)
    options = parser.parse_args()
    if not TILLER.exists():
        note(f"{TILLER.relative_to(ROOT)} is not there; run ./dev build")
        return 1
    if not need_environment("robots"):
        return 1
    home = HOME / "imported"
    home.mkdir(parents=True, exist_ok=True)
    kept, build = home / "rows.jsonl", [TILLER.stat().st_mtime, options.seconds]
    results = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    results = [r for r in results if r["build"] == build]
    kept.write_text("".join(json.dumps(r) + "\n" for r in results), encoding="utf-8")
    seeds = range(options.first, options.first + options.seeds)
    for name, file, how in ROBOTS:
        if options.only not in name:
            continue
        for seed in seeds:
            result = next((r for r in results if (r["robot"], r["seed"]) == (name, seed)), None)
            if result is None:
                result = dict(run(name, described(file), how, seed, options.seconds, home / name.replace(" ", "_")), build=build)
                results.append(result)
                with open(kept, "a", encoding="utf-8") as rows:
                    rows.write(json.dumps(result) + "\n")
            print(told(result), flush=True)
    tell([r for r in results if r["seed"] in seeds and options.only in r["robot"]])
    summary(ROWS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
