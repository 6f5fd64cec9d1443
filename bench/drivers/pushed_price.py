# programs: tiller_command tiller_python
"""./dev bench pushed_price: what `disturbance = true` costs on the shipped robots, time of a tick and memory.

    --seeds N        pairs of runs of each robot (5)
    --seconds S      of a run (3)
    --robot NAME     this robot alone; may be given more than once
    --rows FILE      where finished pairs are kept (build/bench_peers/pushed_price.jsonl); a run that was cut goes on
    --build DIR      the CMake build folder (build/release)

A pair is a run with the key and one without, each with its own plant in still air, whose ticks take turns in one
process: a disturbance of the machine meets both. A tick is tiller_tick and the preparation behind it, in processor
time of its one thread, and no planner's deadline ends it. The ratio of a pair is that of the two medians over the
run's second half; the table has its median over the seeds whose runs both end ACTIVE: in SAFE a tick does next to
nothing. Memory is the controller's one block, to the byte. Robots without a joint that is felt, and those whose
posterior is not the filter, are left out.
"""

import argparse
import json
import pathlib
import re
import shutil
import sys
import tempfile
import time
import tomllib

import numpy as np

from _driver import HOME, ROOT, kept_rows, note, summary

TICK_GOAL, MEMORY_GOAL = 1.25, 1.2


def variant(text, seed, disturbance):
    """The robot file with this seed, and with the key."""
    text = re.sub(r"^seed *=.*", f"seed = {seed}", text, count=1, flags=re.MULTILINE)
    if not disturbance:
        return text
    if re.search(r"^\[posterior\]", text, re.MULTILINE):
        return re.sub(r"^\[posterior\].*\n", "[posterior]\ndisturbance = true\n", text, count=1, flags=re.MULTILINE)
    return text + "\n[posterior]\ndisturbance = true\n"


class Run:
    def __init__(self, tiller, path):
        robot = tiller.Robot.from_toml(str(path))
        self.controller, self.plant = tiller.Controller(robot), tiller.Plant(robot)
        self.controller.arm()
        self.bytes, self.us = self.controller.block_bytes, []

    def step(self):
        measured = self.plant.measurement
        begin = time.thread_time()
        command = self.controller.tick(measured.t, measured)
        self.controller.prepare()
        self.us.append(1e6 * (time.thread_time() - begin))
        self.plant.step(command)

    def median_us(self):
        return float(np.median(self.us[len(self.us) // 2:]))


def measure(tiller, folder, name, seed, seconds):
    """A row; None: this robot has no force to estimate."""
    text = (ROOT / f"robots/{name}.toml").read_text(encoding="utf-8")
    content = tomllib.loads(text)
    if content.get("posterior", {}).get("kind", "filter") != "filter":
        return None
    runs = []
    for disturbance in (False, True):
        path = folder / f"{name}_{disturbance}.toml"
        path.write_text(variant(text, seed, disturbance), encoding="utf-8")
        runs.append(Run(tiller, path))
    joints = len(runs[1].controller.info.force_mean)
    if joints == 0:
        return None
    for tick in range(round(seconds / content["model"]["period_s"])):
        for run in runs if tick % 2 == 0 else reversed(runs):
            run.step()
    off, on = runs
    return {"robot": name, "seed": seed, "seconds": seconds, "joints": joints, "off_us": off.median_us(),
            "on_us": on.median_us(), "off_bytes": off.bytes, "on_bytes": on.bytes,
            "active": all(run.controller.info.state == tiller.State.ACTIVE for run in runs)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    robots = sorted(p.stem for p in (ROOT / "robots").glob("*.toml"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--robot", action="append", choices=robots)
    parser.add_argument("--rows", type=pathlib.Path, default=HOME / "pushed_price.jsonl")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    asked = parser.parse_args()
    package = asked.build / "python_package"
    if not list((package / "tiller").glob("_core*.so")):
        sys.exit("pushed_price: this build has no Python package (./dev build release tiller_python)")
    sys.path.insert(0, str(package))
    import tiller  # of the build that is asked for

    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    rows, table = kept_rows(asked.rows, lambda r: (r["robot"], r["seed"], r["seconds"])), []
    print("| robot | joints | tick, off | on | ratio | memory, off | on | ratio |\n|---|---|---|---|---|---|---|---|")
    for name in asked.robot or robots:
        found = []
        with tempfile.TemporaryDirectory() as place, open(asked.rows, "a", encoding="utf-8") as file:
            folder = pathlib.Path(place) / "robots"
            shutil.copytree(ROOT / "robots", folder)  # the files that robot files name lie beside them
            for seed in range(1, asked.seeds + 1):
                key = (name, seed, asked.seconds)
                if key not in rows:
                    try:
                        row = measure(tiller, folder, name, seed, asked.seconds)
                    except tiller.Error as error:
                        sys.exit(f"pushed_price: {name}: {error}")
                    if row is None:
                        break
                    rows[key] = row
                    file.write(json.dumps(row) + "\n")
                    file.flush()
                found.append(rows[key])
        if not found:
            print(f"| `{name}` | 0 | | | | | | |")
            continue
        active = [r for r in found if r["active"]]
        middle = lambda of: float(np.median([of(r) for r in active]))
        memory = found[0]["on_bytes"] / found[0]["off_bytes"]
        figures = [("memory", memory, MEMORY_GOAL)]
        ticks = f"{len(found) - len(active)} of {len(found)} pairs do not end ACTIVE | | "
        if active:
            tick = middle(lambda r: r["on_us"] / r["off_us"])
            figures.insert(0, ("tick", tick, TICK_GOAL))
            ticks = f"{middle(lambda r: r['off_us']):.0f} us | {middle(lambda r: r['on_us']):.0f} us | {tick:.2f}"
        print(f"| `{name}` | {found[0]['joints']} | {ticks} | {found[0]['off_bytes'] / 1e3:.0f} kB | "
              f"{found[0]['on_bytes'] / 1e3:.0f} kB | {memory:.2f} |", flush=True)
        for what, figure, goal in figures:
            table.append({"section": "pushed_price", "heading": name,
                          "row": f"{what} with over without, {len(active)} seeds", "figure": figure, "unit": "x",
                          "goal": f"<= {goal:g}", "met": figure <= goal})
    summary(table)


if __name__ == "__main__":
    main()
