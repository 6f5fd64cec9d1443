"""arm_over_lcm_test.py TILLER ROBOT PYTHON_EXAMPLES: `tiller run` over LCM without a terminal stands by, a message arms
and disarms it, --arm moves at once, and what was recorded replays to the last bit. To be run in a network namespace of
its own, with the packages lcm and tiller_lcm.
"""

import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

TILLER, ROBOT, EXAMPLES = sys.argv[1:]
PATIENCE_S = 120
SMALL = {"horizon": 10, "knots": 5, "rollouts": 16, "iterations": 1, "sensor_timeout_s": 20}  # any machine keeps up


class Run:
    def __init__(self, folder, *options):
        self.process = subprocess.Popen([TILLER, "run", "robot.toml", *options], cwd=folder, stdin=subprocess.DEVNULL,
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.lines = []
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        self.lines.extend(iter(self.process.stdout.readline, ""))

    def wait(self, what, after=0):
        limit = time.monotonic() + PATIENCE_S
        while not any(re.search(what, line) for line in self.lines[after:]):
            if time.monotonic() > limit or (self.process.poll() is not None and not self.reader.is_alive()):
                raise AssertionError(f"no '{what}' in:\n{''.join(self.lines[-20:])}")
            time.sleep(0.05)
        return len(self.lines)

    def end(self):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE_S)
        self.reader.join(PATIENCE_S)
        self.process.stdout.close()
        return self.process.returncode


class ArmOverLcm(unittest.TestCase):
    def setUp(self):
        home = tempfile.TemporaryDirectory()
        self.addCleanup(home.cleanup)
        self.folder = pathlib.Path(home.name)
        text = pathlib.Path(ROBOT).read_text(encoding="utf-8")
        for key, value in SMALL.items():
            text = re.sub(rf"^{key} = .*", f"{key} = {value}", text, flags=re.MULTILINE)
        (self.folder / "robot.toml").write_text(f'{text}\n[transport]\nkind = "lcm"\n', encoding="utf-8")
        plant = subprocess.Popen([TILLER, "sim", "robot.toml", "--serve", "lcm", "--seed", "1"], cwd=self.folder,
                                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.addCleanup(plant.wait)
        self.addCleanup(plant.kill)

    def say(self, *options):
        subprocess.run([sys.executable, f"{EXAMPLES}/arm.py", *options], check=True, timeout=PATIENCE_S)

    def test_a_message_arms_and_disarms(self):
        run = Run(self.folder, "--record", "run.mcap")
        run.wait(r"STANDBY: nothing moves\. To arm: a message arm_t on the LCM channel TILLER_ARM")
        seen = run.wait(r"STANDBY .*angle_rad [+-]\d+\.\d+ rad")
        self.assertFalse([line for line in run.lines if "ACTIVE" in line])
        self.say()
        run.wait("armed", seen)
        seen = run.wait("ACTIVE", seen)
        self.say("--disarm")
        run.wait("disarmed: STANDBY", seen)
        self.assertEqual(run.end(), 0, "".join(run.lines[-20:]))
        run.wait("arm messages: 2 taken")
        replay = subprocess.run([TILLER, "replay", "run.mcap", "robot.toml"], cwd=self.folder, capture_output=True,
                                text=True, check=False)
        self.assertEqual(replay.returncode, 0, replay.stdout + replay.stderr)

    def test_arm_on_the_command_line_moves_at_once(self):
        run = Run(self.folder, "--arm", "--seconds", "1")
        run.wait("ACTIVE")
        run.process.wait(PATIENCE_S)
        run.end()
        self.assertFalse([line for line in run.lines if "STANDBY" in line])

    def test_without_anybody_it_ends_where_it_began(self):
        run = Run(self.folder, "--seconds", "1")
        run.wait("never armed: nothing was moved")
        run.process.wait(PATIENCE_S)
        self.assertEqual(run.end(), 0)
        self.assertFalse([line for line in run.lines if "ACTIVE" in line])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
