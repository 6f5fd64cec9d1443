"""mujoco_servos_test.py TILLER SOURCE: what examples/mujoco_plant/plant.py --servos makes of goals, in lockstep.

The robot is tests/import/servos.xml, imported with --servos; in the controller's place stands a constant command, the
targets of the robot file. MuJoCo's own actuators bring the joints there. Without --servos the same numbers are forces,
and the arm falls. Skipped (77) without MuJoCo.
"""
import os
import pathlib
import subprocess
import sys
import tempfile
import tomllib

try:
    import lcm
    import mujoco  # noqa: F401 pylint: disable=unused-import
except ImportError as missing:
    print(f"no {missing.name} here")
    sys.exit(77)
from tiller_lcm import wide_command_t, wide_measurement_t

TILLER, SOURCE = sys.argv[1], pathlib.Path(sys.argv[2])
ARM, PLANT = SOURCE / "tests/import/servos.xml", SOURCE / "examples/mujoco_plant/plant.py"
SECONDS = 2.0


def steer(robot, goals, *options):
    """Where the joints are measured at last."""
    bus, last = lcm.LCM("udpm://239.255.76.67:7667?ttl=0"), {}

    def answer(_, data):
        measured, command = wide_measurement_t.decode(data), wide_command_t()
        last.update(zip(tomllib.loads(robot.read_text())["measurement"], measured.value))
        command.sequence, command.count, command.value = measured.sequence, len(goals), goals
        bus.publish("TILLER_COMMAND", command.encode())

    bus.subscribe("TILLER_MEASUREMENT", answer)
    plant = subprocess.Popen([sys.executable, PLANT, ARM, robot, "--seconds", str(SECONDS), "--noise", "0", *options])
    while plant.poll() is None:
        bus.handle_timeout(20)
    assert plant.returncode == 0, plant.returncode
    return last


def main():
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([TILLER, "import", ARM, "-o", folder, "--servos"], check=True, stdout=subprocess.DEVNULL,
                       env=dict(os.environ, TILLER_PYTHON=sys.executable))
        path = pathlib.Path(folder) / "robot.toml"
        robot = tomllib.loads(path.read_text())
        target, start = robot["cost"]["target"], robot["start"]["state"]
        served = {e["port"].rsplit("_", 1)[0] for e in robot["effects"] if e["kind"] == "position_servo"}
        joint_of = {key: key.rsplit("_", 1)[0] for key in robot["limits"]}
        state_of = {key.rsplit("_", 1)[0]: key for key in target}
        # the wrist has a velocity servo, whose input is a force: none
        goals = [target[state_of[joint]] if joint in served else 0.0 for joint in joint_of.values()]
        ends = {name: steer(path, goals, *options) for name, options in (("servos", ["--servos"]), ("forces", []))}
        off = {name: max(abs(end[state_of[joint]] - target[state_of[joint]]) for joint in served)
               for name, end in ends.items()}
        moved = max(abs(target[state_of[joint]] - start.get(state_of[joint], 0.0)) for joint in served)
        print(f"moved by {moved:.3f}; from the goals after {SECONDS:g} s: {off}")
        # a servo leaves what gravity takes: the elbow's 1 Nm at 135 Nm/rad
        assert moved > 0.2 and off["servos"] < 0.02 and off["forces"] > 0.2, off


if __name__ == "__main__":
    main()
