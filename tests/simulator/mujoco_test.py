"""MuJoCo behind the lines: a puck that slides to rest by Coulomb's law, and refusals. Skipped without mujoco."""

import importlib.util
import json
import os
import subprocess
import sys
import unittest

TOOLS = os.environ["TILLER_PYTHON_PACKAGE"]
PUCK = os.environ["TILLER_PUCK"]
HELLO = {"tiller_simulator": 1, "parameters": ["friction"], "inputs": ["force_N"], "measurements": ["x_m", "v_m_s"],
         "period_s": 0.02}
NAMES = ["--parameter", "friction=geom_friction[puck,0]", "--measure", "x_m=qpos:slide", "--measure",
         "v_m_s=qvel:slide", "--input", "force_N=push"]


def run(lines, names=NAMES):
    text = "".join(json.dumps(line) + "\n" for line in lines)
    done = subprocess.run([sys.executable, "-m", "tiller_tools.mujoco_simulator", PUCK, *names], input=text, text=True,
                          capture_output=True, cwd=TOOLS, timeout=60, check=False)
    return [json.loads(line) for line in done.stdout.splitlines()], done.stderr


@unittest.skipUnless(importlib.util.find_spec("mujoco"), "the package mujoco is not installed")
class Mujoco(unittest.TestCase):
    def ask(self, friction, number):
        return {"id": number, "seed": 1, "parameters": [friction], "start": [0.0, 2.0], "inputs": [[0.0]] * 50}

    def test_a_puck_slides_as_far_as_its_friction_lets_it(self):
        (hello, rough, smooth, again), errors = run([HELLO, self.ask(0.6, 1), self.ask(0.4, 2), self.ask(0.6, 3)])
        self.assertEqual(hello, {"tiller_simulator": 1}, errors)
        for answer, friction in ((rough, 0.6), (smooth, 0.4)):
            self.assertEqual(len(answer["measured"]), 50)
            # v^2 / (2 mu g); contact is soft, and friction acts a little late
            self.assertAlmostEqual(answer["measured"][-1][0], 2.0 ** 2 / (2 * friction * 9.81), delta=0.02)
        self.assertEqual(rough["measured"], again["measured"])  # nothing is left of the request between

    def test_tells_names_that_are_not_there(self):
        for names, told in ((["--parameter", "friction=geom_friction[disc,0]", *NAMES[2:]], "no geom 'disc'"),
                            (NAMES[2:], "parameter friction: add --parameter"),
                            ([*NAMES[:2], "--measure", "x_m=qpos:away", *NAMES[4:]], "no joint 'away'")):
            answers, errors = run([HELLO], names)
            self.assertEqual(answers, [])
            self.assertIn(told, errors)


if __name__ == "__main__":
    unittest.main()
