"""ROS bags and ULog: fields of messages with their stamps; clocks that jump, stamps that repeat, files that are damaged."""

import os
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

from log_files import NS, BagWriter, pyulog, rosbags, ulog_bytes  # noqa: E402
from tiller_tools import channels, table  # noqa: E402

KNEE, COMMAND = "/joint_states.position[knee]", "/command.data"
EPOCH = 1700000000 * NS + 123


class Folder(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def read(self, path: Path, *columns: str) -> dict:
        """Column -> (times, values)."""
        _, clocks, found, _, self.problems, self.note = channels.read(str(path), list(columns))
        return {name: (clocks[clock], values) for name, clock, values in found}

    def refused(self, path: Path, *columns: str) -> str:
        with self.assertRaises(table.ReportError) as caught:
            self.read(path, *columns)
        self.assertIn(str(path), str(caught.exception))
        return str(caught.exception)


@unittest.skipUnless(rosbags, "no Python package rosbags: ./dev setup installs it")
class Bags(Folder):
    def write(self, kind: str, stamps: list, receipts: list | None = None) -> Path:
        """Joint states with header stamps in ms, received 1 ms later unless said otherwise; commands without a header,
        received 4, 14 and 24 ms after the first of them."""
        path = self.folder / (kind + (".bag" if kind == "bag1" else ""))
        bag = BagWriter(path, kind)
        receipts = receipts if receipts is not None else [t + 1 for t in stamps]
        for k, (stamp, receipt) in enumerate(zip(stamps, receipts)):
            bag.joint_state(EPOCH + receipt * 10**6, EPOCH + stamp * 10**6, ["hip", "knee"], [-1.0, float(k)])
        for k in range(3):
            bag.float64(EPOCH + (10 * k + 4 + receipts[0]) * 10**6, 0.5 * k)
        bag.topic("/empty", "std_msgs/msg/Float64")
        bag.close()
        return path

    def test_every_kind_of_bag_gives_the_same(self):
        for kind in ("bag1", "bag2", "mcap"):
            path = self.write(kind, [0, 10, 20, 30])
            files = [path] if path.is_file() else [path, next(f for f in path.iterdir() if f.suffix in (".db3", ".mcap"))]
            for file in files:
                with self.subTest(file=file.name, kind=kind):
                    columns = self.read(file, KNEE, "joint_states.position[0]", "/command.data")
                    np.testing.assert_allclose(columns[KNEE][0], [0, 0.01, 0.02, 0.03], atol=1e-9)
                    np.testing.assert_allclose(columns[KNEE][1], [0, 1, 2, 3])
                    np.testing.assert_allclose(columns["joint_states.position[0]"][1], -1)
                    np.testing.assert_allclose(columns[COMMAND][0], [0.005, 0.015, 0.025], atol=1e-9)
                    self.assertEqual(self.problems, {})
                    self.assertEqual(self.note, "stamps are header stamps, of /command times of receipt")

    def test_a_name_that_is_wrong_is_answered_by_what_is_there(self):
        path = self.write("bag1", [0, 10])
        self.read(path, "/joint_state.position[knee]", "/empty.data", "/joint_states.position[ankle]", "torque")
        self.assertIn("did you mean '/joint_states.position[knee]'", self.problems["/joint_state.position[knee]"])
        self.assertIn("/joint_states (sensor_msgs/msg/JointState, 2): position[hip], position[knee]",
                      self.problems["/joint_state.position[knee]"])
        self.assertIn("/empty has no message", self.problems["/empty.data"])
        self.assertIn("no message of /joint_states has a field position[ankle]",
                      self.problems["/joint_states.position[ankle]"])
        self.assertIn("no such field", self.problems["torque"])

    def test_two_nodes_may_publish_one_topic(self):
        path = self.folder / "two.bag"
        bag = BagWriter(path, "bag1")
        for k in range(8):
            name = ("hip", "knee")[k % 2]
            bag.joint_state(EPOCH + k * 10**7, EPOCH + k * 10**7, [name], [float(k)])
        bag.close()
        times, values = self.read(path, KNEE)[KNEE]
        np.testing.assert_allclose(values[~np.isnan(values)], [1, 3, 5, 7])
        np.testing.assert_allclose(times[~np.isnan(values)], [0.01, 0.03, 0.05, 0.07], atol=1e-9)

    def test_stamps(self):
        """What is defined for clocks and orders: stamps and receipts in ms; times, values, the commands' times after the
        first joint state, and the note."""
        hour = 3600000
        at_once = [5, 15, 25]
        table_of_stamps = [
            ("one clock", [0, 10, 20, 30], None, [0, 10, 20, 30], [0, 1, 2, 3], at_once,
             "stamps are header stamps, of /command times of receipt"),
            ("out of order", [0, 20, 10, 30], [1, 21, 22, 31], [0, 10, 20, 30], [0, 2, 1, 3], at_once, "1 messages of /joint_"),
            ("one stamp twice", [0, 10, 10, 20], [1, 11, 12, 21], [0, 10, 20], [0, 2, 3], at_once, "the next one, which co"),
            ("simulated time", [0, 20, 40, 60], [hour + k for k in (0, 10, 20, 30)], [0, 20, 40, 60], [0, 1, 2, 3],
             [8, 28, 48], "put on the clock of /joint_states"),
            ("a paused simulation", [0, 10, 20, 30], [0, 10, hour, hour + 10], [0, 10, 20, 30], [0, 1, 2, 3], None,
             "put on the clock of /joint_states"),
            ("the clock was set ahead", [0, 10, hour + 20, hour + 30], [1, 11, 21, 31], [0, 10, 20, 30], [0, 1, 2, 3],
             [4, 14, 24], "times of receipt: header stamps are of several clocks, or their clock was set"),
            ("the clock was set back", [hour, hour + 10, 20, 30], [1, 11, 21, 31], [0, 10, 20, 30], [0, 1, 2, 3],
             [4, 14, 24], "or their clock was set"),
            ("time jumps ahead", [0, 10, hour, hour + 10], None, [0, 10, hour, hour + 10], [0, 1, 2, 3], at_once,
             "stamps are header stamps"),
        ]
        for name, stamps, receipts, times, after, commands, said in table_of_stamps:
            with self.subTest(name):
                shutil.rmtree(self.folder / "bag2", ignore_errors=True)
                columns = self.read(self.write("bag2", stamps, receipts), KNEE, COMMAND)
                self.assertEqual(min(c[0][0] for c in columns.values()), 0)
                zero = columns[KNEE][0][0]
                np.testing.assert_allclose(columns[KNEE][0] - zero, np.array(times) * 1e-3, atol=1e-9)
                np.testing.assert_allclose(columns[KNEE][1], after)
                if commands:
                    np.testing.assert_allclose(columns[COMMAND][0] - zero, np.array(commands) * 1e-3, atol=1e-9)
                self.assertIn(said, self.note)

    def test_headers_of_two_clocks(self):
        path = self.folder / "two.bag"
        bag = BagWriter(path, "bag1")
        for k in range(6):
            at = EPOCH + k * 10**7
            bag.joint_state(at + 10**6, at, ["knee"], [float(k)])
            bag.imu(at + 2 * 10**6, 77 * NS + k * 10**7, 1.0)  # since the sensor was switched on
        bag.close()
        columns = self.read(path, KNEE, "/imu.angular_velocity.z")
        np.testing.assert_allclose(columns["/imu.angular_velocity.z"][0] - columns[KNEE][0], 1e-3, atol=1e-9)
        self.assertIn("of several clocks", self.note)

    def test_damaged_files_are_told(self):
        whole = self.write("bag1", [0, 10, 20]).read_bytes()
        for size in (13, 100, 4200, len(whole) - 10):
            (self.folder / "cut.bag").write_bytes(whole[:size])
            self.assertIn("cannot be read as a ROS bag", self.refused(self.folder / "cut.bag", KNEE))
        folder = self.write("bag2", [0, 10, 20])
        database = next(folder.glob("*.db3"))
        database.write_bytes(database.read_bytes()[:5000])
        self.assertIn("cannot be read as a ROS bag", self.refused(folder, KNEE))
        mcap = next(self.write("mcap", [0, 10, 20]).glob("*.mcap"))
        mcap.write_bytes(mcap.read_bytes()[:-40])
        self.assertIn("cut off", self.refused(mcap, KNEE))


FORMATS = {"angles": "uint64_t timestamp;uint64_t timestamp_sample;float[2] q", "motor": "uint64_t timestamp;float u"}


@unittest.skipUnless(pyulog, "no Python package pyulog: ./dev setup installs it")
class ULog(Folder):
    def write(self, messages: list) -> Path:
        path = self.folder / "flight.ulg"
        path.write_bytes(ulog_bytes(FORMATS, messages))
        return path

    def flight(self) -> Path:
        messages = []
        for k in range(20):
            at = 5000000 + 10000 * k
            messages.append(("angles", 0, "QQff", (at + 700, at, 0.0, 0.5 * k)))
            messages.append(("motor", k % 2, "Qf", (at + 900, 0.25 * k)))
        return self.write(messages)

    def test_fields_instances_and_stamps(self):
        columns = self.read(self.flight(), "angles.q[1]", "motor.u", "motor[1].u")
        np.testing.assert_allclose(columns["angles.q[1]"][0], 0.01 * np.arange(20), atol=1e-9)
        np.testing.assert_allclose(columns["angles.q[1]"][1], 0.5 * np.arange(20))
        np.testing.assert_allclose(columns["motor[1].u"][0], 0.0109 + 0.02 * np.arange(10), atol=1e-9)
        np.testing.assert_allclose(columns["motor[1].u"][1], 0.25 + 0.5 * np.arange(10))
        self.assertEqual(self.note, "stamps are timestamp_sample, of motor, motor[1] timestamp")

    def test_a_name_that_is_wrong_is_answered_by_what_is_there(self):
        self.read(self.flight(), "angles.q[7]", "speed.x")
        self.assertIn("angles (ULog, 20): timestamp, timestamp_sample, q[0], q[1]", self.problems["angles.q[7]"])
        self.assertIn("no such field", self.problems["speed.x"])

    def test_time_that_goes_back_is_refused(self):
        path = self.write([("motor", 0, "Qf", (at, 0.5)) for at in (8000000, 8010000, 1000000, 1010000)])
        self.assertIn("the time of motor goes back by 7.01 s at its message 3", self.refused(path, "motor.u"))

    def test_cut_anywhere_it_is_read_as_far_as_it_goes_or_refused(self):
        whole = self.flight().read_bytes()
        cut = self.folder / "cut.ulg"
        rows = 0
        for size in range(16, len(whole), 37):
            cut.write_bytes(whole[:size])
            try:
                columns = self.read(cut, "angles.q[1]")
            except table.ReportError as error:
                self.assertIn("cut.ulg", str(error))
                continue
            got = len(columns["angles.q[1]"][0]) if columns else 0
            self.assertGreaterEqual(got, rows)
            rows = got
        self.assertGreaterEqual(rows, 18)


class Packages(Folder):
    def test_a_package_that_lacks_is_told_with_the_way_to_get_it(self):
        """As on a machine without them: the interpreter finds no such package."""
        for name, first, package in (("a.bag", b"#ROSBAG V2.0\n", "rosbags"), ("a.ulg", b"ULog\x01\x12\x35", "pyulog")):
            path = self.folder / name
            path.write_bytes(first)
            hidden = {key: sys.modules.pop(key) for key in list(sys.modules) if key.split(".")[0] == package}
            sys.modules[package] = None
            try:
                self.assertIn(f"{sys.executable} -m pip install {package}", self.refused(path, "x"))
            finally:
                del sys.modules[package]
                sys.modules.update(hidden)


if __name__ == "__main__":
    unittest.main(verbosity=2)
