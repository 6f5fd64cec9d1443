# programs: tiller_command
"""./dev bench ground: a skid-steer base on a circle and a figure eight, and a box that a finger pushes, in ODE.

    --seeds N      draws of the robot (20; of the box at most 10)
    --first N      seed to begin with (1); tuning uses 1001 and up
    --only NAME    circle, eight or box

Three controllers each: `prior` keeps the prior, `posterior` learns, `oracle` knows. For the base it knows the parameters
that a least-squares fit on noise-free poses of another run gives, for the box the friction and the fitted limit length; the
fits are written out here and share nothing with the controller. What a base's wheels do to it depends on how it is driven
(it slips more in a tighter turn), so that its intervals are judged by a fit to the true poses of the very motion that
they were learnt from. A lap's cost is that of the robot file along the true states. A run that was cut goes on: every row
is kept below build/bench_peers/ground.
"""

import argparse
import csv
import json
import math
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib

import numpy as np

from _driver import HOME, ROOT, note, summary

TILLER = ROOT / "build/release/tools/tiller"
ROBOTS = ROOT / "robots"
ARMS = ("prior", "posterior", "oracle")
LAPS = 4
TRACKS = {"circle": ("skid_steer_circle.csv", 12.0), "eight": ("skid_steer_eight.csv", 16.0)}
BASE = ("wheel_radius_m", "axle_m", "icr_offset_m")
FITTED = ("true.x_m", "true.y_m", "true.heading_rad", "left_rad_s", "right_rad_s")
ROWS = []


def run(text, seconds, seed, *more):
    """The log of a run, column by column."""
    with tempfile.TemporaryDirectory() as temporary:  # of this run alone: two benchmarks may go on side by side
        folder = pathlib.Path(temporary)
        for file in ROBOTS.glob("*.csv"):
            shutil.copy(file, folder)
        (folder / "run.toml").write_text(text, encoding="utf-8")
        done = subprocess.run([TILLER, "run", folder / "run.toml", "--sim", "--seconds", str(seconds), "--seed", str(seed),
                               "--quiet", "--log", folder / "run.csv", *more], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"ground: {done.stderr or done.stdout}")
        with open(folder / "run.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    numeric = [name for name in rows[0] if name not in ("state", "status", "stop_status")]
    log = {name: np.array([float(r[name] or "nan") for r in rows]) for name in numeric}
    log["state"] = [r["state"] for r in rows]
    return log


def replaced(text, key, value):
    """The robot file with another value; every `key = ...` in it."""
    found = re.compile(rf"^{re.escape(key)} = [^#\n]*", re.M)
    assert found.search(text), key
    return found.sub(lambda _: f"{key} = {value} ", text)


def without_noise(text):
    return re.sub(r"^(sensors\.\w+) = .*$", r"\1 = { sd = 0 }", text, flags=re.M)


def stage_costs(robot, log):
    """The quadratic cost of every tick, along the true states."""
    cost, sum_ = robot["cost"], 0.0
    for name, weight in cost["state_weight"].items():
        error = log["true." + name] - log["ref." + name]
        if name in ("heading_rad", "angle_rad"):
            error = np.remainder(error + math.pi, 2 * math.pi) - math.pi
        sum_ = sum_ + weight * error**2
    for name, weight in cost["input_weight"].items():
        sum_ = sum_ + weight * log[name] ** 2
    for name, weight in cost["input_rate_weight"].items():
        sum_ = sum_ + weight * np.diff(log[name], prepend=0.0) ** 2
    return sum_


# ---- the base --------------------------------------------------------------------------------------


def base_of(seed):
    r = random.Random(seed)
    return {"wheel_radius_m": r.uniform(0.085, 0.115), "track_m": r.uniform(0.35, 0.45), "wheelbase_m": r.uniform(0.2, 0.3),
            "com_offset_m": r.uniform(-0.012, 0.012), "friction": r.uniform(0.4, 0.9), "mass_kg": r.uniform(8.0, 14.0)}


def base_text(seed, track):
    text = (ROBOTS / "skid_steer.toml").read_text(encoding="utf-8")
    plant = ", ".join(f"{k} = {v:.9g}" for k, v in base_of(seed).items())
    text = replaced(text, "parameters", "{ " + plant + " }")
    return replaced(text, "reference", f'"{TRACKS[track][0]}"')


def effective_base(log, period_s):
    """Radius, axle and offset of the centres of rotation by least squares: each period is an arc, whose turn and whose
    chord's two components are linear in radius / axle, radius and offset * radius / axle."""
    turn = np.diff(log["true.heading_rad"])
    middle = log["true.heading_rad"][:-1] + 0.5 * turn
    dx, dy = np.diff(log["true.x_m"]), np.diff(log["true.y_m"])
    chord = np.sinc(turn / (2 * math.pi))  # of an arc, over its length
    ahead = (np.cos(middle) * dx + np.sin(middle) * dy) / chord
    aside = (np.cos(middle) * dy - np.sin(middle) * dx) / chord
    left, right = log["left_rad_s"][:-1] * period_s, log["right_rad_s"][:-1] * period_s
    fit = lambda x, y: float(x @ y / (x @ x))
    skip = 20  # the first second, in which it gets going
    ratio = fit((right - left)[skip:], turn[skip:])
    radius = fit((0.5 * (left + right))[skip:], ahead[skip:])
    offset = -fit(ratio * (right - left)[skip:], aside[skip:])
    rms = lambda e: float(np.sqrt(np.mean(e[skip:] ** 2)))
    return ({"wheel_radius_m": radius, "axle_m": radius / ratio, "icr_offset_m": offset},
            {"turn": rms(turn - ratio * (right - left)), "ahead": rms(ahead - radius * 0.5 * (left + right)),
             "aside": rms(aside + offset * ratio * (right - left))})


def run_base(track, seed):
    text, lap_s = base_text(seed, track), TRACKS[track][1]
    robot = tomllib.loads(text)
    period_s = robot["model"]["period_s"]
    truth, misfit = effective_base(run(without_noise(text), LAPS * lap_s, 1000 + seed, "--frozen"), period_s)
    result = {"task": track, "seed": seed, "truth": truth, "misfit": misfit, "laps": {}, "plant": base_of(seed)}
    for arm in ARMS:
        this = text
        for name, value in truth.items() if arm == "oracle" else ():
            this = replaced(this, name, f"{value:.9g}")
        log = run(this, LAPS * lap_s, seed, *(["--frozen"] if arm == "prior" else []))
        cost, ticks = stage_costs(robot, log), round(lap_s / period_s)
        result["laps"][arm] = [float(np.sum(cost[k * ticks:(k + 1) * ticks])) for k in range(LAPS)]
        if log["state"][-1] != "ACTIVE":
            note(f"{track}, seed {seed}, {arm}: ended in {log['state'][-1]}")
        if arm == "posterior":
            result["own"] = [effective_base({name: log[name][:k * ticks] for name in FITTED}, period_s)[0]
                             for k in range(1, LAPS + 1)]
            result["interval"] = {n: [[float(log[f"{q}.{n}"][k * ticks - 1]) for q in ("q05", "q95")] for k in range(1, LAPS + 1)]
                                  for n in BASE}
            result["sd"] = {n: float(log[f"sd.{n}"][-1]) for n in BASE}
    return result


def tell_base(track, results):
    of = [r for r in results if r["task"] == track]
    n = len(of)
    if n == 0:
        return
    heading = f"skid-steer, {track}, {LAPS} laps, {n} seeds"
    print(heading)
    for arm in ARMS:
        print(f"    {arm:<10} cost of laps 1 to {LAPS}, median: " +
              "  ".join(f"{np.median([r['laps'][arm][k] for r in of]):8.3f}" for k in range(LAPS)))
    for arm in ("prior", "posterior"):
        print(f"    {arm:<10} over the oracle's, laps 1 to {LAPS}, median (largest): " +
              "  ".join(f"{np.median(x):6.3f} ({np.max(x):.3f})"
                        for x in ([r["laps"][arm][k] / r["laps"]["oracle"][k] for r in of] for k in range(LAPS))))
    falls = sum(r["laps"]["posterior"][-1] < r["laps"]["posterior"][0] for r in of)
    row(heading, f"the last lap costs less than the first, of {n}", falls, "", ">=", math.ceil(0.95 * n))
    excess = lambda r, k: r["laps"]["posterior"][k] - r["laps"]["oracle"][k]
    nearer = sum(abs(excess(r, -1)) < abs(excess(r, 0)) for r in of)
    row(heading, f"and is nearer to the oracle's, of {n}", nearer, "", ">=", math.ceil(0.95 * n))
    last = [r["laps"]["posterior"][-1] / r["laps"]["oracle"][-1] for r in of]
    row(heading, "last lap over the oracle's, median", float(np.median(last)), "x", "<=", 1.05)
    row(heading, "last lap over the oracle's, largest", float(np.max(last)), "x", "<=", 1.25)
    row(heading, f"last lap cheaper than the prior's, of {n}",
        sum(r["laps"]["posterior"][-1] < r["laps"]["prior"][-1] for r in of), "", ">=", math.ceil(0.95 * n))
    for name in BASE:
        held = [sum(r["interval"][name][k][0] <= r["own"][k][name] <= r["interval"][name][k][1] for r in of) for k in range(LAPS)]
        row(heading, f"90 % interval holds {name} after lap {LAPS}, of {n}", held[-1], "", ">=", math.floor(0.75 * n))
        error = [0.5 * sum(r["interval"][name][-1]) - r["own"][-1][name] for r in of]
        print(f"      after laps 1 to {LAPS}: {held}; off by {np.median(np.abs(error)):.2g} in the median, "
              f"{np.max(np.abs(error)):.2g} at most; posterior's sd {np.median([r['sd'][name] for r in of]):.2g}")
    geometric = np.median([r["truth"]["axle_m"] / r["plant"]["track_m"] for r in of])
    print(f"    it turns as if its track were {geometric:.2f} times as wide, median; what the fit leaves, RMS a period, median: "
          f"{np.median([r['misfit']['turn'] for r in of]):.2g} rad, {1e3 * np.median([r['misfit']['ahead'] for r in of]):.2g} and "
          f"{1e3 * np.median([r['misfit']['aside'] for r in of]):.2g} mm")


# ---- the box ---------------------------------------------------------------------------------------


def box_speeds(state, speed, friction, limit, half, radius):
    """Quasi-static pushing by the ellipsoidal limit surface, from the paper's own steps and in the world's axes: what a
    finger that sticks would do, and where that leaves the cone, what one at the cone's edge does."""
    x, y, angle, fx, fy = state
    c, s = np.cos(angle), np.sin(angle)
    qx, qy = c * (fx - x) + s * (fy - y), c * (fy - y) - s * (fx - x)
    px, py = np.clip(qx, -half, half), np.clip(qy, -half, half)
    gap = np.hypot(qx - px, qy - py)
    nx, ny = (px - qx) / np.maximum(gap, 1e-12), (py - qy) / np.maximum(gap, 1e-12)
    ux, uy = c * speed[0] + s * speed[1], c * speed[1] - s * speed[0]
    into = ux * nx + uy * ny + 20.0 * (radius - gap)
    along = -ux * ny + uy * nx

    def box(wrench_x, wrench_y):  # twist of a unit factor, and the contact's speed into the box and along it
        turn = (px * wrench_y - py * wrench_x) / limit**2
        vx, vy = wrench_x - turn * py, wrench_y + turn * px
        return turn, vx * nx + vy * ny, -vx * ny + vy * nx

    _, nn, nt = box(nx, ny)
    _, tn, tt = box(-ny, nx)
    determinant = nn * tt - nt * tn
    f_n, f_t = (tt * into - tn * along) / determinant, (nn * along - nt * into) / determinant
    edge = np.where(f_t > 0, friction, -friction)
    slides = np.abs(f_t) > friction * f_n
    slide = into / (nn + edge * tn)
    f_n, f_t = np.where(slides, slide, f_n), np.where(slides, edge * slide, f_t)
    push = into > 0
    wx, wy = np.where(push, f_n * nx - f_t * ny, 0), np.where(push, f_n * ny + f_t * nx, 0)
    turn, _, _ = box(wx, wy)
    return c * wx - s * wy, s * wx + c * wy, turn


def effective_box(log, robot):
    """Friction and limit length by least squares over one-period predictions from the true states."""
    period_s, half = robot["model"]["period_s"], robot["parameters"]["half_length_m"]
    names = ("x_m", "y_m", "angle_rad", "pusher_x_m", "pusher_y_m")
    true = [log["true." + n] for n in names]
    speed = [log[n][:-1] for n in ("pusher_x_m_s", "pusher_y_m_s")]
    sd = [robot["measurement"][n]["sd"] for n in names[:3]]

    def cost(friction, limit):
        state, steps = [t[:-1].copy() for t in true], 20
        for _ in range(steps):
            v = box_speeds(state, speed, friction, limit, half, robot["parameters"]["pusher_radius_m"])
            for k in range(5):
                state[k] = state[k] + period_s / steps * (v[k] if k < 3 else speed[k - 3])
        return sum(float(np.sum(((state[k] - true[k][1:]) / sd[k]) ** 2)) for k in range(3))

    centre, width, best = [0.33, 0.042], [0.3, 0.02], None
    for _ in range(7):
        grid = [(max(centre[0] + a * width[0], 0.0), max(centre[1] + b * width[1], 0.01))
                for a in np.linspace(-1, 1, 9) for b in np.linspace(-1, 1, 9)]
        best = min(grid, key=lambda g: cost(*g))
        centre, width = list(best), [w / 2.5 for w in width]
    return {"friction": best[0], "limit_length_m": best[1]}


def run_box(seed):
    text = (ROBOTS / "pusher_slider.toml").read_text(encoding="utf-8")
    robot, seconds = tomllib.loads(text), 20.0
    quiet = run(without_noise(text), seconds, seed, "--frozen")
    given = {n: float(quiet["true." + n][0]) for n in ("friction", "limit_length_m")}
    fitted = effective_box(quiet, robot)
    result = {"task": "box", "seed": seed, "given": given, "fitted": fitted, "end": {}, "cost": {}}
    for arm in ARMS:
        this = text
        if arm == "oracle":
            this = replaced(replaced(this, "draw", "false"), "plant",
                            '"pusher_slider"\nparameters = { friction = %.12g, limit_length_m = %.12g }' %
                            (given["friction"], given["limit_length_m"]))
            this = replaced(replaced(this, "friction", f"{given['friction']:.9g}"), "limit_length_m",
                            f"{fitted['limit_length_m']:.9g}")
        log = run(this, seconds, seed, *(["--frozen"] if arm == "prior" else []))
        result["cost"][arm] = float(np.sum(stage_costs(robot, log)))
        result["end"][arm] = [1e3 * math.hypot(log["true.x_m"][-1] - log["ref.x_m"][-1], log["true.y_m"][-1] - log["ref.y_m"][-1]),
                              math.degrees(abs(log["true.angle_rad"][-1] - log["ref.angle_rad"][-1]))]
        if arm == "posterior":
            result["interval"] = {n: [float(log[f"{q}.{n}"][-1]) for q in ("q05", "q95")] for n in given}
            result["tick_ms"] = float(np.median(log["tick_us"]) / 1e3)
    return result


def tell_box(results):
    of = [r for r in results if r["task"] == "box"]
    n = len(of)
    if n == 0:
        return
    heading = f"pusher-slider, 0.49 m along a curve from a start that is off, {n} seeds"
    print(heading)
    for arm in ARMS:
        mm, deg, cost = [r["end"][arm][0] for r in of], [r["end"][arm][1] for r in of], [r["cost"][arm] for r in of]
        print(f"    {arm:<10} at the end {np.median(mm):.2f} mm and {np.median(deg):.2f} degrees off in the median, {np.max(mm):.2f} "
              f"and {np.max(deg):.2f} at most; cost {np.median(cost):.3f}, {np.max(cost):.3f} at most")
    near = sum(r["end"]["posterior"][0] <= 3 and r["end"]["posterior"][1] <= 2 for r in of)
    row(heading, f"ends within 3 mm and 2 degrees, of {n}", near, "", ">=", math.ceil(0.9 * n))
    row(heading, "cost over the oracle's, median", float(np.median([r["cost"]["posterior"] / r["cost"]["oracle"] for r in of])),
        "x", "<=", 1.1)
    holds = lambda r, name, value: r["interval"][name][0] <= value <= r["interval"][name][1]
    row(heading, f"90 % interval holds the finger's friction, of {n}", sum(holds(r, "friction", r["given"]["friction"]) for r in of),
        "", ">=", math.floor(0.75 * n))
    row(heading, f"90 % interval holds the fitted limit length, of {n}",
        sum(holds(r, "limit_length_m", r["fitted"]["limit_length_m"]) for r in of), "", ">=", math.floor(0.75 * n))
    defined = sum(holds(r, "limit_length_m", r["given"]["limit_length_m"]) for r in of)
    print(f"      and holds the most moment over the most force of the feet: {defined}; the fit is "
          f"{np.median([r['fitted']['limit_length_m'] / r['given']['limit_length_m'] for r in of]):.3f} of it in the median; "
          f"the fitted friction is off by {np.median([abs(r['fitted']['friction'] - r['given']['friction']) for r in of]):.2g}")
    print(f"    a tick takes {np.median([r['tick_ms'] for r in of]):.1f} ms, median")


# ---- rows ------------------------------------------------------------------------------------------


def row(heading, what, figure, unit, goal, bound):
    met = bool(figure <= bound if goal == "<=" else figure >= bound)
    ROWS.append({"section": "ground", "heading": heading, "row": what, "figure": float(figure), "unit": unit,
                 "goal": f"{goal} {bound:g}", "met": met})
    print(f"  {what:<60} {figure:10.4g} {unit:<4} goal {goal} {bound:g}  {'met' if met else 'short'}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--only", default="", choices=["", *TRACKS, "box"])
    options = parser.parse_args()
    if not TILLER.exists():
        note(f"{TILLER.relative_to(ROOT)} is not there; run ./dev build")
        return 1
    home = HOME / "ground"
    home.mkdir(parents=True, exist_ok=True)
    kept, build = home / "rows.jsonl", TILLER.stat().st_mtime
    results = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    results = [r for r in results if r["build"] == build]
    kept.write_text("".join(json.dumps(r) + "\n" for r in results), encoding="utf-8")
    for task in (*TRACKS, "box"):
        if options.only not in ("", task):
            continue
        seeds = range(options.first, options.first + (min(options.seeds, 10) if task == "box" else options.seeds))
        for seed in seeds:
            if any((r["task"], r["seed"]) == (task, seed) for r in results):
                continue
            result = dict(run_box(seed) if task == "box" else run_base(task, seed), build=build)
            note(f"{task}, seed {seed}: " + (f"ends {result['end']}" if task == "box" else
                                             f"laps {[round(v, 2) for v in result['laps']['posterior']]}"))
            results.append(result)
            with open(kept, "a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
        these = [r for r in results if r["seed"] in seeds]
        tell_box(these) if task == "box" else tell_base(task, these)
    summary(ROWS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
