# programs: bench_shipped
"""./dev bench shipped: every planner on every shipped robot, at the settings of the robot files, in lockstep.

    --seeds N        runs of each pair (20)
    --first N        seed to begin with (1); tuning uses 1001 and up
    --robot NAME     this robot alone; may be given more than once
    --planner NAME   this planner alone; likewise
    --jobs N         runs at the same time (1)
    --rows FILE      where finished runs are kept (build/bench_peers/shipped.jsonl); a run that was cut goes on
    --build DIR      the CMake build folder (build/release)

A seed draws the robot's true parameters where its file says so, and all noise. What counts as arrived is told by the robot's
own cost (bench_shipped.cpp): in the last quarter of the run the weighted squares of what states and outputs are off by are,
in RMS, at most a tenth of what they would be off by if the robot had stayed where it started, and the controller is ACTIVE. A
tenth of the way is what a push of that size would look like, and a robot that holds its goal is far below it. The hopper,
whose gait swings about its goal, has to go at 70 to 130 % of its speed and not to fall.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import subprocess

from _driver import HOME, ONE_THREAD, ROOT, kept_rows, note, summary

ARRIVED, HOPPER = 0.1, 0.3
# seconds of a run: long enough to arrive and to hold, or the reference once
SECONDS = {"acrobot": 10, "cart_pole": 10, "dfki_pendulum": 10, "dfki_pendulum_bare": 10, "emps": 4, "furuta": 8, "hopper": 5,
           "pendulum": 10, "planar_quadrotor": 6, "pusher_slider": 17, "quadrotor": 12, "skid_steer": 12, "two_link_arm": 4,
           "xl330": 4}


def planners():
    """All that plan by themselves: a policy wants a network that was taught by one of them."""
    text = (ROOT / "runtime/include/tiller/planners.def").read_text(encoding="utf-8")
    return [p for p in re.findall(r"^TILLER_PLANNER\((\w+)", text, re.MULTILINE) if p != "policy"]


def has_arrived(row):
    return row["share"] is not None and row["share"] <= (HOPPER if row["robot"] == "hopper" else ARRIVED)


def key_of(row):
    return row["robot"], row["planner"], row["seed"]


def run(program, robot, planner, seeds):
    command = [str(program), robot, planner, str(SECONDS[robot]), *map(str, seeds)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=dict(os.environ, **ONE_THREAD))
    if done.returncode != 0:
        note(f"{robot}, {planner}: {done.stderr.strip() or done.returncode}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def measure(asked, robots, kinds, seeds, rows):
    wanted = []
    for seed in seeds:  # a seed of all pairs before the next: a run that was cut has something of everything
        for robot in robots:
            for planner in kinds:
                if (robot, planner, seed) not in rows:
                    wanted.append((robot, planner, seed))
    if wanted:
        note(f"{len(wanted)} runs to do, {len(rows)} known")
    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    with open(asked.rows, "a", encoding="utf-8") as file, concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
        program = asked.build / "bench/bench_shipped"
        for found in pool.map(lambda w: run(program, w[0], w[1], [w[2]]), wanted):
            for row in found:
                rows[row["robot"], row["planner"], row["seed"]] = row
                file.write(json.dumps(row) + "\n")
            file.flush()


def cell(rows, robot, planner, seeds):
    known = [rows[robot, planner, s] for s in seeds if (robot, planner, s) in rows]
    return sum(map(has_arrived, known)), len(known)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--robot", action="append", choices=sorted(SECONDS))
    parser.add_argument("--planner", action="append", choices=planners())
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=pathlib.Path, default=HOME / "shipped.jsonl")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    asked = parser.parse_args()
    robots, kinds = asked.robot or sorted(SECONDS), asked.planner or planners()
    missing = {p.stem for p in (ROOT / "robots").glob("*.toml")} - set(SECONDS)
    if missing:
        note(f"no length of a run for {', '.join(sorted(missing))}")
    seeds = range(asked.first, asked.first + asked.seeds)
    rows = kept_rows(asked.rows, key_of)
    measure(asked, robots, kinds, seeds, rows)

    print(f"arrived of {len(seeds)} seeds from {asked.first}\n")
    print("| robot | " + " | ".join(f"`{k}`" for k in kinds) + " |")
    print("|---|" + "---|" * len(kinds))
    table = []
    for robot in robots:
        texts = []
        for planner in kinds:
            arrived, known = cell(rows, robot, planner, seeds)
            texts.append(str(arrived) if known == len(seeds) else f"{arrived} of {known}")
            table.append({"section": "shipped", "heading": robot, "row": planner, "figure": arrived, "unit": f"of {known}",
                          "goal": f">= {len(seeds)}", "met": arrived == len(seeds)})
        print(f"| `{robot}` | " + " | ".join(texts) + " |")
    for robot in robots:
        for planner in kinds:
            off = [s for s in seeds if (robot, planner, s) in rows and not has_arrived(rows[robot, planner, s])]
            if off:
                told = ", ".join(f"{s}: {rows[robot, planner, s]['share']}" for s in off[:6])
                print(f"  {robot} {planner} not arrived (seed: share off): {told}{', ...' if len(off) > 6 else ''}")
    summary(table)


if __name__ == "__main__":
    main()
