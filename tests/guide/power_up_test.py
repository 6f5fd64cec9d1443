"""Follows docs/guide/first_power_up.md to the letter with an emulated drive of each protocol on a (virtual) CAN bus,
and reads the bus: before somebody arms nothing that moves is on it.

    power_up_test.py GUIDE TILLER ROBOT INTERFACE

Commands, keys and exit codes are the page's own. Only `--lockstep` is added, because emulated machines are slow. ROBOT
is robots/pendulum.toml, here with small numbers for the same reason.
"""

import os
import pathlib
import pty
import re
import shlex
import signal
import subprocess
import sys
import threading
import time

GUIDE, TILLER, ROBOT, INTERFACE = sys.argv[1:]
PATIENCE_S = 120  # what a loaded machine may take for one step
NODE, BOARD = 3, 48
DRIVES = {"odrive": "", "moteus": 'resolution = "int16"', "mit": 'torque_Nm = 4, reply = "damiao"'}
SMALL = {"horizon": 10, "knots": 5, "rollouts": 16, "particles": 2, "iterations": 1}
WITH_COMMANDS = [7, 9, 10, 13]  # steps of the page that say what to start


def steps(text):
    """Number -> text of the page's numbered steps."""
    parts = re.split(r"^(\d+)\. ", text, flags=re.MULTILINE)
    return {int(number): body.split("\n## ")[0] for number, body in zip(parts[1::2], parts[2::2])}


def commands(body):
    return [line.strip() for line in body.splitlines() if re.match(r" {8}tiller ", line)]


def robot_file(protocol):
    text = pathlib.Path(ROBOT).read_text(encoding="utf-8")
    for key, value in SMALL.items():
        text = re.sub(rf"^{key} = .*", f"{key} = {value}", text, flags=re.MULTILINE)
    start = "state = { angle_rad = 3.09 }"
    text = text.replace("[start]\n", f"[start]\n{start}\n").replace("draw = true\n", f"draw = true\n{start}\n")
    drive = f"drives.torque_Nm = {{ {DRIVES[protocol]} }}\n" if DRIVES[protocol] else ""
    return (f'{text}\n[posterior]\nparticles = 32\nwindow = 16\nmoves_per_tick = 8\n\n[transport]\nkind = "socketcan"\n'
            f'interface = "{INTERFACE}"\nnodes = {{ torque_Nm = {NODE} }}\nactuator = "{protocol}"\n{drive}')


def verdict(protocol, identifier, data):
    """Of a frame: "moves" (a drive, or lets it be moved), "rests", "status" of the controller, or None: not from it."""
    if identifier == BOARD << 5 | 1:
        return "status"
    if protocol == "odrive":
        if identifier == NODE << 5 | 0x07:
            return "rests" if data == bytes([1, 0, 0, 0]) else "moves"
        if identifier == NODE << 5 | 0x0e:
            return "rests" if data == bytes(4) else "moves"
        return "moves" if identifier in [NODE << 5 | command for command in (0x0b, 0x0c, 0x0d)] else None
    if protocol == "moteus" and identifier == 0x8000 | NODE:
        stops = data[:3] == bytes([1, 0, 0])  # one int8 register from 0 on, the mode: 0
        return "rests" if stops or data[0] & 0xf0 == 0x10 else "moves"
    if protocol == "mit" and identifier == NODE:
        return "rests" if data == bytes([0xff] * 7 + [0xfd]) else "moves"
    return None


class Bus:
    """The bus log: candump's, from its begin."""

    def __init__(self, protocol):
        self.protocol, self.path = protocol, pathlib.Path(f"{protocol}.log")
        self.log = self.path.open("wb")
        self.process = subprocess.Popen(["candump", "-L", INTERFACE], stdout=self.log)

    def verdicts(self, start=0):
        seen = []
        for line in self.path.read_text(encoding="ascii").splitlines()[start:]:
            frame = re.search(r" ([0-9A-F]+)(?:##.|#)([0-9A-F]*)", line)
            if frame:
                found = verdict(self.protocol, int(frame[1], 16), bytes.fromhex(frame[2]))
                if found:
                    seen.append((found, line))
        return seen

    def lines(self):
        return len(self.path.read_text(encoding="ascii").splitlines())

    def count(self, kind, start=0):
        return sum(found == kind for found, _ in self.verdicts(start))

    def wait(self, kind, count, start):
        limit = time.monotonic() + PATIENCE_S
        while self.count(kind, start) < count:
            if time.monotonic() > limit:
                fail(f"{self.protocol}: no {count} frames '{kind}' on the bus")
            time.sleep(0.1)

    def expect_rest(self, start, what):
        moving = [line for found, line in self.verdicts(start) if found == "moves"]
        if moving:
            fail(f"{self.protocol}, {what}: {len(moving)} frames that move, the first:\n{moving[0]}")

    def end(self):
        self.process.terminate()
        self.process.wait()
        self.log.close()


class Run:
    """A command of the page on a terminal of its own."""

    def __init__(self, command):
        self.text, self.command = "", command
        self.pid, self.terminal = pty.fork()
        if self.pid == 0:
            words = shlex.split(command)
            os.execv(TILLER, [TILLER, *words[1:], "--lockstep"])
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        """Until the other end of the terminal is closed."""
        while True:
            try:
                piece = os.read(self.terminal, 4096)
            except OSError:
                return
            if not piece:
                return
            self.text += piece.decode(errors="replace")

    def wait(self, what, start=0):
        limit = time.monotonic() + PATIENCE_S
        while not re.search(what, self.text[start:]):
            if time.monotonic() > limit or not self.reader.is_alive():
                fail(f"'{self.command}' does not say '{what}':\n{self.text[-3000:]}")
            time.sleep(0.05)

    def type(self, keys):
        start = len(self.text)
        os.write(self.terminal, keys.encode())
        return start

    def end(self):
        _, status = os.waitpid(self.pid, 0)
        self.reader.join(5)
        os.close(self.terminal)
        return os.waitstatus_to_exitcode(status)


def fail(text):
    print(f"FAILED: {text}", flush=True)
    sys.exit(1)


def expect(good, text):
    if not good:
        fail(text)


class Page:
    """What the page says, as far as a machine can do it."""

    def __init__(self):
        text = pathlib.Path(GUIDE).read_text(encoding="utf-8")
        self.step = steps(text)
        found = [number for number, body in self.step.items() if commands(body)]
        expect(found == WITH_COMMANDS, f"steps {found} of the page have commands, this test follows {WITH_COMMANDS}")
        self.command = {number: commands(self.step[number])[0] for number in found}
        self.arm = re.search(r"press `(.)`", self.step[10])[1]
        self.disarm = re.search(r"Press `(.)`: STANDBY", self.step[10])[1]
        self.exit_code = int(re.search(r"exit code (\d)", self.step[9])[1])
        self.fault = re.search(r"SAFE with `(\w+)`", self.step[9])[1]
        self.shows = re.search(r"The state is (\w+)", self.step[7])[1]
        self.record = re.search(r"--record (\S+)", self.command[10])[1]


class Robot:
    """Plant and drive; the bus log from before the run to now."""

    def __init__(self, bus):
        self.bus, self.start = bus, bus.lines()
        self.plant = subprocess.Popen([TILLER, "sim", "robot.toml", "--serve", "can", "--lockstep", "--seed", "1",
                                       "--answer-timeout", "20"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def unplug(self):
        if self.plant.poll() is None:
            self.plant.kill()
        self.plant.wait()

    def stand_by(self, page, command):
        """Starts the run; returns once it has stood by for a while, with nothing that moves on the bus."""
        run = Run(command)
        run.wait(page.shows)
        # it falls from 3.09 rad: what is shown first may come after that, what was seen stays
        run.wait(r"angle_rad +[+-]\d+\.\d+ rad +[+-]\d+\.\d+ rad/s +seen [+-]\d+\.\d+ \.\. \+3\.\d+")
        self.bus.wait("status", 25, self.start)
        self.bus.expect_rest(self.start, command)
        expect(self.bus.count("rests", self.start) > 0, f"{self.bus.protocol}: the run is not on the bus")
        return run


def look_at_sensors(page, bus):
    robot = Robot(bus)
    run = robot.stand_by(page, page.command[7])
    run.type("\x03")
    code = run.end()
    expect(code == 0, f"step 7 ends with {code}:\n{run.text[-2000:]}")
    robot.unplug()
    bus.expect_rest(robot.start, "step 7")


def pull_the_plug(page, bus):
    robot = Robot(bus)
    run = robot.stand_by(page, page.command[9])
    robot.unplug()
    run.wait(page.fault)
    code = run.end()
    expect(code == page.exit_code, f"step 9 ends with {code}, the page says {page.exit_code}")
    bus.expect_rest(robot.start, "step 9")


def arm_and_disarm(page, bus):
    robot = Robot(bus)
    run = robot.stand_by(page, page.command[10])
    armed_at = bus.lines()
    run.wait("ACTIVE", run.type(page.arm))
    bus.wait("moves", 10, armed_at)
    run.wait("STANDBY", run.type(page.disarm))
    disarmed_at = bus.lines()
    bus.wait("status", 20, disarmed_at)
    bus.expect_rest(disarmed_at + 20, "step 10, disarmed")
    run.type("\x03")
    code = run.end()
    expect(code == 0, f"step 10 ends with {code}:\n{run.text[-2000:]}")
    robot.unplug()
    done = subprocess.run([TILLER, "replay", page.record, "robot.toml"], capture_output=True, text=True, check=False)
    expect(done.returncode == 0 and re.search(r"\b0 different", done.stdout),
           f"the log of step 10 does not replay:\n{done.stdout}{done.stderr}")


def kill_and_start_again(page, bus):
    robot = Robot(bus)
    run = robot.stand_by(page, page.command[10])
    run.wait("ACTIVE", run.type(page.arm))
    os.kill(run.pid, signal.SIGKILL)
    run.end()
    robot.unplug()
    robot = Robot(bus)
    run = robot.stand_by(page, page.command[13])
    run.type("\x03")
    run.end()
    robot.unplug()
    bus.expect_rest(robot.start, "step 13")


def main():
    page = Page()
    for protocol in DRIVES:
        pathlib.Path("robot.toml").write_text(robot_file(protocol), encoding="utf-8")
        began = time.monotonic()
        bus = Bus(protocol)
        for follow in (look_at_sensors, pull_the_plug, arm_and_disarm, kill_and_start_again):
            follow(page, bus)
        bus.end()
        rests, moves = bus.count("rests"), bus.count("moves")
        print(f"{protocol}: {rests} frames at rest, {moves} that move, none of them before somebody armed "
              f"({time.monotonic() - began:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
