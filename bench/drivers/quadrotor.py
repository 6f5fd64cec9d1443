# programs: tiller_command
"""./dev bench quadrotor: a quadrotor of unknown mass and drag flies a figure eight in space, simulated in ODE.

    --seeds N      plants (20): mass, drag and the sensors' noise by the seed
    --first N      seed to begin with (1); tuning uses 100 and up
    --arms LIST    posterior, frozen, gust, gust_frozen, gust_forces (all of them)

robots/quadrotor.toml, two laps at up to 2.7 m/s, 50 Hz, lockstep. `posterior` learns, `frozen` keeps the prior's mean;
`gust` hides a wind with the standard deviation of 0.3 N and a correlation of 0.5 s in each of three directions;
`gust_forces` looks for it (docs/guide/disturbances.md). Errors
are the plant's own distances from the row of the reference that is due.
"""

import argparse
import csv
import json
import math
import os
import subprocess
import sys

from _driver import CORE, HOME, ROOT, note, summary, with_forces

TILLER = ROOT / "build/release/tools/tiller"
ROBOT = ROOT / "robots/quadrotor.toml"
SECONDS = 12.5
ROWS = []
GUST = "".join(f'\n[[sim.effects]]\nkind = "wind_gusts"\nport = "{axis}"\nforce_SI = 0.3\ncorrelation_s = 0.5\n'
               for axis in "xyz")


def make_robot(folder, gust, forces):
    folder.mkdir(parents=True, exist_ok=True)
    text = ROBOT.read_text(encoding="utf-8") + (GUST if gust else "")
    if forces:
        text = with_forces(text)
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    (folder / "quadrotor_eight.csv").write_bytes((ROBOT.parent / "quadrotor_eight.csv").read_bytes())


def run(folder, arm, seed):
    log = folder / f"run_{seed}.csv"
    command = [TILLER, "run", folder / "robot.toml", "--sim", "--seed", str(seed), "--seconds", str(SECONDS), "--log", log,
               "--quiet"] + (["--frozen"] if "frozen" in arm else [])
    done = subprocess.run(command, capture_output=True, text=True, check=False,
                          preexec_fn=lambda: os.sched_setaffinity(0, {CORE}))
    if done.returncode != 0:
        note(f"{arm}, seed {seed}: {done.stderr.strip() or done.stdout.strip()}")
    rows = list(csv.DictReader(open(log, encoding="utf-8")))
    off = [1e3 * math.dist([float(r[f"true.{s}"]) for s in ("x_m", "y_m", "z_m")],
                           [float(r[f"ref.{s}"]) for s in ("x_m", "y_m", "z_m")]) for r in rows if r["ref.x_m"]]
    ticks = sorted(float(r["tick_us"]) for r in rows[10:])
    last = rows[-1]
    return {"arm": arm, "seed": seed, "state": last["state"], "ticks": len(rows),
            "rms_mm": math.sqrt(sum(v * v for v in off) / len(off)), "max_mm": max(off),
            "mass_kg": float(last["true.mass_kg"]),
            "interval": [float(last["q05.mass_kg"]), float(last["q95.mass_kg"])],
            "tick_ms": [1e-3 * ticks[len(ticks) // 2], 1e-3 * ticks[int(0.99 * len(ticks))]]}


def row(what, figure, unit, goal, good):
    ROWS.append({"section": "quadrotor", "heading": "a figure eight in space", "row": what, "figure": figure, "unit": unit,
                 "goal": goal, "met": good})
    print(f"  {what:66s} {figure:>10.4g} {unit:<4} goal {goal:8s} {'met' if good else 'short'}", flush=True)


def middle(values):
    return sorted(values)[len(values) // 2]


def tell(results, arm):
    of = [r for r in results if r["arm"] == arm]
    n = len(of)
    flown = [r for r in of if r["state"] == "ACTIVE"]
    print(f"{arm}: {n} seeds, {len(flown)} of them flown to the end")
    print(f"    off the reference: {middle([r['rms_mm'] for r in of]):.0f} mm RMS in the median, "
          f"{max(r['rms_mm'] for r in of):.0f} at most; largest distance {middle([r['max_mm'] for r in of]):.0f} mm in the "
          f"median, {max(r['max_mm'] for r in of):.0f} at most")
    if "frozen" in arm:
        return
    covered = sum(r["interval"][0] <= r["mass_kg"] <= r["interval"][1] for r in of)
    print(f"    the mass is off by {1e3 * middle([abs(sum(r['interval']) / 2 - r['mass_kg']) for r in of]):.1f} g in the median")
    row(f"{arm}: seeds flown to the end, of {n}", len(flown), "", f">= {n}", len(flown) == n)
    row(f"{arm}: 90 % intervals of the mass that hold it, of {n}", covered, "", f">= {round(0.8 * n)}", covered >= 0.8 * n)
    p99 = middle([r["tick_ms"][1] for r in of])
    row(f"{arm}: tick, 99 %, median of the seeds", p99, "ms", "<= 20", p99 <= 20.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="seed to begin with; tuning uses 100 and up")
    parser.add_argument("--arms", default="posterior,frozen,gust,gust_frozen,gust_forces")
    options = parser.parse_args()
    if not TILLER.exists():
        note(f"{TILLER.relative_to(ROOT)} is not there; run ./dev build")
        return 1
    home = HOME / "quadrotor"
    home.mkdir(parents=True, exist_ok=True)
    kept = home / "rows.jsonl"  # a cut loses nothing
    results = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    build = TILLER.stat().st_mtime
    results = [r for r in results if r.get("build") == build and options.first <= r["seed"] < options.first + options.seeds]
    kept.write_text("".join(json.dumps(r) + "\n" for r in results), encoding="utf-8")
    for arm in options.arms.split(","):
        make_robot(home / arm, "gust" in arm, "forces" in arm)
        for seed in range(options.first, options.first + options.seeds):
            if any(r["arm"] == arm and r["seed"] == seed for r in results):
                continue
            result = dict(run(home / arm, arm, seed), build=build)
            note(f"{arm}, seed {seed}: {result['rms_mm']:.0f} mm RMS, {result['max_mm']:.0f} at most, {result['mass_kg']:.3f} kg "
                 f"in {result['interval'][0]:.3f} .. {result['interval'][1]:.3f}, {result['state']}, "
                 f"tick {result['tick_ms'][0]:.2f} and {result['tick_ms'][1]:.2f} ms")
            results.append(result)
            with open(kept, "a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
        tell(results, arm)
    summary(ROWS)
    return 0


sys.exit(main())
