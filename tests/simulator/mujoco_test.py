"""MuJoCo behind the lines: a puck that slides to rest by Coulomb's law, and refusals. Skipped without mujoco."""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import unittest

TOOLS = os.environ["TILLER_PYTHON_PACKAGE"]
PUCK = os.environ["TILLER_PUCK"]
HELLO = {"tiller_simulator": 1, "parameters": ["friction"], "inputs": ["force_N"], "measurements": ["x_m", "v_m_s"],
         "period_s": 0.02}
NAMES = ["--parameter", "friction=geom_friction[puck,0]", "--measure", "x_m=qpos:slide", "--measure",
         "v_m_s=qvel:slide", "--input", "force_N=push"]


# a ball on a free joint and one on a rail, both with a sensor of where they are
BALLS = """<mujoco><option timestep="0.01"/><worldbody>
<body name="ball"><freejoint name="free"/><geom size="0.1" mass="1"/></body>
<body name="bead" pos="9 0 0"><joint name="rail" type="slide" axis="0 0 1"/><geom size="0.1" mass="1"/></body>
</worldbody><actuator><motor name="push" joint="rail"/></actuator>
<sensor><framepos name="where" objtype="body" objname="ball"/>
<jointpos name="height" joint="rail"/></sensor></mujoco>"""
BALL_HELLO = {"tiller_simulator": 1, "parameters": ["mass_kg"], "inputs": ["force_N"],
              "measurements": ["z_m", "seen_z_m", "rail_m", "seen_rail_m"], "period_s": 0.02}
BALL_NAMES = ["--parameter", "mass_kg=body_mass[bead]", "--measure", "z_m=qpos:free[2]", "--measure",
              "seen_z_m=sensor:where[2]", "--measure", "rail_m=qpos:rail", "--measure", "seen_rail_m=sensor:height",
              "--input", "force_N=push"]


def run_balls(lines, names=BALL_NAMES):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "balls.xml")
        with open(path, "w", encoding="utf-8") as file:
            file.write(BALLS)
        return run(lines, names, path)


def run(lines, names=NAMES, model=PUCK):
    text = "".join(json.dumps(line) + "\n" for line in lines)
    done = subprocess.run([sys.executable, "-m", "tiller_tools.mujoco_simulator", model, *names], input=text, text=True,
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
                            ([*NAMES[:2], "--measure", "x_m=qpos:away", *NAMES[4:]], "no joint 'away' but slide, lift"),
                            ([*NAMES[:2], "--measure", "x_m=rate:slide", *NAMES[4:]], "measurement x_m: 'rate:slide'"),
                            (["--parameter", "friction=geom_friction[puck]", *NAMES[2:]], "is 3 numbers; choose one"),
                            (["--parameter", "friction=geom_friction[puck,7]", *NAMES[2:]], "has no such place"),
                            (["--parameter", "friction=geom_friction[9,0]", *NAMES[2:]], "no geom '9' but table, puck"),
                            ([*NAMES[:6], "--input", "force_N=pull"], "input force_N: the model has no actuator")):
            answers, errors = run([HELLO], names)
            self.assertEqual(answers, [])
            self.assertIn(told, errors)

    def test_tells_a_model_that_cannot_be_read(self):
        answers, errors = run([HELLO], NAMES, "/no/such.xml")
        self.assertEqual(answers, [])
        self.assertIn("/no/such.xml: MuJoCo does not read it", errors)
        self.assertNotIn("Traceback", errors)

    def test_sensors_show_the_end_of_a_period_and_joints_have_places(self):
        ask = {"id": 1, "seed": 1, "parameters": [2.0], "start": [5.0, 0.0, 0.0, 0.0], "inputs": [[0.0]] * 10}
        (_, answer), errors = run_balls([BALL_HELLO, ask])
        self.assertEqual(len(answer["measured"]), 10, errors)
        for z, seen_z, rail, seen_rail in answer["measured"]:
            self.assertEqual(seen_z, z)
            self.assertEqual(seen_rail, rail)
        # 20 steps of the semi-implicit rule: g h^2 n (n + 1) / 2
        self.assertAlmostEqual(z, 5.0 - 9.81 * 1e-4 * 210, places=9)

    def test_a_simulation_that_diverges_is_an_error_and_the_next_is_none(self):
        good = {"id": 2, "seed": 1, "parameters": [2.0], "start": [5.0, 0.0, 0.0, 0.0], "inputs": [[0.0]] * 3}
        wild = dict(good, id=1, parameters=[1e-3], inputs=[[0.0], [9e9], [0.0]])
        huge = dict(good, id=3, inputs=[[1e40], [0.0], [0.0]])  # MuJoCo would take it for zero
        (_, first, second, third), errors = run_balls([BALL_HELLO, wild, good, huge])
        self.assertIn("unstable in period 2", first.get("error", ""), errors)
        self.assertIn("unstable in period 1", third.get("error", ""), errors)
        self.assertEqual(len(second["measured"]), 3)


if __name__ == "__main__":
    unittest.main()
