"""`tiller gap` from outside: verdicts and exit codes on data of an integrator of its own, bad input, folders that
cannot be written, interruption, and the new robot file that closes the gap."""

import json
import math
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from schema_check import problems  # noqa: E402

TILLER = os.environ["TILLER_COMMAND"]
ROBOTS = Path(os.environ["TILLER_ROBOTS"])
ROBOT = """# the arm of this test
[robot]
name = "arm"
[model]
name = "pendulum"
period_s = 0.01
[parameters]
mass_kg = { uniform = [0.475, 0.525] }   # weighed
length_m = 0.4
damping_Nms = 0.0
[measurement]
angle_rad = { sd = 0.002 }
[noise]
process_sd = { rate_rad_s = 0.001 }
[start]
sd = { angle_rad = 0.1, rate_rad_s = 0.1 }
[planner]
kind = "mppi"
horizon = 50
knots = 10
rollouts = 64
particles = 4
iterations = 1
noise_sd = { torque_Nm = 0.3 }
[cost]
target = { angle_rad = 0.0 }
state_weight = { angle_rad = 1.0 }
[limits]
torque_Nm = { low = -3, high = 3 }
"""
MASS, LENGTH, FRICTION, NOISE = 0.5, 0.4, 0.08, 0.002


def simulate(seed: int, friction: float, seconds: float = 8.0, force=lambda angle, rate: 0.0,
             rates: list | None = None) -> list:
    """Rows (time, angle, torque): RK4 at 0.5 ms under a held multisine, dry friction as a steep tanh, and another
    force at the joint. `rates` takes the true rates."""
    rng = random.Random(seed)
    waves = [(2 * math.pi * rng.uniform(0.2, 2.0), rng.uniform(0, 6.28)) for _ in range(5)]
    inertia = MASS * LENGTH * LENGTH
    angle = rate = 0.0
    rows = []

    def slope(q, v, u):
        return v, (u + force(q, v) - friction * math.tanh(v / 0.003) - MASS * LENGTH * 9.81 * math.sin(q)) / inertia

    for k in range(int(100 * seconds)):
        u = 0.45 * sum(math.sin(w * 0.01 * k + p) for w, p in waves)
        if rates is not None:
            rates.append(rate)
        rows.append((0.01 * k, angle + NOISE * rng.gauss(0, 1), u))
        for _ in range(20):
            h = 0.0005
            a = slope(angle, rate, u)
            b = slope(angle + h / 2 * a[0], rate + h / 2 * a[1], u)
            c = slope(angle + h / 2 * b[0], rate + h / 2 * b[1], u)
            d = slope(angle + h * c[0], rate + h * c[1], u)
            angle += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
            rate += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
    return rows


def write_log(path: Path, rows: list) -> str:
    with open(path, "w", encoding="utf-8") as file:
        file.write("time_s,angle_rad,torque_Nm\n")
        file.writelines(f"{t:.4f},{q:.9g},{u:.9g}\n" for t, q, u in rows)
    return str(path)


class Command(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.home = Path(tempfile.mkdtemp())
        cls.robot = str(cls.home / "arm.toml")
        Path(cls.robot).write_text(ROBOT)
        cls.rubbing = [write_log(cls.home / f"rub_{i}.csv", simulate(i, FRICTION)) for i in range(5)]
        cls.free = [write_log(cls.home / f"free_{i}.csv", simulate(100 + i, 0.0)) for i in range(4)]

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.home, ignore_errors=True)

    def gap(self, *arguments, **options) -> subprocess.CompletedProcess:
        return subprocess.run([TILLER, "gap", *map(str, arguments)], capture_output=True, text=True, timeout=300,
                              check=False, **options)

    def read(self, folder: Path) -> dict:
        result = json.loads((folder / "gap.json").read_text())
        self.assertEqual(problems(result), [])
        return result

    def test_names_friction_and_the_new_robot_file_closes_the_gap(self):
        out = self.home / "out"
        run = self.gap(self.robot, *self.rubbing, "-o", out)
        self.assertIn(run.returncode, (1, 2), run.stdout + run.stderr)
        result = self.read(out)
        self.assertEqual(result["exit_code"], run.returncode)
        self.assertIn("coulomb_friction", [e["kind"] for i in result["ambiguity"]
                                           for e in result["ranking"][i]["effects"]])
        friction = [p for p in result["ranking"][0]["parameters"] if p["name"] == "joint.friction_SI"]
        if friction:
            self.assertAlmostEqual(friction[0]["mean"], FRICTION, delta=0.05 * FRICTION)
        self.assertEqual(result["where"]["region"]["axis"], "velocity")
        (force,) = result["where"]["forces"]  # of the one joint, as dry friction is: of its size, on both sides
        sizes = sorted(abs(value) for value in force["mean"] if value is not None)
        self.assertAlmostEqual(sizes[len(sizes) // 2], FRICTION, delta=0.25 * FRICTION)
        for horizon in result["horizons"]:
            self.assertLess(horizon["after_sigma"], horizon["before_sigma"])
        text = (out / "gap.html").read_text()
        self.assertIn(result["sentence"][:20], text)
        new = out / "arm_gap.toml"
        self.assertIn("# weighed", new.read_text())
        self.assertEqual(subprocess.run([TILLER, "check", str(new)], capture_output=True, check=False).returncode, 0)
        again = self.gap(new, *self.rubbing)
        self.assertEqual(again.returncode, 0, again.stdout + again.stderr)
        self.assertEqual(self.gap(self.robot, *self.rubbing, "--budget", 1000).returncode,
                         0 if run.returncode == 1 else 2)

    def test_the_new_robot_file_finds_what_the_old_one_names(self):
        here, there = self.home / "here", self.home / "there" / "deep"
        here.mkdir()
        (here / "way.csv").write_text("time_s,angle_rad,rate_rad_s\n0,0,0\n1,0.5,0\n")
        (here / "moved.toml").write_text(ROBOT.replace("target = { angle_rad = 0.0 }", 'reference = "way.csv"')
                                         .replace('"arm"', '"moved"'))
        run = self.gap(here / "moved.toml", *self.rubbing, "-o", there)
        self.assertIn(run.returncode, (1, 2), run.stdout + run.stderr)
        new = there / "moved_gap.toml"
        self.assertIn("../../here/way.csv", new.read_text())
        check = subprocess.run([TILLER, "check", str(new)], capture_output=True, text=True, check=False)
        self.assertEqual(check.returncode, 0, check.stdout + check.stderr)

    def test_takes_a_gyroscope_that_the_robot_file_does_not_measure(self):
        logs = []
        for i in range(4):
            rates, rng = [], random.Random(700 + i)
            rows = simulate(i, FRICTION, rates=rates)
            path = self.home / f"gyro_{i}.csv"
            with open(path, "w", encoding="utf-8") as file:
                file.write("time_s,angle_rad,torque_Nm,gyro_deg_s\n")
                for k, ((t, q, u), rate) in enumerate(zip(rows, rates)):
                    seen = f"{math.degrees(rate) + 0.3 + rng.gauss(0, 0.3):.6g}" if k % 3 else ""  # some are missing
                    file.write(f"{t:.4f},{q:.9g},{u:.9g},{seen}\n")
            logs.append(str(path))
        entry = ('\n[[log.sensors]]\ncolumn = "gyro_deg_s"\nof = "rate_rad_s"\n'
                 f'factor = {math.pi / 180}\nzero = 0.3\nsd = {math.radians(0.3)}\n')
        robot = self.home / "gyro.toml"
        spread = {}
        for name, text in (("without", ROBOT), ("with", ROBOT + entry)):
            robot.write_text(text)
            result = json.loads(self.gap(robot, *logs, "--json").stdout)
            self.assertEqual(problems(result), [])
            (friction,) = [p for p in result["ranking"][0]["parameters"] if p["name"].endswith(".friction_SI")]
            self.assertLess(abs(friction["mean"] - FRICTION), 4 * friction["sd"] + 0.01 * FRICTION)
            spread[name] = friction["sd"]
        self.assertLess(spread["with"], 0.7 * spread["without"])
        for old, new, said in (
                ('"gyro_deg_s"', '"giro"', "no log has 'giro'"),
                ('"rate_rad_s"', '"rat_rad_s"', "rate_rad_s"),
                ("zero = 0.3", "derivative = 2", "second derivative of rate_rad_s"),
                ("zero = 0.3", "derivative = 3", "derivative"),
                (f"sd = {math.radians(0.3)}", "sd = 0", "sd"),
                (f"sd = {math.radians(0.3)}", "", "standard deviation"),
                (f"factor = {math.pi / 180}", "factor = 0", "factor"),
                ("zero = 0.3", "zeros = 0.3", "zeros")):
            robot.write_text(ROBOT + entry.replace(old, new))
            run = self.gap(robot, *logs)
            self.assertIn(run.returncode, (3, 4), new)
            self.assertIn(said, run.stdout + run.stderr, new)

    def test_nothing_is_no_gap(self):
        run = self.gap(self.robot, *self.free, "--json")
        result = json.loads(run.stdout)
        self.assertEqual(problems(result), [])
        self.assertEqual((run.returncode, result["verdict"]), (0, "no_gap"), run.stdout[:2000] + run.stderr)
        self.assertIsNone(result["robot_file"])

    def test_what_changed_is_told_with_its_size_and_written(self):
        worn = [write_log(self.home / f"worn_{i}.csv", simulate(200 + i, FRICTION + 0.06)) for i in range(5)]
        out = self.home / "changed"
        run = self.gap(self.robot, "--before", *self.rubbing, "--after", *worn, "-o", out)
        self.assertEqual(run.returncode, 1, run.stdout + run.stderr)
        result = self.read(out)
        self.assertEqual((result["verdict"], result["exit_code"]), ("named", 1))
        change = result["change"]
        (friction,) = change["changed"]
        self.assertEqual(friction["name"], "joint.friction_SI")
        self.assertAlmostEqual(friction["before"], FRICTION, delta=0.005)
        low, high = friction["interval_95"]
        self.assertTrue(0.05 < low < 0.06 + 0.005 and 0.06 - 0.005 < high < 0.07, friction)
        (mass,) = [c for c in change["others"] if c["name"] == "mass_kg"]
        self.assertLess(abs(mass["change"]), 0.05 * MASS)
        self.assertEqual(change["before"]["logs"], self.rubbing)
        text = (out / "gap.html").read_text()
        for said in ("What changed", "joint.friction_SI", "what changed has a name"):
            self.assertIn(said, text)
        for name in ("arm_before.toml", "arm_gap.toml"):
            done = subprocess.run([TILLER, "check", str(out / name)], capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        # the new file is the robot as it is: nothing is missing in it
        self.assertEqual(self.gap(out / "arm_gap.toml", *worn).returncode, 0)

    def test_what_did_not_change_is_called_unchanged(self):
        same = [write_log(self.home / f"same_{i}.csv", simulate(300 + i, FRICTION)) for i in range(4)]
        run = self.gap(self.robot, "--before", *self.rubbing, "--after", *same, "--json")
        self.assertEqual(run.returncode, 0, run.stdout[:2000] + run.stderr)
        result = json.loads(run.stdout)
        self.assertEqual(problems(result), [])
        self.assertEqual((result["verdict"], result["change"]["changed"]), ("no_gap", []))
        self.assertIn("Nothing changed", result["sentence"])
        for c in result["change"]["others"]:
            self.assertLess(c["interval_95"][0], 0.02 * abs(c["before"]))
            self.assertGreater(c["interval_95"][1], -0.02 * abs(c["before"]))

    def test_wrong_logs_of_before_and_after_are_told(self):
        empty = self.home / "empty_before.csv"
        empty.write_text("")
        other = self.home / "other_before.csv"
        other.write_text(Path(self.free[0]).read_text().replace("torque_Nm", "current_A", 1))
        for path, said in ((empty, "empty"), (other, "no column 'torque_Nm'"), (self.home / "none.csv", "No such file")):
            run = self.gap(self.robot, "--before", path, "--after", self.free[0])
            self.assertEqual(run.returncode, 3, run.stdout + run.stderr)
            for part in ("logs of before", str(path), said):
                self.assertIn(part, run.stdout)
        for arguments, said in ((("--before", self.free[0]), "--after"), (("--after", self.free[0]), "--before"),
                                (("--before", self.free[0], "--after", self.free[0]), "in --before and in --after"),
                                ((self.free[1], "--before", self.free[0], "--after", self.free[2]), "neither")):
            run = self.gap(self.robot, *arguments)
            self.assertEqual(run.returncode, 4, f"{arguments}: {run.stdout}{run.stderr}")
            self.assertIn(said, run.stderr)

    def test_bad_logs_end_with_3_and_never_name(self):
        rows = simulate(7, FRICTION)
        bad = {
            "twice": (rows[:300] + [(rows[299][0], rows[299][1] + 0.1, 0.0)] + rows[300:], "repeats that of line 301"),
            "reversed": (rows[:300] + rows[200:300] + rows[300:], "backwards"),
            "degrees": ([(t, math.degrees(q), u) for t, q, u in rows], "degrees"),
            "milliseconds": ([(1e3 * t, q, u) for t, q, u in rows], "in ms"),
            "stuck": ([(t, 0.1, u) for t, q, u in rows], "stuck"),
            "sign": ([(t, q, -u) for t, q, u in rows], "reversed in sign"),
            "short": (rows[:150], "too short"),
            "clipped": ([(t, max(min(q, 0.25), -0.25), u) for t, q, u in rows], "saturated"),
            "dead_input": ([(t, q, 0.0) for t, q, u in rows], "does not change"),
        }
        files = {name: (write_log(self.home / f"bad_{name}.csv", content), said) for name, (content, said) in bad.items()}
        good = Path(self.rubbing[0]).read_text()
        for name, content, said in (("names", good.replace("angle_rad", "theta", 1), "no column 'angle_rad'"),
                                    ("empty", "", "empty"),
                                    ("cut", good[:good.rindex(",")], "cut off")):
            path = self.home / f"bad_{name}.csv"
            path.write_text(content)
            files[name] = (str(path), said)
        files["missing"] = (str(self.home / "none.csv"), "No such file")
        files["folder"] = (str(self.home), "folder")
        for name, (path, said) in files.items():
            with self.subTest(name):
                run = self.gap(self.robot, path, "--json")
                self.assertEqual(run.returncode, 3, run.stdout + run.stderr)
                result = json.loads(run.stdout)
                self.assertEqual(problems(result), [])
                self.assertEqual((result["verdict"], result["ranking"]), ("unfit", []))
                reasons = "\n".join(result["reasons"])
                self.assertIn(said, reasons)
                self.assertIn(path, reasons)

    def test_an_unfit_log_has_a_page_too(self):
        out = self.home / "unfit"
        path = write_log(self.home / "bad_page.csv", simulate(3, 0.0)[:150])
        self.assertEqual(self.gap(self.robot, path, "-o", out).returncode, 3)
        self.assertIn("too short", (out / "gap.html").read_text())

    def test_wrong_input_ends_with_4(self):
        for arguments, said in (((), "required"), ((self.robot,), "LOGS"),
                                ((self.robot, self.free[0], "--budget", "nan"), "budget"),
                                ((self.robot, self.free[0], "--only", "columb_friction"), "coulomb_friction"),
                                ((self.robot, self.free[0], "--max-effects", "0"), "max-effects"),
                                (("none.toml", self.free[0]), "none.toml"),
                                ((self.robot, self.free[0], "--write-urdf", "x.urdf"), "-o FOLDER"),
                                ((self.robot, self.free[0], "--write-mjcf", "x.xml", "-o", self.home / "x"),
                                 "--description"),
                                ((self.robot, self.free[0], "--write-mjcf", "x.xml", "-o", self.home / "x",
                                  "--description", "none.xml"), "none.xml"),
                                ((self.robot, self.free[0], "-o", "/proc/nowhere"), "/proc/nowhere"),
                                ((self.robot, self.free[0], "-o", "/dev/full"), "/dev/full"),
                                ((self.robot, self.free[0], "-o", f"{self.robot}/x"), "another folder")):
            run = self.gap(*arguments)
            self.assertEqual(run.returncode, 4, f"{arguments}: {run.stdout}{run.stderr}")
            self.assertIn(said, run.stderr)
        self.assertEqual(self.gap("--help").returncode, 0)

    def test_what_cannot_be_written_ends_with_5(self):
        with open("/dev/full", "w") as full:
            run = subprocess.run([TILLER, "gap", self.robot, self.free[0], "--json"], stdout=full, stderr=subprocess.PIPE,
                                 timeout=300, check=False)
        self.assertEqual(run.returncode, 5)
        out = self.home / "small"

        def no_space():  # a file may not grow past a block: as a disk that is full
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

        run = self.gap(self.robot, self.free[0], "-o", out, preexec_fn=no_space)
        self.assertEqual(run.returncode, 5, run.stderr)
        self.assertIn("gap.json", run.stderr)
        self.assertFalse((out / "gap.json").exists())
        self.assertIn("no_gap", run.stdout)

    def test_interruption_keeps_what_is_done(self):
        out = self.home / "stopped"
        process = subprocess.Popen([TILLER, "gap", self.robot, *self.rubbing, "-o", out], stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True)
        self.assertIn("made the folder", process.stderr.readline())
        self.assertIn("gap:", process.stderr.readline())
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=120)
        self.assertIn(process.returncode, (130, 1, 2), said)  # 1 or 2: it was done before the signal came
        result = self.read(out)
        self.assertEqual(result["interrupted"], process.returncode == 130)
        self.assertTrue((out / "gap.html").exists())

    def test_a_record_of_a_run_is_a_log(self):
        record = self.home / "run.rec"
        run = subprocess.run([TILLER, "run", str(ROBOTS / "pendulum.toml"), "--sim", "--seconds", "8", "--record",
                              str(record), "--quiet"], capture_output=True, text=True, timeout=300,
                             check=False, cwd=self.home)
        self.assertEqual(run.returncode, 0, run.stdout[-500:] + run.stderr)
        found = self.gap(ROBOTS / "pendulum.toml", record, "--json")
        result = json.loads(found.stdout)
        self.assertIn(found.returncode, (0, 1, 2), found.stderr)
        self.assertGreater(result["data"]["seconds"], 6)

    def test_same_input_same_output(self):
        first = self.gap(self.robot, *self.rubbing[:2], "--json")
        second = self.gap(self.robot, *self.rubbing[:2], "--json")
        drop = lambda text: {k: v for k, v in json.loads(text).items() if k != "cost"}  # noqa: E731
        self.assertEqual(drop(first.stdout), drop(second.stdout))


if __name__ == "__main__":
    unittest.main(verbosity=2)
