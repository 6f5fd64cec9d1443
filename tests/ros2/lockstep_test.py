"""The same pendulum over LCM and over ROS 2's wire: the same commands to the last bit, and no message lost.

    lockstep_test.py TILLER ROBOT TYPES TICKS     (TYPES: the folder of the Python package tiller_lcm)
"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

here = pathlib.Path(__file__).parent
# a small plan: what is compared is the wire
SMALL = {"horizon": 30, "knots": 6, "rollouts": 32, "particles": 4, "iterations": 1}


def small(text):
    head, planner, tail = re.split(r"(?=\[planner\])|(?=\[cost\])", text, maxsplit=2)
    for key, value in SMALL.items():
        planner = re.sub(rf"(?m)^{key} = .*", f"{key} = {value}", planner)
    return head + planner + tail + "\n[posterior]\nparticles = 64\n"


def run(tiller, types, ticks, over, folder):
    commands = folder / f"{over}.commands"
    environment = dict(os.environ, PYTHONPATH=types)
    plant = subprocess.Popen([sys.executable, str(here / "pendulum_plant.py"), "--over", over, "--ticks", str(ticks),
                              "--commands", str(commands)], env=environment)
    try:
        done = subprocess.run([tiller, "run", str(folder / "robot.toml"), "--transport", over, "--arm", "--lockstep",
                               "--seconds", str(0.02 * ticks), "--wait", "60", "--patience", "60", "--quiet"],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=1200, check=False,
                              cwd=folder)
        print(done.stdout, end="")
        if done.returncode != 0:
            sys.exit(f"{over}: tiller run ended with {done.returncode}")
        if plant.wait(60) != 0:
            sys.exit(f"{over}: the plant had to ask again, or failed")
    finally:
        plant.kill()
    return commands.read_text(encoding="ascii").split()[:ticks], done.stdout


def main():
    tiller, robot, types, ticks = sys.argv[1], pathlib.Path(sys.argv[2]), sys.argv[3], int(sys.argv[4])
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "robot.toml").write_text(small(robot.read_text(encoding="utf-8")), encoding="utf-8")
        by_lcm, _ = run(tiller, types, ticks, "lcm", folder)
        by_ros2, told = run(tiller, types, ticks, "ros2", folder)
    if len(by_ros2) != ticks or by_lcm != by_ros2:
        first = next((k for k, (a, b) in enumerate(zip(by_lcm, by_ros2)) if a != b), None)
        sys.exit(f"other commands over ROS 2 than over LCM, first at tick {first}")
    counted = re.search(r"ros2: (\d+) received, (\d+) sent", told)
    if not counted or int(counted[1]) < ticks:
        sys.exit(f"{counted and counted[1]} of {ticks} measurements received")
    if len(set(by_ros2)) < ticks // 20:
        sys.exit("the commands hardly differ: nothing was compared")
    print(f"{ticks} ticks: the same commands over ROS 2's wire as over LCM")


if __name__ == "__main__":
    main()
