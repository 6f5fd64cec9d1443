"""What was found, given back to the simulator: the text of MJCF and URDF around it, what tiller's own import reads of
the result, and, where MuJoCo is installed, what MuJoCo does."""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
import unittest
import xml.etree.ElementTree as ElementTree
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

from tiller_tools import simulator_patch, table  # noqa: E402

TILLER = os.environ["TILLER_COMMAND"]
ARM = Path(__file__).parent.parent / "import" / "arm.urdf"
MJCF = """<mujoco model="arm">
  <!-- drawn by hand -->
  <default><joint damping="0.3"/></default>
  <worldbody>
    <body name="turret"><inertial pos="0 0 0.1" mass="2" diaginertia="0.1 0.2 0.3"/>
      <joint name="pan" axis="0 1 0"/>
      <body name="upper" pos="0 0 0.5">
        <inertial pos="0 0 0.2" mass="1" diaginertia="0.02 0.02 0.001"/>
        <joint name="lift" axis="0 1 0" frictionloss='0.1'/>
        <site name="tool" pos="0 0 0.4"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="pan" joint="pan" gear="10"/>
    <motor name="lift" joint="lift"/>
  </actuator>
</mujoco>
"""


def parameter(of, name, value, low, high, fixed=False):
    return {"name": name, "unit": "", "of": of, "fixed": fixed, "before": None, "before_sd": None, "mean": value,
            "sd": 0.1, "interval_95": [low, high], "edge": None}


EFFECTS = [("coulomb_friction", "joint", "lift"), ("viscous_friction", "joint", "lift"),
           ("joint_inertia", "joint", "lift"), ("payload", "body", "body"),
           ("actuator_gain", "input", "pan_Nm"), ("input_delay", "input", "pan_Nm")]
FOUND = [parameter("robot_file", "turret_mass_kg", 4.0, 3.9, 4.1),
         parameter("robot_file", "upper_mass_kg", 1.0, 1.0, 1.0, fixed=True),
         parameter("robot_file", "pan.damping_SI", 0.6, 0.58, 0.62),
         parameter("effect", "lift.friction_SI", 0.9, 0.88, 0.92),
         parameter("effect", "lift.damping_SI", 0.2, 0.18, 0.22),
         parameter("effect", "lift.inertia_SI", 0.07, 0.06, 0.08), parameter("effect", "body.mass_kg", 1.2, 1.18, 1.22),
         parameter("effect", "pan_Nm.gain_error", -0.1, -0.12, -0.08),
         parameter("effect", "pan_Nm.delay_s", 0.012, 0.01, 0.014)]
RESULT = {"format": "tiller-gap", "version": 1, "verdict": "named",
          "ranking": [{"effects": [{"kind": kind, "port_kind": place, "port": port} for kind, place, port in EFFECTS],
                       "parameters": FOUND}]}


class Simulator(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.json = self.folder / "gap.json"
        self.json.write_text(json.dumps(RESULT))
        self.mjcf = self.folder / "arm.xml"
        self.mjcf.write_text(MJCF)

    def patch(self, description, frame):
        out = self.folder / ("new" + Path(description).suffix)
        return simulator_patch.patch(self.json, description, out, frame), out

    def test_an_mjcf_keeps_its_text_and_takes_the_values(self):
        made, out = self.patch(self.mjcf, "tool")
        text = out.read_text()
        self.assertIn("<!-- drawn by hand -->", text)
        self.assertIn("<!-- tiller gap: damping 0.6, 95 %: 0.58 .. 0.62 -->", text)
        root = ElementTree.fromstring(text)
        joints = {e.get("name"): e for e in root.find("worldbody").iter("joint")}
        self.assertEqual((joints["pan"].get("damping"), joints["lift"].get("damping")), ("0.6", "0.2"))
        self.assertEqual((joints["lift"].get("frictionloss"), joints["lift"].get("armature")), ("0.9", "0.07"))
        turret, upper = (root.find(f".//body[@name='{name}']") for name in ("turret", "upper"))
        self.assertEqual(turret.find("inertial").get("mass"), "4")
        self.assertEqual(turret.find("inertial").get("diaginertia"), "0.2 0.4 0.6")
        load = upper.find("body")
        self.assertEqual((load.get("pos"), load.find("inertial").get("mass")), ("0 0 0.4", "1.2"))
        self.assertEqual([e.get("gear") for e in root.find("actuator")], ["9", None])
        self.assertEqual(len(made.left), 1)
        self.assertIn("input_delay", made.left[0])
        self.assertIn("not said here: input_delay", text)

    def test_a_urdf_keeps_its_text_and_takes_the_values(self):
        made, out = self.patch(ARM, "upper")
        text = out.read_text()
        self.assertIn("An arm of no make", text)
        root = ElementTree.fromstring(text)
        joints = {e.get("name"): e for e in root.iter("joint")}
        pan, lift = (joints[name].find("dynamics").attrib for name in ("pan", "lift"))
        self.assertEqual(pan, {"damping": "0.6", "friction": "0.3", "armature": "0.05"})
        self.assertEqual(lift, {"friction": "0.9", "damping": "0.2", "armature": "0.07"})
        self.assertEqual([line.split(" ")[0] for line in made.left], ["actuator_gain", "input_delay"])

    def test_tillers_own_import_reads_the_values(self):
        _, out = self.patch(ARM, "upper")
        run = subprocess.run([TILLER, "import", str(out), "-o", str(self.folder / "arm"), "--unknown", "mass:turret"],
                             capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
        robot = tomllib.loads((self.folder / "arm" / "robot.toml").read_text())
        self.assertEqual(robot["parameters"]["turret_mass_kg"]["log_normal"][0], 4.0)
        said = {(e["kind"], e.get("port")): e for e in robot["effects"]}
        self.assertEqual(said["viscous_friction", "pan"]["damping_SI"], 0.6)
        self.assertEqual(said["coulomb_friction", "lift"]["friction_SI"], 0.9)

    def test_wrong_files_are_told(self):
        for description, said in ((self.folder / "none.xml", "cannot be read"), (self.json, "no XML")):
            with self.assertRaisesRegex(table.ReportError, said):
                self.patch(description, "")
        sdf = self.folder / "robot.sdf"
        sdf.write_text("<sdf/>")
        with self.assertRaisesRegex(table.ReportError, "<mujoco>"):
            self.patch(sdf, "")
        made, _ = self.patch(self.mjcf, "")
        self.assertIn("--frame", "".join(made.left))
        self.json.write_text(json.dumps({**RESULT, "verdict": "unnamed"}))
        with self.assertRaisesRegex(table.ReportError, "nothing was named"):
            self.patch(self.mjcf, "")

    def test_mujoco_moves_as_the_model_says(self):
        try:
            import mujoco
        except ImportError:
            self.skipTest("MuJoCo is not installed")
        _, out = self.patch(self.mjcf, "tool")
        model = mujoco.MjModel.from_xml_path(str(out))
        self.assertAlmostEqual(float(model.body_mass.sum()), 4.0 + 1.0 + 1.2)
        self.assertAlmostEqual(float(model.dof_damping[0]), 0.6)

        # a robot that is as the result says: the old file leaves a gap to it, the new one none
        def rollout(path, force):
            made = mujoco.MjModel.from_xml_path(str(path))
            data = mujoco.MjData(made)
            angles = []
            for k in range(500):
                data.ctrl[:] = [force(k), 0.0]
                mujoco.mj_step(made, data)
                angles.append(data.qpos.copy())
            return angles

        force = lambda k: 1.0 if k % 200 < 100 else -1.0  # noqa: E731
        truth = MJCF.replace('<joint name="pan"', '<joint name="pan" damping="0.6"') \
            .replace("frictionloss='0.1'", 'frictionloss="0.9" damping="0.2" armature="0.07"') \
            .replace('mass="2" diaginertia="0.1 0.2 0.3"', 'mass="4" diaginertia="0.2 0.4 0.6"') \
            .replace('gear="10"', 'gear="9"') \
            .replace('<site', '<body pos="0 0 0.4"><inertial pos="0 0 0" mass="1.2" '
                              'diaginertia="1e-9 1e-9 1e-9"/></body><site')
        robot = self.folder / "truth.xml"
        robot.write_text(truth)
        def gap(path):
            return max(abs(a - b).max() for a, b in zip(rollout(path, force), rollout(robot, force)))

        self.assertLess(gap(out), 1e-6)
        self.assertGreater(gap(self.mjcf), 0.05)


if __name__ == "__main__":
    unittest.main(verbosity=2)
