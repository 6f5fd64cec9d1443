"""Converters of measured data: files in the published layout, made here, come out as logs in SI units."""

import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

import scipy.io

TOOLS = pathlib.Path(__file__).resolve().parents[2] / "tools/python"


def convert(*arguments):
    return subprocess.run([sys.executable, "-m", "tiller_tools.convert", *map(str, arguments)], cwd=TOOLS,
                          capture_output=True, text=True, check=False)


def columns_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [float(r[name]) for r in rows] for name in rows[0]}


class Emps(unittest.TestCase):
    def test_volts_become_force(self):
        with tempfile.TemporaryDirectory() as folder:
            home = pathlib.Path(folder)
            scipy.io.savemat(home / "DATA_EMPS.mat", {
                "t": [[0.0], [0.001]], "qm": [[0.1], [0.2]], "qg": [[0.3], [0.4]], "vir": [[2.0], [-1.0]], "gtau": 35.0})
            done = convert("emps", home, home / "out")
            self.assertEqual(done.returncode, 0, done.stderr)
            log = columns_of(home / "out/emps.csv")
            self.assertEqual(log["force_N"], [70.0, -35.0])
            self.assertEqual(log["position_m"], [0.1, 0.2])

    def test_missing_file_is_named(self):
        with tempfile.TemporaryDirectory() as folder:
            done = convert("emps", folder, folder)
            self.assertEqual(done.returncode, 1)
            self.assertIn("DATA_EMPS.mat", done.stderr)


class Xl330(unittest.TestCase):
    def test_duty_has_its_sign_and_rows_without_torque_are_left_out(self):
        entry = {"position": 0.1, "speed": 1.0, "input_volts": 8.0, "goal_position": 0.2}
        with tempfile.TemporaryDirectory() as folder:
            home = pathlib.Path(folder)
            (home / "a.json").write_text(json.dumps({"kp": 100, "trajectory": "sin_sin", "entries": [
                {**entry, "load": 177, "timestamp": 0.0, "torque_enable": True},
                {**entry, "load": 65536 - 177, "timestamp": 0.005, "torque_enable": True},
                {**entry, "load": 65536 - 900, "timestamp": 0.01, "torque_enable": True},
                {**entry, "load": 0, "timestamp": 0.015, "torque_enable": False}]}), encoding="utf-8")
            done = convert("xl330", home, home)
            self.assertEqual(done.returncode, 0, done.stderr)
            log = columns_of(home / "xl330_kp100_sin_sin.csv")
            self.assertEqual(log["duty"], [0.2, -0.2, -1.0])
            for measured, expected in zip(log["torque_Nm"], [0.2 * 8 * 0.104, -0.2 * 8 * 0.104, -8 * 0.104]):
                self.assertAlmostEqual(measured, expected, places=9)


class Tx40(unittest.TestCase):
    HEADER = "Joint_1,Joint_2,Joint_3,Joint_4,Joint_5,Joint_6\n"

    def convert(self, positions, torques):
        """(the process, the log's columns) of rows of motors' positions and torques."""
        with tempfile.TemporaryDirectory() as folder:
            home = pathlib.Path(folder)
            for name, rows in (("pos_read_data.csv", positions), ("curr_data.csv", torques)):
                lines = "".join(",".join(map(str, row)) + "\n" for row in rows)
                (home / name).write_text(self.HEADER + lines, encoding="utf-8")
            (home / "tx40_mdh_modified.urdf").write_text("<robot name='staubli_tx40'/>", encoding="utf-8")
            done = convert("tx40", home, home / "out")
            if done.returncode != 0:
                return done, {}
            self.assertEqual((home / "out/tx40.urdf").read_text(encoding="utf-8"), "<robot name='staubli_tx40'/>")
            self.assertTrue((home / "out/tx40.toml").exists())
            return done, columns_of(home / "out/tx40.csv")

    def test_motors_become_joints(self):
        rows = [[32.0, 16.0, -45.0, 48.0, 90.0, 96.0]] * 50
        done, log = self.convert(rows, [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]] * 50)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(log["time_s"], [0.0, 0.005])
        half_turn = math.pi / 2
        # motor 6 turns by 32 (q5 + q6)
        for joint, wanted in enumerate([1.0, 0.5 - half_turn, -1.0 + half_turn, -1.0, 2.0, 1.0]):
            self.assertAlmostEqual(log[f"joint_{joint + 1}_rad"][1], wanted, places=7)
        # the motors' power is the joints': torque 5 gets what motor 6 does when joint 5 turns
        for joint, wanted in enumerate([32.0, 64.0, 135.0, -192.0, 225.0 + 192.0, 192.0]):
            self.assertAlmostEqual(log[f"joint_{joint + 1}_Nm"][1], wanted, places=7)

    def test_torque_is_the_mean_to_the_next_row(self):
        rows = [[0.0] * 6] * 50
        done, log = self.convert(rows, [[float(k)] + [0.0] * 5 for k in range(50)])
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(log["joint_1_Nm"], [32 * 12.0, 32 * 37.0])

    def test_what_is_no_number_is_named_by_line(self):
        rows = [[0.0] * 6] * 30
        done, _ = self.convert(rows, rows[:3] + [[0.0] * 5 + ["nan"]] + rows[4:])
        self.assertEqual(done.returncode, 1)
        self.assertIn("curr_data.csv:5", done.stderr)
        done, _ = self.convert(rows[:3] + [[0.0] * 5] + rows[4:], rows)
        self.assertIn("pos_read_data.csv:5", done.stderr)

    def test_files_of_two_runs_are_refused(self):
        done, _ = self.convert([[0.0] * 6] * 50, [[0.0] * 6] * 49)
        self.assertEqual(done.returncode, 1)
        self.assertIn("not of one run", done.stderr)


if __name__ == "__main__":
    unittest.main()
