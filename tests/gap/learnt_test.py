"""`tiller gap` where the missing force has no name: what it learns is written, loads, and beats the robot without it on
a log that it has never seen. Where the laboratory is not installed, nine weights are offered, and that is said."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

os.environ.setdefault("TILLER_ROBOTS", "")
sys.path.insert(0, str(Path(__file__).parent))

from command_test import ROBOT, TILLER, simulate, write_log  # noqa: E402


def spring_with_a_gap(angle: float, _rate: float) -> float:
    """Nm: nothing within 0.25 rad, then 4 Nm/rad."""
    return -4.0 * (max(angle - 0.25, 0.0) + min(angle + 0.25, 0.0))


def gap(*arguments, **environment) -> subprocess.CompletedProcess:
    return subprocess.run([TILLER, "gap", *map(str, arguments)], capture_output=True, text=True, timeout=900,
                          check=False, env=dict(os.environ, **environment))


def without_laboratory(home: Path) -> str:
    """An interpreter for which no laboratory is installed."""
    path = home / "python_without"
    path.write_text(f"#!/bin/sh\ncase $2 in tiller_tools.laboratory) exit 1;; esac\nexec {sys.executable} \"$@\"\n")
    path.chmod(0o755)
    return str(path)


class Learnt(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.home = Path(tempfile.mkdtemp())
        cls.robot = cls.home / "arm.toml"
        cls.robot.write_text(ROBOT)
        logs = [write_log(cls.home / f"log_{i}.csv", simulate(i, 0.0, force=spring_with_a_gap)) for i in range(6)]
        cls.unseen = [write_log(cls.home / f"unseen_{i}.csv", simulate(50 + i, 0.0, force=spring_with_a_gap))
                      for i in range(2)]
        cls.out = cls.home / "out"
        cls.logs = logs
        cls.found = gap(cls.robot, *logs, "-o", cls.out)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.home, ignore_errors=True)

    def test_the_learnt_force_is_offered(self):
        self.assertEqual(self.found.returncode, 2, self.found.stdout + self.found.stderr)
        self.assertIn("forces at all joints were learnt", self.found.stdout)
        self.assertIn("learning what is left at all joints", self.found.stderr)
        self.assertTrue((self.out / "arm_gap_network.json").exists())
        self.assertIn('"arm_gap_network.json"', (self.out / "arm_gap.toml").read_text())
        check = subprocess.run([TILLER, "check", str(self.out / "arm_gap.toml")], capture_output=True, text=True,
                               check=False)
        self.assertEqual(check.returncode, 0, check.stdout + check.stderr)

    def test_nine_weights_are_offered_where_the_laboratory_is_not_installed(self):
        out = self.home / "without"
        found = gap(self.robot, *self.logs, "-o", out, TILLER_PYTHON=without_laboratory(self.home))
        self.assertIn("pip install 'tiller[labs]'", found.stderr)
        self.assertIn('kind = "residual"', (out / "arm_gap.toml").read_text())
        self.assertFalse((out / "arm_gap_network.json").exists())

    def test_the_new_file_is_nearer_to_a_log_that_it_has_never_seen(self):
        """Judged by its rollouts before anything is added to it. The held-out part of the logs says a third."""
        def error_of(robot):
            run = gap(robot, *self.unseen, "--budget", 1, "--max-effects", 1, "--json")
            one_second = [h for h in json.loads(run.stdout)["horizons"] if abs(h["seconds"] - 1.0) < 0.1]
            return one_second[0]["before_sigma"]

        self.assertLess(error_of(self.out / "arm_gap.toml"), 0.5 * error_of(self.robot))


if __name__ == "__main__":
    unittest.main(verbosity=2)
