"""figure_test.py ARM.urdf: the robot's stick figure in the page of a run. Where its links are, from another reading of
the same description; what the canvas shows; and that no log makes it large or breaks it."""

import base64
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import tomllib
import unittest
import xml.etree.ElementTree as xml
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])
sys.path.insert(0, str(HERE))

import numpy as np  # noqa: E402

from browser import CHROMIUM, Browser  # noqa: E402
from tiller_tools import animation, figure, page, report  # noqa: E402

URDF = Path(sys.argv.pop() if len(sys.argv) > 1 else HERE.parent / "import" / "arm.urdf")
TILLER = os.environ.get("TILLER_COMMAND", "tiller")
EMPTY = {"parent": -1, "position_m": [0, 0, 0], "rpy_rad": [0, 0, 0], "axis": [0, 0, 1], "turn_rad": 0, "slide_m": 0,
         "joined": False, "lines_m": [], "circles": [], "boxes": []}


def value(entry) -> list:
    """A value of a robot file as the program's facts have it: [[factor, name], ...]."""
    if not isinstance(entry, str):
        return [[float(entry), ""]] if entry else []
    terms = []
    for sign, term in re.findall(r"([+-]?)\s*((?:[\d.]+(?:e-?\d+)?|\*|[A-Za-z_][\w.]*)+)", entry):
        numbers = [float(word) for word in term.split("*") if not re.match(r"[A-Za-z_]", word)]
        names = [word for word in term.split("*") if re.match(r"[A-Za-z_]", word)]
        terms.append([math.prod(numbers) * (-1 if sign == "-" else 1), names[0] if names else ""])
    return terms


def facts_of(section: dict) -> dict:
    """[figure] of a robot file as run_facts_json writes it."""
    links, index = [], {}
    for given in section["links"]:
        link = EMPTY | given
        link["parent"] = index[given["parent"]] if "parent" in given else -1
        index[link["name"]] = len(links)
        for key in ("position_m", "rpy_rad", "quaternion"):
            if key in link:
                link[key] = [value(entry) for entry in link[key]]
        for key in ("turn_rad", "slide_m"):
            link[key] = value(link[key])
        link["lines_m"] = [[[value(entry) for entry in point] for point in line] for line in link["lines_m"]]
        link["circles"] = [{"at_m": [value(v) for v in c.get("at_m", [0, 0, 0])], "radius_m": value(c["radius_m"]),
                            "normal": c.get("normal", [0, 1, 0])} for c in link["circles"]]
        link["boxes"] = [{"at_m": [value(v) for v in b.get("at_m", [0, 0, 0])],
                          "size_m": [value(v) for v in b["size_m"]]} for b in link["boxes"]]
        links.append(link)
    return {"view": section.get("view", "3d"), "links": links, "parameters": {}, "true_parameters": {},
            "goals_m": [[value(v) for v in point] for point in section.get("goals_m", [])]}


# ---- another reading of a URDF: quaternions (w, x, y, z) by Hamilton's product ------------------------------------


def times(a, b):
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw)


def turned(q, v):
    return np.array(times(times(q, (0, *v)), (q[0], -q[1], -q[2], -q[3]))[1:])


def about(axis, angle):
    return (math.cos(angle / 2), *(math.sin(angle / 2) * np.array(axis, float) / np.linalg.norm(axis)))


def origins(urdf: Path, positions: dict, base) -> dict:
    """Of each link the turn and the origin in the world, from joints' positions by name."""
    joints = xml.parse(urdf).getroot().findall("joint")
    numbers = lambda text: [float(word) for word in text.split()]  # noqa: E731
    children = {joint.find("child").get("link") for joint in joints}
    placed = {joint.find("parent").get("link"): base for joint in joints
              if joint.find("parent").get("link") not in children}
    waiting = list(joints)
    while waiting:
        joint = waiting.pop(0)
        parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
        if parent not in placed:
            waiting.append(joint)
            continue
        turn, at = placed[parent]
        origin = joint.find("origin")
        xyz = numbers(origin.get("xyz", "0 0 0")) if origin is not None else [0, 0, 0]
        roll, pitch, yaw = numbers(origin.get("rpy", "0 0 0")) if origin is not None else (0, 0, 0)
        at = at + turned(turn, xyz)
        for axis, angle in (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll)):
            turn = times(turn, about(axis, angle))
        mimic = joint.find("mimic")
        position = positions.get(joint.get("name"), 0.0)
        if mimic is not None and joint.get("name") not in positions:
            position = float(mimic.get("multiplier")) * positions[mimic.get("joint")] + float(mimic.get("offset"))
        axis = numbers(joint.find("axis").get("xyz")) if joint.find("axis") is not None else [1, 0, 0]
        if joint.get("type") == "prismatic":
            at = at + turned(turn, position * np.array(axis) / np.linalg.norm(axis))
        elif joint.get("type") != "fixed":
            turn = times(turn, about(axis, position))
        placed[child] = (turn, at)
    return placed


class Imports(unittest.TestCase):
    """Every link that `tiller import` draws stands where the description puts it."""

    def check(self, options: list, held: dict, base_states: dict, base) -> dict:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([TILLER, "import", URDF, "-o", folder, *options], check=True, capture_output=True)
            section = tomllib.loads((Path(folder) / "robot.toml").read_text(encoding="utf-8"))["figure"]
        facts = facts_of(section)
        random = np.random.default_rng(5)
        for _ in range(20):
            joints = {"pan": random.uniform(-3, 3), "lift": random.uniform(-3, 3), "reach": random.uniform(-1, 1),
                      "grip": random.uniform(-3, 3), "look": random.uniform(-3, 3)} | held
            states = {f"{name}_{'m' if name == 'reach' else 'rad'}": v for name, v in joints.items()}
            states |= base_states
            expected = origins(URDF, joints, base)
            placed = figure.poses(facts, figure.Values(1, states))
            for link, (rotation, origin) in zip(facts["links"], placed):
                turn, at = expected[link["name"]]
                # the file has nine digits
                np.testing.assert_allclose(origin[0], at, atol=1e-8, err_msg=link["name"])
                np.testing.assert_allclose(rotation[0], np.stack([turned(turn, e) for e in np.eye(3)], axis=1),
                                           atol=1e-8, err_msg=link["name"])
        return {link["name"]: link for link in facts["links"]}

    def test_a_fixed_base_a_slide_and_a_finger_that_follows(self):
        links = self.check([], {}, {}, ((1, 0, 0, 0), np.zeros(3)))
        self.assertIn("lens", links, "the end of a branch that is fixed to it")
        self.assertEqual(links["right_finger"]["turn_rad"], [[-1.5, "grip_rad"], [0.1, ""]])
        self.assertTrue(all(link["joined"] for name, link in links.items() if name != "world"))

    def test_held_joints(self):
        self.check(["--hold", "lift=0.4,grip=0.3,grip_mirror=-0.2"], {"lift": 0.4, "grip": 0.3, "grip_mirror": -0.2}, {},
                   ((1, 0, 0, 0), np.zeros(3)))

    def test_a_planar_base(self):
        states = {"base_x_m": 0.3, "base_y_m": -0.7, "base_yaw_rad": 2.1}
        self.check(["--base", "planar"], {}, states, (about((0, 0, 1), 2.1), np.array([0.3, -0.7, 0])))

    def test_a_free_base(self):
        states = {"base_x_m": 0.3, "base_y_m": -0.7, "base_z_m": 1.1, "base_yaw_rad": 2.1, "base_pitch_rad": -0.6,
                  "base_roll_rad": 0.4}
        turn = times(times(about((0, 0, 1), 2.1), about((0, 1, 0), -0.6)), about((1, 0, 0), 0.4))
        self.check(["--base", "free"], {}, states, (turn, np.array([0.3, -0.7, 1.1])))


class Shapes(unittest.TestCase):
    def points(self, section: dict, **named) -> tuple[figure.Sketch, np.ndarray]:
        sketch = figure.Sketch(facts_of(section))
        return sketch, sketch.points(figure.Values(1, named))[0]

    def test_a_quaternion_is_the_rotation_that_it_says_at_any_length(self):
        link = {"name": "body", "position_m": ["x", "y", "z"], "quaternion": ["qw", "qx", "qy", "qz"],
                "lines_m": [[[0, 0, 0], [0.3, 0.1, -0.2]]]}
        turn = times(about((1, 2, -1), 0.9), about((0, 1, 3), -0.4))
        q = dict(zip(("qw", "qx", "qy", "qz"), 1.7 * np.array(turn)))
        _, points = self.points({"links": [link]}, x=1.0, y=2.0, z=3.0, **q)
        np.testing.assert_allclose(points[1], [1, 2, 3] + turned(turn, (0.3, 0.1, -0.2)), atol=1e-12)
        _, points = self.points({"links": [link]}, x=1.0, y=2.0, z=3.0, qw=0.0, qx=0.0, qy=0.0, qz=0.0)
        self.assertTrue(np.isnan(points[1]).all(), "of no quaternion nothing is known")

    def test_a_circle_and_a_box(self):
        sketch, points = self.points({"links": [{
            "name": "wheel", "circles": [{"at_m": [0, 0.5, "r"], "radius_m": "2*r", "normal": [0, 1, 0]}],
            "boxes": [{"at_m": ["r", 0, 0], "size_m": [0.2, 0.4, "r"]}]}]}, r=0.3)
        (rim,), box = figure.outline(sketch.shapes[0], points), figure.outline(sketch.shapes[1], points)
        np.testing.assert_allclose(np.linalg.norm(rim - [0, 0.5, 0.3], axis=1), 0.6, atol=1e-12)
        np.testing.assert_allclose(rim[:, 1], 0.5, atol=1e-12)
        corners = {tuple(np.round(p, 9)) for line in box for p in line}
        self.assertEqual(corners, {tuple(np.round((0.3 + x, y, z), 9)) for x in (-0.1, 0.1) for y in (-0.2, 0.2)
                                   for z in (-0.15, 0.15)})

    def test_shipped_figures_end_where_the_models_say(self):
        robots = HERE.parent.parent / "robots"
        section = tomllib.loads((robots / "two_link_arm.toml").read_text())["figure"]
        _, points = self.points(section, shoulder_rad=0.7, elbow_rad=-1.1, upper_length_m=0.5, lower_length_m=0.4)
        np.testing.assert_allclose(points[-1], [0.5 * math.sin(0.7) + 0.4 * math.sin(-0.4), 0,
                                                -0.5 * math.cos(0.7) - 0.4 * math.cos(-0.4)], atol=1e-12)
        section = tomllib.loads((robots / "cart_pole.toml").read_text())["figure"]
        _, points = self.points(section, position_m=0.2, angle_rad=0.3, half_length_m=0.5)
        np.testing.assert_allclose(points[-1], [0.2 + math.sin(0.3), 0, math.cos(0.3)], atol=1e-12)
        section = tomllib.loads((robots / "planar_quadrotor.toml").read_text())["figure"]
        _, points = self.points(section, x_m=1.0, z_m=2.0, tilt_rad=0.3, arm_m=0.2)
        # a positive tilt lifts the right end
        np.testing.assert_allclose(points[1], [1 + 0.2 * math.cos(0.3), 0, 2 + 0.2 * math.sin(0.3)], atol=1e-12)


# ---- pages of a made-up run ---------------------------------------------------------------------------------------

ROD = {"links": [{"name": "rod", "position_m": ["x_m", "y_m", "z_m"], "lines_m": [[[0, 0, 0], ["dx", "dy", "dz"]]]}]}


def write_run(folder: Path, columns: dict, section: dict | None, target: dict | None = None, **extra) -> report.Run:
    states = [name[5:] for name in columns if name.startswith("mean.")]
    rows = len(columns["time_s"])
    columns |= {f"sd.{name}": np.full(rows, 0.01) for name in states}
    facts = {"columns": {"states": {name: "m" for name in states}, "angles": [], "measured": [], "inputs": {},
                         "parameters": {}, "tracked": []}, "target": target or {}}
    if section:
        facts["figure"] = facts_of(section) | extra
    (folder / "run.json").write_text(json.dumps(facts))
    cells = ["" if not math.isfinite(v) else f"{v:.9g}" for row in zip(*columns.values()) for v in row]
    lines = [",".join(columns)] + [",".join(cells[i:i + len(columns)]) for i in range(0, len(cells), len(columns))]
    (folder / "run.csv").write_text("\n".join(lines) + "\n")
    return report.read_run(folder / "run.csv", None)


def still_rod(rows: int, **at) -> dict:
    columns = {"time_s": 0.01 * np.arange(rows)}
    return columns | {f"mean.{name}": np.full(rows, float(v)) for name, v in at.items()}


def data_text(run: report.Run) -> str:
    return re.search(r'id=robot-data>(.*?)</script>', animation.section(run), re.S).group(1)


def shown(run: report.Run) -> dict:
    return json.loads(data_text(run))


def unpacked(data: dict, track: str) -> np.ndarray:
    steps = np.frombuffer(base64.b64decode(data["tracks"][track]), "<i2").astype(float)
    steps[steps == -32768] = np.nan
    return data["middle"] + data["step"] * steps.reshape(-1, data["points"], 3)


class Pages(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def test_without_a_figure_the_page_has_no_script(self):
        text = report.build(write_run(self.folder, still_rod(50, x_m=1), None))
        self.assertNotIn("<script", text)
        self.assertNotIn("The robot", text)

    def test_the_page_loads_nothing(self):
        text = animation.section(write_run(self.folder, still_rod(50, x_m=0, y_m=0, z_m=0, dx=1, dy=0, dz=0), ROD))
        for loads in ("src=", "<link", "<img", "@import", "http://", "fetch(", "import("):
            self.assertNotIn(loads, re.sub(r"http://www\.w3\.org/\S+", "", text), loads)

    def test_long_runs_stay_small(self):
        rows = 5000
        columns = still_rod(rows, x_m=0, y_m=0, z_m=0, dx=0, dy=0, dz=1)
        columns["mean.dx"] = np.sin(columns["time_s"])
        data = shown(write_run(self.folder, columns, ROD))
        self.assertLessEqual(len(data["time"]), animation.MOST_FRAMES)
        self.assertGreater(len(data["time"]), animation.MOST_FRAMES // 2)
        self.assertEqual((data["time"][0], data["time"][-1]), (0, 49.99))
        points = unpacked(data, "estimate")
        self.assertEqual(len(points), len(data["time"]))
        np.testing.assert_allclose(points[:, 1, 0], np.sin(data["time"]), atol=2 * data["step"])
        # many points: fewer frames, not more text
        comb = {"links": [{"name": "comb", "position_m": ["x_m", 0, 0],
                           "lines_m": [[[0, 0, k / 100], [1, 0, k / 100]] for k in range(200)]}]}
        self.assertLess(len(data_text(write_run(self.folder, still_rod(rows, x_m=0), comb))), 600_000)

    def test_what_is_missing_or_diverges_is_left_out(self):
        columns = still_rod(100, x_m=0, y_m=0, z_m=0, dx=1, dy=0, dz=0)
        columns["mean.x_m"][10:20] = math.nan
        columns["mean.x_m"][90:] = 1e30
        points = unpacked(shown(write_run(self.folder, columns, ROD)), "estimate")
        self.assertTrue(np.isnan(points[10:20]).any(axis=(1, 2)).all())
        self.assertTrue(np.isnan(points[90:]).any(axis=(1, 2)).all())
        np.testing.assert_allclose(points[20:90, 1], np.broadcast_to([1, 0, 0], (70, 3)), atol=1e-3)

    def test_nothing_but_gaps_is_a_page_without_the_robot(self):
        columns = still_rod(100, x_m=math.nan, y_m=0, z_m=0, dx=1, dy=0, dz=0)
        self.assertEqual(animation.section(write_run(self.folder, columns, ROD)), "")

    def test_the_plant_has_its_own_lengths_and_the_goal_its_own_states(self):
        section = {"links": [{"name": "rod", "position_m": ["x_m", 0, 0], "lines_m": [[[0, 0, 0], [0, 0, "length_m"]]]}],
                   "goals_m": [["x_m", 0, 1]]}
        columns = still_rod(30, x_m=0.5)
        columns["true.x_m"] = np.full(30, 0.6)
        data = shown(write_run(self.folder, columns, section, {"x_m": 2.0}, parameters={"length_m": 1.0},
                               true_parameters={"length_m": 1.5}))
        for track, expected in (("estimate", [0.5, 0, 1]), ("truth", [0.6, 0, 1.5]), ("goal", [2, 0, 1])):
            np.testing.assert_allclose(unpacked(data, track)[-1, 1], expected, atol=2 * data["step"], err_msg=track)
        self.assertEqual(len(unpacked(data, "goal")), 1, "a goal that stays is told once")

    def test_axes_of_a_frames_goal_point_where_it_is_wanted(self):
        columns = still_rod(30, x_m=0, y_m=0, z_m=0, dx=1, dy=0, dz=0)
        run = write_run(self.folder, columns, ROD)
        turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], float)
        run.frames = [{"name": "tool", "moves": True, "turns": True}]
        run.meta["output_target"] = dict(zip(("tool_x_m", "tool_y_m", "tool_z_m"), (3.0, 2.0, 1.0))) | {
            f"tool_r{r}{c}": turn[i, j] for i, r in enumerate("xyz") for j, c in enumerate("xyz")}
        data = shown(run)
        data["tracks"]["frame"], data["points"] = data["frames"][0], 4
        ends = unpacked(data, "frame")[0]
        np.testing.assert_allclose(ends[0], [3, 2, 1], atol=2 * data["step"])
        length = 0.2 * data["size"]
        np.testing.assert_allclose((ends[1:] - ends[0]) / length, turn.T, atol=5 * data["step"] / length)


# Plays with the page and tells what became of it.
_HANDS = """<script>
(() => {
  const get = (id) => document.getElementById(id), canvas = get("robot-canvas"), slider = get("robot-slider");
  const blue = () => {  // where the estimate is, in pixels: the extent, and the mean slope
    const pen = canvas.getContext("2d"), {width, height} = canvas;
    const pixels = pen.getImageData(0, 0, width, height).data;
    let n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
    for (let i = 0; i < width * height; ++i) {
      if (pixels[4 * i] !== 0x1f || pixels[4 * i + 1] !== 0x5f || pixels[4 * i + 2] !== 0xa8) continue;
      const u = i % width, v = -Math.floor(i / width);
      n += 1, x += u, y += v, xx += u * u, yy += v * v, xy += u * v;
    }
    return {n, x: x / n, y: y / n, angle: Math.atan2(2 * (xy / n - x * y / n / n),
                                                   xx / n - x * x / n / n - (yy / n - y * y / n / n)) / 2};
  };
  const out = {first: blue(), button: get("robot-play").textContent};
  slider.value = slider.max;
  slider.dispatchEvent(new Event("input"));
  out.last = blue();
  out.time = get("robot-time").textContent;
  const mouse = (type, x, y) => canvas.dispatchEvent(
    new PointerEvent(type, {clientX: x, clientY: y, pointerId: 1, bubbles: true}));
  canvas.setPointerCapture = () => {};
  mouse("pointerdown", 100, 100);
  mouse("pointermove", 160, 100);
  mouse("pointerup", 160, 100);
  mouse("pointermove", 300, 200);
  out.turned = blue();
  canvas.dispatchEvent(new MouseEvent("dblclick"));
  out.back = blue();
  get("robot-play").click();
  out.playing = get("robot-play").textContent;
  const pre = document.createElement("pre");
  pre.id = "told";
  pre.textContent = JSON.stringify(out);
  document.body.appendChild(pre);
})();
</script>"""


@unittest.skipUnless(CHROMIUM, "no chromium: ./dev setup installs it")
class Canvas(unittest.TestCase):
    def test_the_canvas_shows_the_projection_and_obeys(self):
        rod = np.array([0.8, 0.3, 0.5])
        for view in ("side", "top", "3d"):
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                columns = still_rod(40, x_m=0, y_m=0, z_m=0, dx=rod[0], dy=rod[1], dz=rod[2])
                columns["mean.x_m"][20:] = 0.5  # moves to the right, and once is lost
                columns["mean.x_m"][7] = math.nan
                drawn = animation.section(write_run(folder, columns, ROD | {"view": view}))
                file = folder / "page.html"
                file.write_text(page.page("rod", drawn + _HANDS), encoding="utf-8")
                run = Browser(folder, file)._run("--window-size=1000,800", "--force-prefers-reduced-motion",
                                                 "--dump-dom")
                self.assertNotIn("Uncaught", run.stderr)
                told = json.loads(re.search(r'<pre id="told">(.*?)</pre>', run.stdout, re.S).group(1))
                across, up = animation.project(rod, view)
                expected = math.atan2(up, across)
                for which in ("first", "last", "back"):
                    self.assertGreater(told[which]["n"], 200, f"{view} {which}: the rod is drawn")
                    self.assertAlmostEqual(told[which]["angle"], expected, delta=0.02, msg=f"{view} {which}")
                self.assertGreater(told["last"]["x"], told["first"]["x"] + 20, view)
                self.assertEqual(told["time"], "0.39 s")
                # 60 pixels to the right turn the view by -30 degrees about the vertical
                azimuth, elevation = animation._VIEWS[view]
                animation._VIEWS["turned"] = (azimuth - 30, elevation)
                across, up = animation.project(rod, "turned")
                del animation._VIEWS["turned"]
                self.assertAlmostEqual(told["turned"]["angle"], math.atan2(up, across), delta=0.02, msg=view)
                self.assertEqual((told["button"], told["playing"]), ("Play", "Pause"))


if __name__ == "__main__":
    unittest.main(verbosity=2)
