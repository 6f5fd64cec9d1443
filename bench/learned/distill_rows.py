"""./dev bench learned distill: small policies beside the planners that taught them, by python -m tiller.labs distill.

    PYTHONPATH=build/release/python_package python bench/learned/distill_rows.py [--robot NAME] [--seeds N] [--quick]

Each robot's policy (32 x 32 tanh, state and posterior moments in) is distilled on the robot's model by draws of seed
1000 and kept in build/. Each draw of the hidden parameters then runs on the plant of [sim], posterior and all, under
the teacher, under the policy without a fallback, and under the robot file's own planner. Cost: mean stage cost a tick
at the true state. A draw is a line of build/distill_rows.csv; a run that was cut goes on behind the last one."""
import argparse
import csv
import json
import os
import statistics
import sys
from pathlib import Path

from tiller import _core
from tiller.labs.distill.course import Course, Distilled
from tiller.labs.distill.options import Options
from tiller.labs.distill.teacher import held_out, with_policy, with_teacher

ROOT = Path(__file__).resolve().parents[2]
GOAL, TRAINING_SEED = 1.10, 1000
#         robot               teacher  s  rounds  episodes
TASKS = {"planar_quadrotor": ("ilqr", 4, 4, 30), "two_link_arm": ("ilqr", 3, 4, 40), "cart_pole": ("mppi", 5, 4, 40)}


def train(name, key, quick, threads):
    robot = _core.Robot.from_toml(str(ROOT / "robots" / f"{name}.toml"))
    teacher, seconds, iterations, episodes = TASKS[name]
    path = ROOT / "build" / f"distill_{key}.json"
    if not path.exists():
        o = Options(teacher=teacher, seconds=seconds, iterations=2 if quick else iterations,
                    episodes=6 if quick else episodes, validation=2 if quick else 12, test=0, seed=TRAINING_SEED,
                    threads=threads)
        result = Distilled()
        Course(robot, o, lambda line: print(f"{name}: {line}", file=sys.stderr, flush=True)).run(result)
        path.write_text(json.dumps(result.policy), encoding="utf-8")
    taught = with_teacher(robot, teacher)
    return robot, taught, with_policy(taught, json.loads(path.read_text(encoding="utf-8"))), seconds


def draws(name, key, seeds, quick, threads, rows_file):
    rows = []
    if rows_file.exists():
        with open(rows_file, encoding="utf-8") as file:
            rows = [[float(cell) for cell in row[1:]] for row in csv.reader(file) if row[0] == key and len(row) == 8]
    robot, teacher, policy, seconds = train(name, key, quick, threads)
    for seed in range(1, seeds + 1):
        if seed in {int(row[0]) for row in rows}:
            continue
        outcomes = [held_out(who, teacher, seconds, seed) for who in (teacher, policy, robot)]
        rows.append([seed, *(-o.score for o in outcomes), *(float(o.safe) for o in outcomes)])
        with open(rows_file, "a", encoding="utf-8") as file:
            file.write(",".join([key, *(f"{cell:.9g}" for cell in rows[-1])]) + "\n")
    return [row for row in rows if row[0] <= seeds]


def report(name, rows):
    teacher, policy, own = (sum(row[i] for row in rows) for i in (1, 2, 3))
    ratios = [row[2] / row[1] for row in rows]
    met = "met" if policy / teacher <= GOAL else "short"
    print(f"== {name}, taught by {TASKS[name][0]}, {len(rows)} draws")
    print(f"  cost of all draws over the teacher's      {policy / teacher:8.3f}   goal at most {GOAL}: {met}")
    print(f"  the same over the robot file's own planner {policy / own:7.3f}")
    print(f"  median of the draws' ratios               {statistics.median(ratios):8.3f}")
    print(f"  worst draw's ratio                        {max(ratios):8.3f}")
    print("  draws that end in SAFE: policy, teacher, own planner  ",
          [int(sum(r[i] for r in rows)) for i in (5, 4, 6)], flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=TASKS)
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--csv", type=Path, default=ROOT / "build/distill_rows.csv")
    parser.add_argument("--quick", action="store_true", help="three draws of policies that were taught little")
    a = parser.parse_args()
    a.csv.parent.mkdir(parents=True, exist_ok=True)
    for name in [a.robot] if a.robot else TASKS:
        seeds = a.seeds or (3 if a.quick else 50)
        report(name, draws(name, name + "_quick" * a.quick, seeds, a.quick, a.threads, a.csv))
    return 0


if __name__ == "__main__":
    sys.exit(main())
