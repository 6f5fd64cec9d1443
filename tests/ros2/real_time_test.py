"""By the wall clock against the Python participant: every JointState reaches tiller, and every command comes back.

    real_time_test.py TILLER ROBOT TICKS

Nothing is said of how late they are, which is the machine's doing (./dev bench transports).
"""
import pathlib
import re
import subprocess
import sys
import tempfile
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.util import duration

import ros2_types as ros2
from lockstep_test import small
from pendulum_plant import period

PERIOD_S = 0.02
TILLER, ROBOT, TICKS = sys.argv[1], pathlib.Path(sys.argv[2]), int(sys.argv[3])
# a test that is held up for seconds must not take that for a loss on the wire
LONG = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(2000), Policy.Durability.Volatile,
           Policy.DataRepresentation(use_cdrv0_representation=True))


def main():
    node, angle, rate, torque, answers = ros2.Node(), 0.3, 0.0, 0.0, 0
    writer = node.writer("joint_states", ros2.JointState, ros2.SENSOR_DATA)
    reader = node.reader("pendulum/commands", ros2.Float64MultiArray, LONG)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        # a machine that is held up for seconds is none of the wire's faults either
        patient = small(ROBOT.read_text(encoding="utf-8")).replace("sensor_timeout_s = 0.1", "sensor_timeout_s = 5")
        (folder / "robot.toml").write_text(patient, encoding="utf-8")
        run = subprocess.Popen([TILLER, "run", "robot.toml", "--transport", "ros2", "--arm", "--wait", "60", "--quiet",
                                "--seconds", str((TICKS + 5) * PERIOD_S)],
                               cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        while not writer.get_matched_subscriptions() or not reader.get_matched_publications():
            time.sleep(0.05)
        due = time.monotonic()
        for _ in range(TICKS):
            writer.write(ros2.JointState(ros2.stamp(time.time_ns()), ["angle"], [angle]))
            due = max(due + PERIOD_S, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            heard = [command for command in reader.take(N=2000) if isinstance(command, ros2.Float64MultiArray)]
            torque, answers = heard[-1].data[0] if heard else torque, answers + len(heard)
            if run.poll() is not None:
                sys.exit("the run ended early:\n" + run.stdout.read())
            angle, rate = period(angle, rate, torque)
        told = run.communicate(timeout=120)[0]
    answers += sum(isinstance(command, ros2.Float64MultiArray) for command in reader.take(N=2000))
    print(told)
    counted = re.search(r"ros2: (\d+) received, (\d+) sent(.*)", told)
    received, sent = int(counted[1]), int(counted[2])
    superseded = re.search(r"(\d+) superseded", counted[3])
    arrived = received  # what a newer one has superseded before the tick is among them
    print(f"{TICKS} published, {arrived} arrived ({superseded[1] if superseded else 0} of them superseded); {sent} commands "
          f"sent, {answers} arrived")
    if arrived != TICKS or answers != sent:
        sys.exit("messages were lost")


if __name__ == "__main__":
    main()
