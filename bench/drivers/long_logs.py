"""./dev bench long_logs: what identify and gap cost on long logs of the shipped pendulum, and whether they stay right.

    ./dev bench long_logs                   every row (some ten minutes of one processor)
    ./dev bench long_logs --quick           1e5 rows and five seeds

The logs rest nine tenths of the time. Their truth comes from this file's own midpoint integrator, at a tenth of the
period. Costs are processor seconds of user and system together, and the largest resident memory. Calibration is of logs
of 1e5 rows of which 4,000 steps are used: the share of the 90 % intervals of mass and damping that hold, over fixed
seeds, all of them counted.
"""

import argparse
import json
import math
import os
import random
import tempfile
from pathlib import Path

from _driver import ROOT

MASS, LENGTH, DAMPING, GRAVITY, PERIOD = 0.5, 0.5, 0.05, 9.81, 0.02
TILLER = ROOT / "build/release/tools/tiller"
ROBOT = ROOT / "robots/pendulum.toml"
MOST_S, MOST_MB = 60, 500  # for 1e6 rows: the time of a cup of coffee, the memory of a robot's computer
SEEDS = range(1, 21)
# 40 intervals of 90 % hold 36 times; 33 to 39 of 40 is what 95 % of correct methods reach
LEAST_HELD, MOST_HELD = 33 / 40, 39 / 40
COULOMB = 0.03


def write_log(path, rows, seed, coulomb=0.0):
    """20 s of motion in 200 s; encoder noise of 2 mrad, as the robot file says."""
    draw = random.Random(seed)
    phases = [draw.uniform(0, 2 * math.pi) for _ in range(3)]
    inertia, weight, substeps = MASS * LENGTH**2, MASS * GRAVITY * LENGTH, 10
    h, q, w = PERIOD / substeps, 0.0, 0.0

    def friction(speed):
        return DAMPING * speed + coulomb * math.tanh(speed / 0.01)

    with open(path, "w", encoding="utf-8") as out:
        out.write("time_s,angle_rad,torque_Nm\n")
        for i in range(rows):
            t, u = i * PERIOD, 0.0
            if t % 200 < 20:
                u = sum(a * math.sin(r * t + p) for a, r, p in zip((1.2, 0.9, 0.5), (2.2, 5.2, 10.0), phases))
            out.write(f"{t:.2f},{q + draw.gauss(0, 0.002):.5f},{u:.5f}\n")
            for _ in range(substeps):
                half = w + 0.5 * h * (u - friction(w) - weight * math.sin(q)) / inertia
                middle = q + 0.5 * h * w
                w += h * (u - friction(half) - weight * math.sin(middle)) / inertia
                q += h * half


def run(*argv):
    """(processor seconds, megabytes, what it printed as JSON)."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(write, 1)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        os.execv(TILLER, [str(TILLER), *map(str, argv)])
    os.close(write)
    with os.fdopen(read, encoding="utf-8") as pipe:
        text = pipe.read()
    _, status, usage = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 1, 2):
        raise SystemExit(f"tiller {' '.join(map(str, argv))} ended with {os.waitstatus_to_exitcode(status)}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, json.loads(text)


def row(what, figure, unit, low=-math.inf, high=math.inf):
    goal = f"goal <= {high:g}" if low == -math.inf else f"goal {low:g} .. {high:g}"
    print(f"  {what:<58} {figure:10.4g} {unit:<8} {goal:<18} {'met' if low <= figure <= high else 'short'}", flush=True)


def costs(folder, rows):
    print(f"\n{rows} rows of 50 Hz")
    log = folder / f"{rows}.csv"
    write_log(log, rows, 1)
    for command in ("identify", "gap"):
        seconds, megabytes, _ = run(command, ROBOT, log, "--json")
        row(f"{command}: processor time", seconds, "s", high=MOST_S)
        row(f"{command}: largest resident memory", megabytes, "MB", high=MOST_MB)


def calibration(folder, seeds):
    print(f"\nintervals from 4,000 of 1e5 steps, {len(seeds)} seeds")
    truth = {"mass_kg": MASS, "damping_Nms": DAMPING}
    held = count = 0
    squares = 0.0
    for seed in seeds:
        log = folder / "calibration.csv"
        write_log(log, 100_000, 100 + seed)
        _, _, found = run("identify", ROBOT, log, "--json", "--most-steps", 4000)
        for p in found["candidates"][-1]["parameters"]:
            if p["name"] in truth:
                low, high = p["interval_90"]
                held += low <= truth[p["name"]] <= high
                squares += ((p["mean"] - truth[p["name"]]) / p["sd"]) ** 2
                count += 1
    row("share of the 90 % intervals that hold", held / count, "", LEAST_HELD, MOST_HELD)
    row("root mean square of the errors in deviations", math.sqrt(squares / count), "", 0.75, 1.25)


def hidden(folder, seeds):
    print(f"\nCoulomb friction of {COULOMB} N m in 1e5 rows, {len(seeds)} seeds")
    named = 0
    for seed in seeds:
        log = folder / "hidden.csv"
        write_log(log, 100_000, 200 + seed, COULOMB)
        _, _, found = run("gap", ROBOT, log, "--json")
        best = found["ranking"][0]["effects"] if found["ranking"] else []
        named += found["verdict"] == "named" and [e["kind"] for e in best] == ["coulomb_friction"]
    row("named", named / len(seeds), "", 0.9, 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="1e5 rows and five seeds")
    quick = parser.parse_args().quick
    if not TILLER.exists():
        raise SystemExit("build/release/tools/tiller is not there; run ./dev build first")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for rows in (100_000,) if quick else (100_000, 1_000_000):
            costs(folder, rows)
        seeds = list(SEEDS)[:5] if quick else list(SEEDS)
        calibration(folder, seeds)
        hidden(folder, seeds[:5])


if __name__ == "__main__":
    main()
