# programs: tiller_command
"""./dev bench arm: a Panda whose load nobody knows goes to ten poses, simulated by MuJoCo, over LCM in lockstep.

    --seeds N      loads and poses (20)
    --first N      seed to begin with (0); tuning uses 100 and up
    --arms LIST    posterior, frozen, friction, forces, touched, alone (all of them)
    --jobs N       runs at the same time (1); ticks of more than one say nothing about time
    --build DIR    the CMake build folder (build/release)

The robot file comes from `tiller import`; what is asked of it is the hand's pose alone. Encoders of 0.25 mrad, 100 Hz.
`posterior` learns the load (0 to 3 kg), `frozen` keeps the prior's mean, `friction` learns the dry friction of four
joints beside it, `forces` meets the friction of `friction` with a model that has none, and with `disturbance`. `touched`
is pushed by 5 % of a joint's torque, one joint after the other, 0.2 s long; it feels for half of that, and how soon is
put beside the least that any test needs (bench/peers/arm_pushes.py). `alone` is `touched` that nobody pushes, with twenty
poses: every alarm is a false one. Errors are MuJoCo's, 1.5 s after each goal was given.
"""

import argparse
import concurrent.futures
import csv
import json
import os
import pathlib
import random
import re
import subprocess
import sys
import tomllib

from _driver import (CORE, HOME, PEERS, ROOT, held_against_forces, kept_rows, need_environment, note, poisson_bound, python_of,
                     site_packages, summary)

ROWS = []
POSTURE = 0.1
FRAME, HOLD_S, POSES = "panda_hand", 1.5, {"alone": 20}  # by arm; ten otherwise
FELT_ARMS = ("touched", "alone")
PUSH, PUSH_S, TORQUE_NM = 0.05, 0.2, (87, 87, 87, 87, 12, 12, 12)  # share of the joints' limits, in the description
PUSHES = [(j, HOLD_S * (j + 1) + 1.0) for j in range(1, 8)]  # joint and when: one a pose, when it is nearly there
FELT_WITHIN = 5  # periods


def roots(build):
    return os.pathsep.join([str(build / "python"), *map(str, (ROOT / "build/venv/lib").glob("python3*/site-packages"))])


def poses_of(arm):
    return POSES.get(arm, 10)


def urdf():
    return next((site_packages("robots") / "cmeel.prefix/share/example-robot-data").rglob("panda.urdf"))


def make_robot(tiller, folder, arm):
    unknown = "payload=3" + (",friction:panda_joint1,friction:panda_joint2,friction:panda_joint3,friction:panda_joint4"
                             if arm == "friction" else "")
    subprocess.run([tiller, "import", urdf(), "-o", folder, "--force", "--unknown", unknown, "--frame", FRAME, "--hold",
                    "panda_finger_joint1,panda_finger_joint2", "--armature", "*=0.1"], check=True, stdout=subprocess.DEVNULL)
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    speeds = lambda weight: "{ " + ", ".join(f"panda_joint{j}_rad_s = {weight}" for j in range(1, 8)) + " }"
    # seven joints for six numbers: a weak pull to where the arm began says which of the postures, for a tenth of a millimetre
    posture = "{ " + ", ".join(f"panda_joint{j}_rad = {POSTURE}" for j in range(1, 8)) + ", "
    text = re.sub(r"^target = .*$", "target = { panda_joint4_rad = -1.5708, panda_joint6_rad = 1.8675 }", text, flags=re.M)
    text = re.sub(r"^state_weight = .*$", "state_weight = " + speeds(0.1).replace("{ ", posture), text, flags=re.M)
    text = re.sub(r"^terminal_weight = .*$", "terminal_weight = " + speeds(5), text, flags=re.M)
    text = text.replace(f"# frames.{FRAME}", f"frames.{FRAME}")
    if arm == "friction":  # dry friction alone: it is what MuJoCo's joints have
        text = "\n\n".join(part for part in text.split("\n\n") if "viscous_friction" not in part)
        text = re.sub(r"friction_SI = \{[^}]*\}", "friction_SI = { uniform = [0.0, 1.0] }", text)
    if arm in ("forces", *FELT_ARMS):
        text = held_against_forces(text.replace("[posterior]\n", "[posterior]\ndisturbance = true\n", 1))
    if arm in FELT_ARMS:
        felt = ", ".join(f"panda_joint{j}_rad_s = {0.5 * PUSH * TORQUE_NM[j - 1]}" for j in range(1, 8))
        text = text.replace("[safety]", f"[safety]\ncontact_force = {{ {felt} }}", 1)
    if arm == "frozen":
        text = text.replace("[posterior]", "[posterior]\nenabled = false")
    (folder / "robot.toml").write_text(text, encoding="utf-8")


def judge(*arguments):
    out = subprocess.run([python_of("robots"), PEERS / "arm_judge.py", urdf(), FRAME, *map(str, arguments)], check=True,
                         capture_output=True, text=True).stdout
    return [json.loads(line) for line in out.splitlines()]


def write_goals(folder, arm, seed):
    goals = judge("poses", seed, poses_of(arm))
    lines = [f"time_s,{FRAME}_x_m,{FRAME}_y_m,{FRAME}_z_m,{FRAME}_roll_rad,{FRAME}_pitch_rad,{FRAME}_yaw_rad"]
    for k, goal in enumerate(goals):
        goal["end_s"] = HOLD_S * (k + 1)
        lines.append(",".join(str(v) for v in [HOLD_S * k, *goal["position"], *goal["rpy"]]))
    (folder / f"goals_{seed}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / f"goals_{seed}.json").write_text("".join(json.dumps(g) + "\n" for g in goals), encoding="utf-8")


def pin():
    os.sched_setaffinity(0, {CORE})


def run(build, folder, arm, seed, pinned):
    write_goals(folder, arm, seed)
    prefix, robot, log = f"ARM_{os.getpid()}_{seed}_", folder / f"robot_{seed}.toml", folder / f"run_{seed}.csv"
    # a port of its own: who shares one is woken by every message of the others
    url = f"udpm://239.255.76.67:{20000 + (97 * os.getpid() + seed) % 20000}?ttl=0"
    robot.write_text((folder / "robot.toml").read_text(encoding="utf-8")
                     + f'\n[transport]\nkind = "lcm"\nchannel_prefix = "{prefix}"\nurl = "{url}"\n', encoding="utf-8")
    payload_kg = random.Random(seed).uniform(0.0, 3.0)
    seconds = HOLD_S * poses_of(arm)
    pushes = ",".join(f"panda_joint{j}:{PUSH * TORQUE_NM[j - 1]}:{at}:{at + PUSH_S}" for j, at in PUSHES)
    plant = subprocess.Popen(
        [python_of("robots"), ROOT / "examples/mujoco_plant/plant.py", urdf(), robot, "--frame", FRAME, "--payload",
         str(payload_kg), "--armature", "0.1", "--seconds", str(seconds), "--seed", str(seed), "--prefix", prefix,
         "--url", url, "--friction", "0.3" if arm in ("friction", "forces") else "0",
         "--push", pushes if arm == "touched" else ""],
        env=dict(os.environ, PYTHONPATH=roots(build)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        done = subprocess.run([build / "tools/tiller", "run", robot, "--arm", "--lockstep", "--seconds", str(seconds - 0.05),
                               "--goals", folder / f"goals_{seed}.csv", "--log", log, "--quiet"], capture_output=True, text=True,
                              check=False, preexec_fn=pin if pinned else None)
        if done.returncode != 0:
            note(f"{arm}, seed {seed}: {done.stderr.strip() or done.stdout.strip()}")
    finally:
        plant.terminate()
        plant.wait()
    with open(log, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    ticks = sorted(float(row["tick_us"]) for row in rows[10:])
    errors = judge("judge", log, folder / f"goals_{seed}.json")
    result = {"arm": arm, "seed": seed, "payload_kg": payload_kg, "state": rows[-1]["state"],
              "seconds": float(rows[-1]["time_s"]) - float(rows[0]["time_s"]),
              "mm": [1e3 * e["m"] for e in errors], "deg": [57.29578 * e["rad"] for e in errors],
              "tick_ms": [1e-3 * ticks[len(ticks) // 2], 1e-3 * ticks[int(0.99 * len(ticks))]]}
    if arm in FELT_ARMS:
        felt, result["false"] = contacts(rows, PUSHES if arm == "touched" else [])
        if arm == "touched":
            result["felt"], result["at"] = felt, [joints_at(rows, at) for _, at in PUSHES]
    if "q05.body.mass_kg" in rows[-1]:
        result["interval"] = [float(rows[-1]["q05.body.mass_kg"]), float(rows[-1]["q95.body.mass_kg"])]
    if arm == "alone" and not result["false"]:
        log.unlink()  # nothing to look at
    return result


def joints_at(rows, at_s):
    start_s = float(rows[0]["time_s"])
    row = min(rows, key=lambda r: abs(float(r["time_s"]) - start_s - at_s))
    return [float(row[f"mean.panda_joint{j}_rad"]) for j in range(1, 8)]


def least_periods(results, robot):
    """By seed and joint: the mean number of periods that any test needs; with rates that walk as the robot file says."""
    sd = robot["noise"]["process_sd"]
    asked = {"push_Nm": [PUSH * t for t in TORQUE_NM], "sensor_rad": 0.00025, "period_s": robot["model"]["period_s"],
             "process_sd": [sd[f"panda_joint{j}_rad_s"] for j in range(1, 8)], "alarms_an_hour": 1}
    lines = "".join(json.dumps(asked | {"payload_kg": r["payload_kg"], "at": r["at"]}) + "\n" for r in results)
    out = subprocess.run([python_of("robots"), PEERS / "arm_pushes.py", urdf(), FRAME, "0.1"], input=lines, check=True,
                         capture_output=True, text=True).stdout
    return [json.loads(line) for line in out.splitlines()]


def tell_least(results, robot):
    least = least_periods(results, robot)
    mean = lambda values: sum(values) / max(len(values), 1)
    print("    mean periods until a push is felt, by joint: ours (of those felt), the least of any test with an alarm an hour, "
          "and of one that has rates walk as the robot file says")
    for j in range(7):
        ours = [r["felt"][j] for r in results if r["felt"][j] is not None]
        known, walking = (mean([a[how][j] for a in least]) for how in ("known", "walking"))
        print(f"      joint {j + 1}: {mean(ours):5.1f} ({len(ours)} of {len(results)}) {known:5.1f} {walking:5.1f}")
    every = [f for r in results for f in r["felt"] if f is not None]
    ratio = mean(every) / mean([v for a in least for v in a["known"]])
    print(f"      all: {mean(every):.1f}, {ratio:.1f} times the least")


def contacts(rows, pushes):
    """Periods until each push was felt (None: never), and alarms that begin while nobody pushes."""
    period_s = float(rows[1]["time_s"]) - float(rows[0]["time_s"])
    start_s = float(rows[0]["time_s"])
    time_s = [float(r["time_s"]) - start_s for r in rows]
    alarm = [int(r["touched"]) != 0 for r in rows]
    begins = [t for t, now, before in zip(time_s[1:], alarm[1:], alarm) if now and not before]
    felt = []
    for _, at in pushes:
        within = [t for t, now in zip(time_s, alarm) if now and at < t <= at + PUSH_S]
        felt.append(round((within[0] - at) / period_s) if within else None)
    pushed = lambda t: any(at < t <= at + 2.0 * PUSH_S for _, at in pushes)
    return felt, sum(not pushed(t) for t in begins)


def row(what, figure, unit, goal, good):
    ROWS.append({"section": "arm", "heading": "a Panda in MuJoCo, ten poses", "row": what, "figure": figure, "unit": unit,
                 "goal": goal, "met": good})
    print(f"  {what:66s} {figure:>10.4g} {unit:<4} goal {goal:8s} {'met' if good else 'short'}", flush=True)


def tell(results, arm, robot):
    of = [r for r in results if r["arm"] == arm]
    if not of:
        return
    reached = [r for r in of if r["state"] == "ACTIVE" and max(r["mm"]) <= 5.0 and max(r["deg"]) <= 1.0]
    print(f"{arm}: {len(of)} seeds")
    n = len(of)
    every_mm = sorted(v for r in of for v in r["mm"])
    every_deg = sorted(v for r in of for v in r["deg"])
    print(f"    all poses: {every_mm[len(every_mm) // 2]:.2f} mm median, {every_mm[-1]:.2f} mm at most; "
          f"{every_deg[len(every_deg) // 2]:.3f} deg median, {every_deg[-1]:.3f} deg at most")
    if arm in FELT_ARMS:
        hours = sum(r["seconds"] for r in of) / 3600.0
        alarms = sum(r["false"] for r in of)
        row(f"{arm}: alarms while nobody pushes, an hour ({alarms} in {60 * hours:.1f} min)", alarms / hours, "", "<= 1",
            alarms <= hours)
        low, high = poisson_bound(alarms, 0.9)
        print(f"    the rate lies in {low / hours:.2g} .. {high / hours:.2g} an hour, 90 % of Poisson's law")
    if arm == "alone":
        return
    if arm == "touched":
        felt = [f for r in of for f in r["felt"]]
        soon = sum(f is not None and f <= FELT_WITHIN for f in felt)
        row(f"touched: pushes felt within {FELT_WITHIN} periods, of {len(felt)}", soon, "", f">= {len(felt)}", soon == len(felt))
        print(f"    periods until a push was felt: {sorted((f for f in felt if f is not None))}, never: {felt.count(None)}")
        tell_least(of, robot)
        return
    if arm == "frozen":
        print(f"    seeds with ten poses within 5 mm and 1 degree: {len(reached)} of {n}")
        return
    row(f"{arm}: seeds with ten poses within 5 mm and 1 degree, of {n}", len(reached), "", f">= {n}", len(reached) >= n)
    covered = sum(r["interval"][0] <= r["payload_kg"] <= r["interval"][1] for r in of)
    row(f"{arm}: 90 % intervals of the load that hold it, of {n}", covered, "", f">= {round(0.8 * n)}", covered >= 0.8 * n)
    error = sorted(abs(sum(r["interval"]) / 2 - r["payload_kg"]) for r in of)
    print(f"    the load is off by {1e3 * error[n // 2]:.1f} g in the median, {1e3 * error[-1]:.1f} g at most")
    p99 = sorted(r["tick_ms"][1] for r in of)[n // 2]
    row(f"{arm}: tick, 99 %, median of the seeds", p99, "ms", "<= 5", p99 <= 5.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed to begin with; tuning uses 100 and up")
    parser.add_argument("--arms", default="posterior,frozen,friction,forces,touched,alone")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    options = parser.parse_args()
    build = options.build.resolve()
    tiller = build / "tools/tiller"
    if not tiller.exists():
        note(f"{tiller} is not there; run ./dev build")
        return 1
    if not need_environment("robots"):
        return 1
    home = HOME / "arm"
    home.mkdir(parents=True, exist_ok=True)
    kept = home / "rows.jsonl"  # a cut loses nothing
    stamp = tiller.stat().st_mtime
    seeds = range(options.first, options.first + options.seeds)
    found = {k: r for k, r in kept_rows(kept, lambda r: (r["arm"], r["seed"])).items() if r.get("build") == stamp}
    kept.write_text("".join(json.dumps(r) + "\n" for r in found.values()), encoding="utf-8")
    for arm in options.arms.split(","):
        make_robot(tiller, home / arm, arm)
        wanted = [seed for seed in seeds if (arm, seed) not in found]
        with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
            runs = [pool.submit(run, build, home / arm, arm, seed, options.jobs == 1) for seed in wanted]
            for result in map(lambda r: dict(r.result(), build=stamp), concurrent.futures.as_completed(runs)):
                note(f"{arm}, seed {result['seed']}: {max(result['mm']):.2f} mm, {max(result['deg']):.3f} deg, "
                     f"{result['payload_kg']:.3f} kg in {result.get('interval')}, tick {result['tick_ms'][0]:.2f} and "
                     f"{result['tick_ms'][1]:.2f} ms, false alarms {result.get('false')}")
                found[arm, result["seed"]] = result
                with open(kept, "a", encoding="utf-8") as file:
                    file.write(json.dumps(result) + "\n")
        tell([found[arm, seed] for seed in seeds if (arm, seed) in found], arm,
             tomllib.loads((home / arm / "robot.toml").read_text(encoding="utf-8")))
    summary(ROWS)
    return 0


sys.exit(main())
