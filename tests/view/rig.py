"""A small robot in simulated time with a viewer, and the rows of its CSV."""

import csv
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["TILLER_SOURCE"])
TILLER = os.environ["TILLER_COMMAND"]
sys.path.insert(0, str(SOURCE / "tools/python"))


class Run(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self._folder.name)
        text = (SOURCE / "robots/cart_pole.toml").read_text(encoding="utf-8")
        for key, less in (("rollouts", 32), ("horizon", 25), ("particles", 128)):
            text = re.sub(rf"(?m)^{key} = \d+", f"{key} = {less}", text, count=1)
        text = text.replace("[planner]\n", "[planner]\npredict_spread = true\n")
        text = text.replace("[posterior]\n", "[posterior]\ndisturbance = true\n")
        (self.folder / "robot.toml").write_text(text, encoding="utf-8")

    def tearDown(self):
        self._folder.cleanup()

    def tiller(self, *arguments, **environment):
        return subprocess.run([TILLER, *map(str, arguments)], cwd=self.folder, capture_output=True, text=True,
                              timeout=200, check=False, env=os.environ | environment)

    def steer(self, *arguments, log="run.csv", seconds=1, **environment):
        done = self.tiller("run", "robot.toml", "--sim", "--quiet", "--seconds", seconds, "--log", log, *arguments,
                           **environment)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout + done.stderr

    def rows(self, log="run.csv"):
        with open(self.folder / log, encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def counted(self, told):
        """Ticks shown and dropped."""
        found = re.search(r"view: (\d+) ticks shown, (\d+) dropped", told)
        self.assertIsNotNone(found, told)
        return int(found[1]), int(found[2])
