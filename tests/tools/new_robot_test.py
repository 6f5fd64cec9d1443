"""new_robot_test.py [arm]: `tiller new` on a terminal and without one; what it writes runs at once."""

import os
import pathlib
import pty
import re
import subprocess
import sys
import tempfile
import tomllib
import unittest

TILLER = os.environ["TILLER_COMMAND"]
ARM = pathlib.Path(os.environ["TILLER_SOURCE"]) / "examples/from_urdf/my_arm.urdf"
MECHANISMS = ["acrobot", "cart_pole", "furuta", "hopper", "pendulum", "planar_quadrotor", "two_link_arm"]
SLOW = "arm" in sys.argv[1:]


class New(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self._folder.name)

    def tearDown(self):
        self._folder.cleanup()

    def tiller(self, *arguments):
        return subprocess.run([TILLER, *map(str, arguments)], cwd=self.folder, capture_output=True, text=True,
                              stdin=subprocess.DEVNULL, timeout=600, check=False)

    def on_terminal(self, answers, *arguments):
        """Exit code and what the terminal showed; the answers are typed after each question."""
        ours, theirs = pty.openpty()
        child = subprocess.Popen([TILLER, "new", *arguments], cwd=self.folder, stdin=theirs, stdout=theirs,
                                 stderr=theirs)
        os.close(theirs)
        shown, left = "", list(answers)
        while True:
            try:
                piece = os.read(ours, 4096).decode()
            except OSError:  # the other end is closed
                break
            if not piece:
                break
            shown += piece
            if shown.endswith("]: ") and left:
                answer = left.pop(0) + "\n"
                shown += " "  # a question is answered once
                os.write(ours, answer.encode())
        os.close(ours)
        self.assertEqual(left, [], shown)
        return child.wait(), shown

    def robot(self, name):
        return tomllib.loads((self.folder / name / "robot.toml").read_text(encoding="utf-8"))

    def runs(self, name, seconds="0.5"):
        done = self.tiller("run", f"{name}/robot.toml", "--sim", "--quiet", "--seconds", seconds)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertIn("ended in ACTIVE", done.stdout)


@unittest.skipIf(SLOW, "the arm alone")
class Built(New):
    def test_enter_five_times(self):
        code, shown = self.on_terminal([""] * 5, "mine")
        self.assertEqual(code, 0, shown)
        for number in range(1, 6):
            self.assertIn(f"{number}. ", shown)
        self.assertEqual(self.robot("mine")["robot"]["name"], "mine")
        self.runs("mine")

    def test_answers_and_wrong_ones(self):
        sensors = "position_m=0.001, angle_rad=0.003, rate_rad_s=0.05"
        code, shown = self.on_terminal(["cartpole", "cart_pole", "angle=0.1", sensors, "force_N=12..-12", "force_N=12",
                                        "fast", "0.01", "none"], "pole")
        self.assertEqual(code, 0, shown)
        self.assertIn("is cart_pole meant?", shown)
        self.assertIn("is angle_rad meant?", shown)
        self.assertIn("LOW..HIGH", shown)
        self.assertIn("a period is a number of seconds", shown)
        robot = self.robot("pole")
        self.assertEqual(robot["model"]["period_s"], 0.01)
        self.assertEqual(robot["planner"]["horizon"], 100, "a second ahead, as before")
        self.assertEqual(robot["planner"]["deadline_us"], 6000)
        self.assertEqual(robot["measurement"]["angle_rad"], {"sd": 0.003})
        self.assertEqual(robot["measurement"]["position_m"], {"sd": 0.001, "low": -3, "high": 3}, "the rest stays")
        self.assertEqual(robot["measurement"]["rate_rad_s"], {"sd": 0.05})
        self.assertEqual(robot["limits"]["force_N"], {"low": -12, "high": 12, "rate_per_s": 1000, "safe": 0})
        self.assertEqual(robot["sim"]["sensors"]["rate_rad_s"], {"sd": 0.05})
        self.assertNotIn("transport", robot)
        self.runs("pole")

    def test_options_ask_for_nothing(self):
        for mechanism in MECHANISMS:
            done = self.tiller("new", mechanism, "--mechanism", mechanism, "--transport", "can")
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            self.assertNotIn("]: ", done.stdout)
            self.assertEqual(self.robot(mechanism)["transport"]["kind"], "socketcan")
            self.runs(mechanism, "0.2")

    def test_half_by_options_half_by_hand(self):
        code, shown = self.on_terminal(["", "", ""], "arm", "--mechanism", "two_link_arm", "--period", "0.02")
        self.assertEqual(code, 0, shown)
        self.assertEqual(re.findall(r"(\d)\. ", shown), ["2", "3", "5"])
        self.assertEqual(self.robot("arm")["model"]["period_s"], 0.02)

    def test_what_is_wrong_is_told_and_nothing_is_written(self):
        for option, value, says in (("--mechanism", "robotarm", "none of acrobot"),
                                    ("--sensors", "angle_rad", "write angle_rad=SD"),
                                    ("--sensors", "angle_rad=-1", "above 0"),
                                    ("--limits", "force_N=1", "none of torque_Nm"),
                                    ("--period", "7", "0.0001 to 1"), ("--transport", "ethernet", "none of lcm")):
            done = self.tiller("new", "wrong", option, value)
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn(option, done.stderr)
            self.assertIn(says, done.stderr)
            self.assertFalse((self.folder / "wrong/robot.toml").exists())

    def test_a_file_that_is_there_stays(self):
        self.assertEqual(self.tiller("new", "twice").returncode, 0)
        done = self.tiller("new", "twice")
        self.assertEqual(done.returncode, 1)
        self.assertIn("--force", done.stderr)
        self.assertEqual(self.tiller("new", "twice", "--force", "--period", "0.01").returncode, 0)
        self.assertEqual(self.robot("twice")["model"]["period_s"], 0.01)


@unittest.skipUnless(SLOW, "its model is compiled")
class Described(New):
    def test_a_description(self):
        done = self.tiller("new", "my_arm", "--mechanism", ARM, "--limits", "turret_Nm=3", "--sensors",
                           "turret_rad=0.001, shoulder_rad=0.001, elbow_rad=0.001", "--transport", "lcm")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        robot = self.robot("my_arm")
        self.assertEqual(robot["limits"]["turret_Nm"], {"low": -3, "high": 3, "safe": 0})
        self.assertEqual(robot["sim"]["sensors"]["elbow_rad"], {"sd": 0.001})
        self.assertEqual(robot["transport"]["kind"], "lcm")
        self.runs("my_arm")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
