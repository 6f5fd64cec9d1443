# programs: tiller_command
"""./dev bench models: a Furuta pendulum swings up, a hopper hops, in ODE, with parameters drawn from their priors.

    --seeds N      draws of the robot (10)
    --first N      seed to begin with (1); tuning uses 1001 and up
    --only NAME    furuta or hopper

Each robot file is run as it is shipped, in lockstep. A Furuta pendulum has done its task where it stands within 0.2 rad
through the last two of eight seconds. A hopper has fallen where its body comes below 0.3 m or leans by more than 1 rad in
five seconds; its speed is the mean of the last three. Every seed is printed.
"""

import argparse
import csv
import math
import statistics
import subprocess
import sys

from _driver import HOME, ROOT, note, summary

TILLER = ROOT / "build/release/tools/tiller"
ROWS = []


def row(heading, name, figure, unit, goal, met):
    ROWS.append({"section": "models", "heading": heading, "row": name, "figure": figure, "unit": unit, "goal": goal, "met": met})


def run(name, seconds, seed):
    """The rows of a run's log, as numbers."""
    home = HOME / "models"
    home.mkdir(parents=True, exist_ok=True)
    done = subprocess.run([TILLER, "run", ROOT / "robots" / f"{name}.toml", "--sim", "--seconds", str(seconds), "--seed",
                           str(seed), "--quiet", "--log", home / f"{name}.csv", "--alarm-seconds", "0"],
                          capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):  # 3: ended in SAFE, which is a result
        sys.exit(f"models: {name}, seed {seed}: {done.stderr or done.stdout}")
    with open(home / f"{name}.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    number = lambda text: float(text) if text not in ("", None) else math.nan
    return [{k: v if k in ("state", "status", "stop_status") else number(v) for k, v in row.items()} for row in rows]


def covered(rows):
    """Which parameters lie within their 90 % intervals at the end."""
    last = rows[-1]
    names = [k[4:] for k in last if k.startswith("q05.")]
    return {n: last["q05." + n] <= last["true." + n] <= last["q95." + n] for n in names}


def ticks(rows):
    sorted_us = sorted(r["tick_us"] for r in rows[1:])
    return statistics.median(sorted_us), sorted_us[int(0.99 * len(sorted_us))]


def furuta(rows):
    lean = [abs(math.remainder(r["true.pendulum_rad"] - math.pi, 2 * math.pi)) for r in rows]
    time_s = [r["time_s"] - rows[0]["time_s"] for r in rows]
    late = [t for t, l in zip(time_s, lean) if l > 0.2]
    up_s = late[-1] if late else 0.0
    done = rows[-1]["state"] == "ACTIVE" and time_s[-1] > 7.9 and up_s < 6.0
    held = [(l, r) for t, l, r in zip(time_s, lean, rows) if t >= 6.0]
    rms = math.sqrt(statistics.mean(l * l for l, _ in held)) if held else math.nan
    arm = max((abs(r["true.arm_rad"]) for r in rows), default=math.nan)
    return {"done": done, "text": f"stands from {up_s:4.2f} s, then {rms:.3f} rad RMS; arm within {arm:.1f} rad", "up_s": up_s,
            "rms": rms, "arm": arm}


def hopper(rows):
    time_s = [r["time_s"] - rows[0]["time_s"] for r in rows]
    fallen = [t for t, r in zip(time_s, rows) if r["true.z_m"] < 0.3 or abs(r["true.pitch_rad"]) > 1.0]
    done = not fallen and rows[-1]["state"] == "ACTIVE" and time_s[-1] > 4.9
    late = [r for t, r in zip(time_s, rows) if t >= 2.0]
    speed = (late[-1]["true.x_m"] - late[0]["true.x_m"]) / (late[-1]["time_s"] - late[0]["time_s"]) if done else math.nan
    foot = [r["true.z_m"] - r["true.leg_m"] * math.cos(r["true.pitch_rad"] + r["true.hip_rad"]) for r in late]
    hops = sum(a < 0.01 <= b for a, b in zip(foot, foot[1:]))
    return {"done": done, "speed": speed, "hops": hops,
            "text": f"{speed:.3f} m/s, {hops} hops in 3 s" + ("" if done else f", FELL at {fallen[0]:.2f} s" if fallen else "")}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--only", choices=("furuta", "hopper"))
    asked = parser.parse_args()
    for name, seconds, judge in (("furuta", 8, furuta), ("hopper", 5, hopper)):
        if asked.only not in (None, name):
            continue
        results, cover, medians, tails, alarms = [], {}, [], [], 0
        for seed in range(asked.first, asked.first + asked.seeds):
            rows = run(name, seconds, seed)
            result, held = judge(rows), covered(rows)
            results.append(result)
            for parameter, inside in held.items():
                cover[parameter] = cover.get(parameter, 0) + inside
            median, tail = ticks(rows)
            medians.append(median)
            tails.append(tail)
            alarm = any("inadequate" in (r["status"] or "") for r in rows)
            alarms += alarm
            missed = [p for p, inside in held.items() if not inside]
            print(f"{name:7} seed {seed:4}: {'done' if result['done'] else 'NOT DONE':8} {result['text']}; tick {median / 1000:.2f} "
                  f"ms median{', alarm' if alarm else ''}{'; outside 90 %: ' + ', '.join(missed) if missed else ''}", flush=True)
        n = len(results)
        done = sum(r["done"] for r in results)
        if name == "furuta":
            row("Furuta pendulum", f"stands through the last two of 8 s, of {n}", done, "", f">= {n}", done >= n)
            print(f"  it stands from {statistics.median(r['up_s'] for r in results):.2f} s in the median, "
                  f"{max(r['up_s'] for r in results):.2f} s at the latest")
        else:
            row("hopper", f"hops for 5 s without a fall, of {n}", done, "", f">= {n}", done >= n)
            off = [abs(r["speed"] - 0.5) for r in results if r["done"]]
            if off:
                worst = max(off)
                row("hopper", "largest error of the speed of 0.5 m/s", worst, "m/s", "<= 0.1", worst <= 0.1)
                print(f"  its speed is off by {statistics.median(off):.3f} m/s in the median, {worst:.3f} m/s at most")
        goal, heading = math.ceil(0.8 * n), "Furuta pendulum" if name == "furuta" else name
        for parameter, inside in cover.items():
            row(heading, f"90 % interval holds {parameter}, of {n}", inside, "", f">= {goal}", inside >= goal)
        print(f"  tick {statistics.median(medians) / 1000:.2f} ms median, {statistics.median(tails) / 1000:.2f} ms at 99 % "
              f"(median of the seeds); alarms of the adequacy test in {alarms} of {n}")
    summary(ROWS)


if __name__ == "__main__":
    main()
