"""What goes wrong on ROS 2's wire, in lockstep with an independent participant: the run must end as it does over LCM.

    faults_test.py TILLER ROBOT
"""
import gc
import math
import pathlib
import random
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, uint8

import ros2_types as ros2
from lockstep_test import small
from pendulum_plant import PERIOD_US, OverRos2, period

TILLER, ROBOT = sys.argv[1], pathlib.Path(sys.argv[2])
SAFE, REFUSED = 3, 1  # exit codes
FAULT_AT, TICKS = 60, 200


class Run:
    """tiller run, and the pendulum that it steers."""

    def __init__(self, folder, *more, more_text="", measured="{ sd = 0.002 }"):
        text = small(ROBOT.read_text(encoding="utf-8")) + more_text
        text = text.replace("\nangle_rad = { sd = 0.002 }", f"\nangle_rad = {measured}", 1)
        (folder / "robot.toml").write_text(text, encoding="utf-8")
        seconds = () if "--seconds" in more else ("--seconds", str(TICKS * 0.02))
        self.command = [TILLER, "run", "robot.toml", "--transport", "ros2", "--arm", *seconds, *more]
        self.folder = folder
        self.link, self.angle, self.rate, self.commands = OverRos2(), 0.3, 0.0, []
        self.start()

    def start(self):
        self.process = subprocess.Popen(self.command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                        cwd=self.folder)

    def tick(self, k, timeout_s=20.0, publish=None):
        """False: no answer."""
        torque = None
        while torque is None:
            if k == 0 and self.process.poll() is not None:
                sys.exit(f"refused to run:\n{self.process.stdout.read()}")
            if publish:
                publish(k, self.angle)
            else:
                self.link.publish(k, self.angle)
            torque = self.link.answer(k, 0.1 if k == 0 else timeout_s)
            if torque is None and k > 0:
                return False
        self.commands.append(torque)
        self.angle, self.rate = period(self.angle, self.rate, torque)
        return True

    def drain(self):
        """Commands until the run ends: those that answer nothing."""
        last = []
        while self.process.poll() is None:
            last += self.heard()
            try:
                self.process.wait(0.05)
            except subprocess.TimeoutExpired:
                pass
        return last + self.heard()

    def heard(self):
        """A sample without data says that the writer is gone."""
        return [command.data[0] for command in self.link.reader.take(N=64) if isinstance(command, ros2.Float64MultiArray)]

    def end(self, code, *words):
        self.last = self.drain()
        told = self.process.stdout.read()
        missing = [word for word in words if word not in told]
        if self.process.returncode != code or missing:
            sys.exit(f"ended with {self.process.returncode}, not {code}; without {missing}:\n{told}")
        return told


LOCKSTEP = ("--lockstep", "--wait", "60", "--patience", "0.3")


def must_be_zero(commands):
    if not commands or any(c != 0 for c in commands):
        sys.exit(f"the safe command is zero; heard {commands[-5:]}")


def cut(folder):
    run = Run(folder, *LOCKSTEP)
    for k in range(FAULT_AT):
        run.tick(k)
    run.end(SAFE, "SAFE at", "sensor_stale")
    must_be_zero(run.last[-3:])


def not_a_number(folder):
    run = Run(folder, *LOCKSTEP)
    for k in range(FAULT_AT):
        run.tick(k)
    run.angle, k = math.nan, FAULT_AT
    while run.process.poll() is None and run.tick(k, 1.0):
        run.angle, k = math.nan, k + 1
    run.end(SAFE, "SAFE at", "sensor")
    driven = max(i for i, command in enumerate(run.commands) if command != 0)
    if driven > FAULT_AT + 6:  # the sensor timeout of 0.1 s, and a tick
        sys.exit(f"driven {driven - FAULT_AT} ticks after the last reading")
    must_be_zero(run.commands[-1:])


def repeated_stamp(folder):
    run = Run(folder, *LOCKSTEP)
    for k in range(FAULT_AT):
        run.tick(k)
    while run.process.poll() is None:  # another reading under the stamp of the last one
        run.link.publish(FAULT_AT - 1, run.angle + 0.5)
        try:
            run.process.wait(0.02)
        except subprocess.TimeoutExpired:
            pass
    run.end(SAFE, "SAFE at", "sensor_stale", "answers sent again")


def old_stamps(folder):
    """The other side begins its clock again: none of its readings is newer than the last one."""
    run = Run(folder, *LOCKSTEP)
    for k in range(FAULT_AT):
        run.tick(k)
    for k in range(FAULT_AT - 1):
        run.link.publish(k, 0.5)
    run.end(SAFE, "SAFE at", "sensor_stale", "superseded")
    must_be_zero(run.last[-3:])


def two_publishers(folder):
    """Another publisher, 1.5 rad away, half a period after each reading from now on: the jumps are refused."""
    run = Run(folder, *LOCKSTEP, "--log", "run.csv", measured="{ sd = 0.002, rate_per_s = 20 }")
    other = OverRos2()
    for k in range(TICKS):
        if not run.tick(k, 5.0):
            sys.exit(f"no answer to tick {k}")
        if k >= FAULT_AT:
            other.writer.write(ros2.JointState(ros2.stamp(10**9 + k * PERIOD_US * 1000 + 10**7), ["angle"],
                                               [run.angle + 1.5]))
    run.end(0, "ended in ACTIVE")
    refused = (folder / "run.csv").read_text(encoding="utf-8").count("sensor_jump")
    if refused < 10:  # some of them are superseded before a tick takes them
        sys.exit(f"{refused} ticks refused a jump")


def plant_restarts(folder):
    """The other side's process dies and another one goes on where it stood: nothing is lost but time."""
    run = Run(folder, "--lockstep", "--wait", "60", "--patience", "60")
    for k in range(TICKS):
        if k == FAULT_AT:
            run.link = None
            gc.collect()
            run.link = OverRos2()
        while not run.tick(k, 0.2):  # lost where the two had not found each other yet
            pass
    while run.process.poll() is None:  # it waits for one more than it needs
        run.link.publish(TICKS, run.angle)
        time.sleep(0.02)
    run.end(0, "ended in ACTIVE")
    return run.commands


def controller_restarts(folder):
    """SIGKILL: no command any more, from nobody else either. A new process takes the robot over as it finds it."""
    run = Run(folder, *LOCKSTEP)
    for k in range(FAULT_AT):
        run.tick(k)
    run.process.kill()
    run.process.wait()
    run.link.publish(FAULT_AT, run.angle)
    if run.link.answer(FAULT_AT, 0.5) is not None:
        sys.exit("a command of a process that is gone")
    run.start()
    k = FAULT_AT + 1
    while not run.tick(k, 0.1):
        k += 1
    for k in range(k + 1, k + TICKS):
        run.tick(k)
    run.end(0, "ended in ACTIVE")


def stamp_ahead(folder):
    """One reading an hour ahead: rejected, and nothing else."""
    run = Run(folder, *LOCKSTEP)
    for k in range(TICKS):
        if k == FAULT_AT:
            message = ros2.JointState(ros2.stamp(10**9 + k * PERIOD_US * 1000), ["angle"], [9.0, 1.0])
            message.header.stamp.nanosec = 4 * 10**9  # and one that is no time at all
            run.link.writer.write(message)
        run.tick(k)
    run.end(0, "1 bad messages", "a header.stamp is no time")


def publish_until_told(run, publish, words):
    """The run says while it waits what is wrong; then it is interrupted."""
    told = []
    reader = threading.Thread(target=lambda: told.extend(run.process.stdout), daemon=True)
    reader.start()
    for _ in range(300):
        publish(run)
        time.sleep(0.1)
        if any("waiting for the first" in line for line in told):
            break
    run.process.send_signal(signal.SIGINT)
    run.process.wait(60)
    reader.join(60)
    lines = [line for line in told if "waiting for the first" in line]
    if run.process.returncode != REFUSED or words not in "".join(lines):
        sys.exit(f"ended with {run.process.returncode}:\n{''.join(told)}")


def other_topic(folder):
    node = ros2.Node()
    writer = node.writer("joint_state", ros2.JointState)
    run = Run(folder, "--lockstep", "--wait", "60")
    run.link = None  # the right publisher
    publish_until_told(run, lambda _: writer.write(ros2.JointState(ros2.stamp(10**9), ["angle"], [0.1])),
                       "nobody publishes rt/joint_states in this domain")


def other_joint(folder):
    publish_until_told(Run(folder, "--lockstep", "--wait", "60"),
                       lambda run: run.link.writer.write(
                           ros2.JointState(ros2.stamp(10**9), ["elbow", "wrist"], [0.1, 0.2])),
                       "a JointState without the position of the joint angle; its joints are: elbow, wrist")


def other_type(folder):
    node = ros2.Node()
    writer = node.writer("joint_states", ros2.Imu)
    run = Run(folder, "--lockstep", "--wait", "60")
    run.link = None  # the right publisher
    publish_until_told(run, lambda _: writer.write(ros2.Imu(ros2.stamp(10**9))),
                       "has the type sensor_msgs::msg::dds_::Imu_, not sensor_msgs::msg::dds_::JointState_")


def hostile_type(size):
    @dataclass
    class Hostile(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
        bytes: array[uint8, size]

    return Hostile


def hostile(folder):
    """Bytes of another layout under the right names: the stamp of a JointState, then lengths out of nothing."""
    run, dice = Run(folder, *LOCKSTEP), random.Random(5)
    node = ros2.Node()
    kinds = {size: hostile_type(size) for size in (4, 28, 64, 1000)}
    writers = {size: node.writer("joint_states", kind) for size, kind in kinds.items()}
    plain = OverRos2.publish

    def among_hostile(k, angle):
        if k > 0:
            for size, writer in writers.items():
                body = bytearray(dice.randbytes(size))
                if dice.random() < 0.5:  # the lengths of the frame's name and of the joints' names
                    body[8:12] = (1).to_bytes(4, "little")
                    body[16:20] = dice.choice([0, 1, 255, 2**31, 2**32 - 1]).to_bytes(4, "little")
                body[0:4] = dice.choice([b"\0\0\0\0", b"\xff\xff\xff\x7f", bytes(body[0:4])])
                writer.write(kinds[size](list(body[:size])))
        plain(run.link, k, angle)

    many = [str(j) for j in range(1000)]
    for k in range(TICKS):
        run.tick(k, publish=among_hostile)
        for names, values in ((many, [0.0] * 1000), (["angle"] * 9, []), ([], [1.0])):
            run.link.writer.write(ros2.JointState(ros2.stamp(10**9 + (k + 1) * PERIOD_US * 1000), names, values))
    told = run.end(0, "ended in ACTIVE")
    bad = int(re.search(r"(\d+) bad messages", told)[1])
    if bad < 3 * TICKS:
        sys.exit(f"of {7 * TICKS} hostile messages {bad} were counted")
    return run.commands


def clean(folder):
    run = Run(folder, *LOCKSTEP)
    for k in range(TICKS):
        run.tick(k)
    run.end(0, "ended in ACTIVE")
    return run.commands


def main():
    results = {}
    for case in (clean, cut, not_a_number, repeated_stamp, old_stamps, stamp_ahead, two_publishers, plant_restarts,
                 controller_restarts, other_topic, other_joint, other_type, hostile):
        with tempfile.TemporaryDirectory() as folder:
            results[case] = case(pathlib.Path(folder))
        print(f"{case.__name__}: as it must", flush=True)
    for harmless in (hostile, plant_restarts):
        if results[harmless] != results[clean]:
            sys.exit(f"{harmless.__name__} changed the commands")


if __name__ == "__main__":
    main()
