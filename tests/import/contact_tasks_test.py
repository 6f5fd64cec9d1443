"""contact_tasks_test.py TILLER TYPES SOURCE [hop|grasp|slide]...: the leg rig hops, the gripper takes its box and the
leg rubs along the ground in MuJoCo, over LCM in lockstep, while tiller plans with the models that it has imported: ten
seeds each, all reported.

Each seed is another machine: friction within 20 %, masses within 15 % (not where friction is learnt), the box up to
2 mm aside, noise of its own. The controller knows the files' values. Passed are
  hop    6 hops of the 8 that the goals ask for (the foot 3 cm above the ground, then on it again), and the trunk never
         15 cm below its start
  grasp  the box in the air, within 2 cm of 15 cm, for the whole last second
  slide  the friction that the posterior ends with, within 15 % of the machine's
8 seeds of 10 have to pass. Exits 77 without mujoco. Run it in a network namespace of its own.
"""
import csv
import math
import os
import pathlib
import re
import subprocess
import sys
import tempfile

SEEDS, ENOUGH = range(1, 11), 8
LEG = ("leg", ["--contact", "foot:plane", "--frame", "sole"])
GRIPPER = ("gripper", ["--contact", "left_pad:box,right_pad:box,box:plane"])
TASKS = {"hop": (*LEG, 5), "grasp": (*GRIPPER, 4), "slide": (*LEG, 4)}


def another(mujoco, path, seed, masses, out):
    import numpy as np

    rng, spec = np.random.default_rng(seed), mujoco.MjSpec.from_file(str(path))
    spec.compile()
    friction = rng.uniform(0.8, 1.2)
    for geom in spec.geoms:
        geom.mass *= rng.uniform(1.0 - masses, 1.0 + masses)
        geom.friction[0] *= friction
    for body in spec.bodies:
        if body.name == "box": body.pos[1] += rng.uniform(-0.002, 0.002)
    spec.compile()
    out.write_text(spec.to_xml(), encoding="utf-8")
    return friction


def run(tiller, types, source, robot, machine, goals, seconds, seed, out):
    trace = out / f"{robot.stem}_{seed}.csv"
    plant = subprocess.Popen(
        [sys.executable, str(source / "examples/mujoco_plant/plant.py"), str(machine), str(robot), "--seconds",
         str(seconds), "--seed", str(seed), "--trace", str(trace)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=dict(os.environ, PYTHONPATH=types))
    done = None
    try:
        done = subprocess.run(
            [tiller, "run", str(robot), "--transport", "lcm", "--arm", "--lockstep", "--patience", "60", "--seconds",
             str(seconds), "--quiet", "--goals", str(goals), "--alarm-log", str(out / "alarm.csv")],
            capture_output=True, text=True, check=False)
    finally:  # it would ask for ever
        if done is None or done.returncode != 0: plant.terminate()
    said = plant.communicate()[0]
    if done.returncode != 0 or plant.returncode != 0:
        raise SystemExit(f"seed {seed}: {done.stdout}{done.stderr}{said}")
    return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(trace.open(encoding="utf-8"))], done.stdout


def hop(rows, said, friction):
    hops, is_up, best, lowest = 0, False, 0.0, 0.0
    for row in rows:
        thigh, calf = row["hip"], row["hip"] + row["knee"]
        foot = 0.32 + row["rail"] - 0.213 * (math.cos(thigh) + math.cos(calf)) - 0.022
        best, lowest = max(best, foot), min(lowest, row["rail"])
        if is_up and foot < 0.005: hops, is_up = hops + 1, False
        is_up = is_up or foot > 0.03
    says = f"{hops} hops, the highest {best:.3f} m, the trunk at most {-lowest:.3f} m below its start"
    return hops >= 6 and lowest > -0.15, says


def slide(rows, said, friction):
    learnt, sd = map(float, re.search(r"foot_friction +([0-9.]+) \+- ([0-9.]+)", said).groups())
    truth = 0.8 * friction
    off = learnt / truth - 1.0
    return abs(off) < 0.15, f"friction {truth:.3f} learnt as {learnt:.3f} +- {sd:.3f} ({100 * off:+.1f} %)"


def grasp(rows, said, friction):
    last = [row["box_z"] for row in rows if row["time_s"] >= rows[-1]["time_s"] - 1.0]
    says = f"box between {min(last):.4f} and {max(last):.4f} m in the last second"
    return all(abs(z - 0.15) < 0.02 for z in last), says


def try_task(mujoco, tiller, types, source, name, out):
    stem, options, seconds = TASKS[name]
    example = source / "examples/contacts"
    env = dict(os.environ, TILLER_PYTHON=sys.executable)
    if not (out / stem).exists():
        subprocess.run([tiller, "import", str(example / f"{stem}.xml"), "-o", str(out / stem), *options], check=True,
                       env=env, stdout=subprocess.DEVNULL)
    robot = out / stem / f"{name}.toml"
    robot.write_bytes((example / f"{name}.toml").read_bytes())
    passed = 0
    for seed in SEEDS:
        friction = another(mujoco, example / f"{stem}.xml", seed, 0.0 if name == "slide" else 0.15, out / "machine.xml")
        goals = example / f"{name}_goals.csv"
        rows, said = run(tiller, types, source, robot, out / "machine.xml", goals, seconds, seed, out)
        good, says = globals()[name](rows, said, friction)
        passed += good
        print(f"{name} seed {seed}, friction x {friction:.2f}: {'passed' if good else 'FAILED'}; {says}", flush=True)
    print(f"{name}: {passed} of {len(SEEDS)} seeds")
    return passed >= ENOUGH


def main():
    tiller, types, source = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3]).resolve()
    try:
        import lcm  # noqa: F401
        import mujoco
    except ImportError as missing:
        print(missing)
        raise SystemExit(77)
    with tempfile.TemporaryDirectory() as folder:
        done = [try_task(mujoco, tiller, types, source, name, pathlib.Path(folder)) for name in sys.argv[4:] or TASKS]
    raise SystemExit(0 if all(done) else 1)


if __name__ == "__main__":
    main()
