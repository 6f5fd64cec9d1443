"""A parameter on the edge of its prior, as `tiller run`, `identify` and `gap` tell it: in text, JSON and page."""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "gap"))

from command_test import MASS, ROBOT, simulate  # noqa: E402  0.5 kg

TILLER = os.environ["TILLER_COMMAND"]
PRIOR = "mass_kg = { uniform = [0.475, 0.525] }"
FRICTION = '[[effects]]\nkind = "coulomb_friction"\nport = "joint"\nfriction_SI = { uniform = [0.0, 0.2] }\n'
SIM = f"""[sim]
plant = "pendulum"
parameters = {{ mass_kg = {MASS}, length_m = 0.4, damping_Nms = 0 }}
sensors.angle_rad = {{ sd = 0.002 }}
"""
NAMED = "mass_kg at its upper bound 0.48: widen the prior"


def robot_text(low: float, high: float, effects: str = "") -> str:
    text = ROBOT.replace(PRIOR, f"mass_kg = {{ uniform = [{low}, {high}] }}")
    text = text.replace("angle_rad = 0.0 }", "angle_rad = 1.0 }")
    assert f"[{low}, {high}]" in text
    return text.replace("[measurement]", effects + "[measurement]") + SIM


class Edge(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.held = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.held.name)
        cls.logs = []
        for seed in range(3):
            path = cls.folder / f"log{seed}.csv"
            rows = [f"{t:.3f},{q:.9g},{u:.9g}" for t, q, u in simulate(seed + 1, 0.0, 6.0)]
            path.write_text("\n".join(["time_s,angle_rad,torque_Nm", *rows]) + "\n")
            cls.logs.append(path)

    @classmethod
    def tearDownClass(cls):
        cls.held.cleanup()

    def tiller(self, *arguments, codes=(0,)) -> str:
        run = subprocess.run([TILLER, *map(str, arguments)], capture_output=True, text=True, cwd=self.folder,
                             check=False)
        self.assertIn(run.returncode, codes, run.stdout + run.stderr)
        return run.stdout

    def robot(self, *arguments) -> Path:
        path = self.folder / "arm.toml"
        path.write_text(robot_text(*arguments))
        return path

    def run_of(self, robot: Path) -> tuple[str, dict, str]:
        out = self.tiller("run", robot, "--sim", "--seconds", 3, "--quiet", "--alarm-seconds", 0,
                          "--report", "run.html")
        edges = json.loads((self.folder / "run.json").read_text()).get("edges", {})
        return out, edges.get("mass_kg"), (self.folder / "run.html").read_text()

    def fit_of(self, robot: Path) -> tuple[str, dict, str]:
        out = self.tiller("identify", robot, *self.logs, "--particles", 128, "--window", 32, "--moves", 16, "-o", "fit")
        result = json.loads((self.folder / "fit" / "identify.json").read_text())
        page = (self.folder / "fit" / "identify.html").read_text()
        return out, result["candidates"][-1]["parameters"][0]["edge"], page

    def gap_of(self, robot: Path) -> tuple[str, dict, str]:
        # a payload would be the rest of the mass
        out = self.tiller("gap", robot, *self.logs, "--only", "coulomb_friction", "-o", "gap", codes=(0, 1, 2, 3))
        result = json.loads((self.folder / "gap" / "gap.json").read_text())
        return out, result["ranking"][0]["parameters"][0]["edge"], (self.folder / "gap" / "gap.html").read_text()

    def test_a_truth_outside_is_named_by_all(self):
        robot = self.robot(0.4, 0.48)
        for told in (self.run_of, self.fit_of, self.gap_of):
            with self.subTest(told.__name__):
                text, edge, page = told(robot)
                self.assertIn(NAMED, text)
                self.assertEqual(edge, {"at": "upper bound", "value": 0.48, "by": "prior", "text": NAMED})
                self.assertIn(NAMED, page)

    def test_a_truth_inside_is_not(self):
        # 0.5 kg: in the middle, and a twentieth of the range from a bound
        for low, high in ((0.45, 0.55), (0.45, 0.5026)):
            robot = self.robot(low, high)
            for told in (self.run_of, self.fit_of, self.gap_of):
                with self.subTest(f"{told.__name__} {high}"):
                    text, edge, page = told(robot)
                    self.assertNotIn("widen the prior", text)
                    self.assertIsNone(edge)
                    self.assertNotIn("widen the prior", page)

    def test_no_friction_is_no_reason_to_widen_its_prior(self):
        robot = self.robot(0.45, 0.55, FRICTION)
        for told in (self.run_of, self.fit_of, self.gap_of):
            with self.subTest(told.__name__):
                text, _, page = told(robot)
                self.assertNotIn("widen the prior", text + page)
                self.assertIn("joint.friction_SI at 0, its bound by physics: the data show none of it", text)


if __name__ == "__main__":
    unittest.main(verbosity=2)
