"""Logs as people have them, by the commands: columns at other rates, repeated messages, bags, ULog, and enemies."""

import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

from log_files import BagWriter, pyulog, rosbags, ulog_bytes

ROBOTS = Path(os.environ["TILLER_SOURCE"]) / "robots"
MASS, LENGTH, DAMPING, G, STEP = 0.5, 0.5, 0.05, 9.81, 5e-4
EPOCH = 1700000000 * 10**9


def command(t):
    return 1.2 * np.sin(2.2 * t) + 0.9 * np.sin(5.2 * t + 1) + 0.5 * np.sin(10.1 * t + 2)


def volts(t):
    """Of a supply that falls by a third in ten seconds."""
    return 12 - 0.4 * t


def swing(seconds: float, seed: int, supply=lambda t: 1.0) -> list:
    """(time, angle with 2 mrad of noise at 250 Hz, torque or None): the torque changes at 10 Hz, and acts in proportion
    to the supply."""
    noise, rows = np.random.default_rng(seed), []
    q = w = u = 0.0
    for i in range(round(seconds / STEP)):
        if i % 200 == 0:
            u = float(command(i * STEP))
        if i % 8 == 0:
            rows.append((i * STEP, q + 0.002 * noise.normal(), u if i % 200 == 0 else None))
        middle = q + 0.5 * STEP * w  # second order
        force = lambda rate: (u * supply(i * STEP) - DAMPING * rate - MASS * G * LENGTH * np.sin(middle)) / (MASS * LENGTH**2)
        change = STEP * force(w + 0.5 * STEP * force(w))
        q, w = q + STEP * (w + 0.5 * change), w + change
    return rows


def run(*arguments, code: int | None = 0) -> subprocess.CompletedProcess:
    done = subprocess.run([os.environ["TILLER_COMMAND"], *map(str, arguments)], capture_output=True, text=True, check=False,
                          env={**os.environ, "TILLER_PYTHON": sys.executable})
    assert code is None or done.returncode == code, (arguments, done.returncode, done.stdout[-2000:], done.stderr[-2000:])
    return done


class Commands(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.rows = swing(10, 1)
        self.plain = self.folder / "plain.csv"
        self.plain.write_text("time_s,angle_rad,torque_Nm\n" + "".join(
            f"{t:.4f},{q:.5f},{'' if u is None else f'{u:.6f}'}\n" for t, q, u in self.rows))

    def robot(self, log: str) -> Path:
        path = self.folder / "robot.toml"
        path.write_text((ROBOTS / "pendulum.toml").read_text() + "\n[log]\n" + log + "\n")
        return path

    def learnt(self, robot: Path, log: Path) -> dict:
        """Parameter -> (mean, sd), and the notes."""
        done = run("identify", robot, log, "--json")
        self.notes = done.stderr
        parameters = json.loads(done.stdout)["candidates"][-1]["parameters"]
        return {p["name"]: (p["mean"], p["sd"]) for p in parameters if p.get("sd")}  # a fixed one has none

    def check(self, learnt: dict):
        for name, truth in (("mass_kg", MASS), ("damping_Nms", DAMPING)):
            mean, sd = learnt[name]
            self.assertLess(abs(mean - truth), 4 * sd, (name, mean, sd))  # by chance in 1 of 16,000
            self.assertLess(sd, 0.2 * truth, name)

    def test_an_empty_cell_is_no_new_value(self):
        self.check(self.learnt(ROBOTS / "pendulum.toml", self.plain))
        self.assertIn("column 'torque_Nm' has a value in 100 of 2500 rows and holds in between", self.notes)

    def test_an_input_acts_in_proportion_to_a_column(self):
        rows = swing(10, 2, lambda t: volts(t) / 12)
        log = self.folder / "sag.csv"
        log.write_text("time_s,angle_rad,torque_Nm,volts\n" + "".join(
            f"{t:.4f},{q:.5f},{'' if u is None else f'{u:.6f}'},{volts(t):.3f}\n" for t, q, u in rows))
        without, _ = self.learnt(ROBOTS / "pendulum.toml", log)["mass_kg"]
        self.assertGreater(abs(without - MASS), 0.02, "the supply does not show in this motion")
        self.check(self.learnt(self.robot('schedule = { torque_Nm = { column = "volts", nominal = 12 } }'), log))
        self.assertIn("torque_Nm is taken 0.667 to 1 times, by column 'volts'", self.notes)
        for wrong, told in (('"volts"', "is not a column with its nominal value"),
                            ('{ column = "volts", nominal = 0 }', "has the nominal value 0"),
                            ('{ column = "volt", nominal = 12 }', "no column 'volt'")):
            done = run("identify", self.robot(f"schedule = {{ torque_Nm = {wrong} }}"), log, code=None)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(told, done.stderr)

    def test_a_dialect_changes_nothing(self):
        other = self.folder / "other.csv"
        text = self.plain.read_text().replace(",", ";").replace(".", ",")
        other.write_bytes(b"\xef\xbb\xbf" + text.encode())
        self.assertEqual(self.learnt(ROBOTS / "pendulum.toml", self.plain), self.learnt(ROBOTS / "pendulum.toml", other))
        self.assertIn("read with a byte order mark, semicolons, decimal commas", self.notes)

    @unittest.skipUnless(rosbags, "no Python package rosbags: ./dev setup installs it")
    def test_a_bag_is_the_same_log(self):
        bag = BagWriter(self.folder / "bag", "mcap")
        for t, q, u in self.rows:
            at = EPOCH + round(t * 1e9)
            if u is not None:
                bag.float64(at, u)
            bag.joint_state(at + 300000, at, ["hip", "knee"], [0.0, q])
        bag.close()
        robot = self.robot('columns = { angle_rad = "/joint_states.position[knee]", torque_Nm = "/command.data" }')
        self.check(self.learnt(robot, self.folder / "bag"))
        replayed = run("replay", self.folder / "bag", robot, "--tolerance", "1e6")
        self.assertIn("500 ticks replayed", replayed.stdout)
        self.assertIn("neither states nor iterations", replayed.stdout)
        wrong = run("identify", self.robot('columns = { angle_rad = "/joint_state.position[knee]" }'), self.folder / "bag",
                    code=1)
        self.assertIn("did you mean '/joint_states.position[knee]'?", wrong.stderr)
        self.assertIn("/command (std_msgs/msg/Float64, 100): data", wrong.stderr)

    @unittest.skipUnless(pyulog, "no Python package pyulog: ./dev setup installs it")
    def test_a_ulog_is_the_same_log(self):
        messages = []
        for t, q, u in self.rows:
            at = 5000000 + round(t * 1e6)
            messages += [("motor", 0, "Qf", (at, u))] if u is not None else []
            messages.append(("angles", 0, "QQff", (at + 200, at, 0.0, q)))
        (self.folder / "flight.ulg").write_bytes(ulog_bytes(
            {"angles": "uint64_t timestamp;uint64_t timestamp_sample;float[2] q", "motor": "uint64_t timestamp;float u"},
            messages))
        robot = self.robot('columns = { angle_rad = "angles.q[1]", torque_Nm = "motor.u" }')
        self.check(self.learnt(robot, self.folder / "flight.ulg"))

    @unittest.skipUnless(pyulog, "no Python package pyulog: ./dev setup installs it")
    def test_a_topic_of_its_own_rate_is_a_schedule(self):
        messages = []
        for i, (t, q, u) in enumerate(swing(10, 3, lambda t: volts(t) / 12)):
            at = 5000000 + round(t * 1e6)
            messages += [("motor", 0, "Qf", (at, u))] if u is not None else []
            messages += [("battery", 0, "Qf", (at + 70, volts(t)))] if i % 250 == 0 else []
            messages.append(("angles", 0, "Qf", (at, q)))
        (self.folder / "flight.ulg").write_bytes(ulog_bytes(
            {"motor": "uint64_t timestamp;float u", "angles": "uint64_t timestamp;float q",
             "battery": "uint64_t timestamp;float volts"}, messages))
        robot = self.robot('columns = { angle_rad = "angles.q", torque_Nm = "motor.u" }\n'
                           'schedule = { torque_Nm = { column = "battery.volts", nominal = 12 } }')
        self.check(self.learnt(robot, self.folder / "flight.ulg"))

    def test_a_message_that_came_again_counts_once(self):
        """As from a plant in lockstep whose answer was lost: replay, gap and identify say of it what they said before."""
        whole, repeated = self.folder / "run.lcm", self.folder / "again.lcm"
        robot = ROBOTS / "pendulum.toml"
        run("run", robot, "--sim", "--seconds", "6", "--quiet", "--record", whole)
        bytes_, events, at = whole.read_bytes(), [], 0
        while at < len(bytes_):
            _, _, stamp, name, size = struct.unpack(">IQQII", bytes_[at:at + 28])
            events.append((stamp, bytes_[at + 28:at + 28 + name], bytes_[at + 28 + name:at + 28 + name + size]))
            at += 28 + name + size
        asked = [i for i, e in enumerate(events) if e[1].endswith(b"MEASUREMENT")][100]
        told = next(i for i in range(asked, len(events)) if events[i][1].endswith(b"COMMAND"))
        events[told + 1:told + 1] = [events[asked], events[told]]
        repeated.write_bytes(b"".join(struct.pack(">IQQII", 0xEDA1DA01, n, t, len(c), len(d)) + c + d
                                      for n, (t, c, d) in enumerate(events)))
        self.assertEqual(run("replay", whole, robot).stdout, run("replay", repeated, robot).stdout)
        self.assertEqual(self.learnt(robot, whole), self.learnt(robot, repeated))
        verdicts = [json.loads(run("gap", robot, log, "--json", code=None).stdout) for log in (whole, repeated)]
        for key in ("verdict", "reasons", "ranking"):
            self.assertEqual(verdicts[0].get(key), verdicts[1].get(key), key)

    def test_enemies_are_told_by_their_names(self):
        robot = ROBOTS / "pendulum.toml"
        enemies = {"empty.csv": (b"", "the file is empty"), "empty.ulg": (b"", "the file is empty"),
                   "words.csv": (b"not a log at all\n", "no column 'time_s'"),
                   "utf16.csv": ("time_s,angle_rad\n".encode("utf-16"), "UTF-16"),
                   "zeros.lcm": (b"\xed\xa1\xda\x01" + bytes(10), "no messages on channel TILLER_MEASUREMENT"),
                   "head.rec": (b"TILLREC2", "is no record of tiller"),
                   "head.mcap": (b"\x89MCAP0\r\n", "cannot be read")}
        for name, (content, said) in enemies.items():
            path = self.folder / name
            path.write_bytes(content)
            for told in (run("identify", robot, path, code=1).stderr, run("gap", robot, path, code=3).stdout):
                self.assertIn(name, told)
                self.assertIn(said, told)
            self.assertIn(name, run("replay", path, robot, code=1).stderr)
        self.assertIn("folder", run("identify", robot, self.folder, code=1).stderr)
        self.assertIn("No such file", run("identify", robot, self.folder / "none.bag", code=1).stderr)
        if os.geteuid() != 0:
            self.plain.chmod(0)
            self.assertIn("Permission denied", run("identify", robot, self.plain, code=1).stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
