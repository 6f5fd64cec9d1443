"""Converters of measured data: files in the published layout, made here, come out as logs in SI units."""

import csv
import json
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


if __name__ == "__main__":
    unittest.main()
