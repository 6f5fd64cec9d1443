"""`tiller fleet` from a simulated fleet to its page: the same bytes after a kill, and the odd robot named."""

import json
import os
import signal
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

TILLER = os.environ["TILLER_COMMAND"]


def tiller(*arguments, **how):
    return subprocess.run([TILLER, "fleet", *map(str, arguments)], capture_output=True, text=True, check=False, **how)


def results(out: Path) -> dict:
    return {p.name: p.read_bytes() for p in (out / "results").glob("*.json")}


class Command(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.fleet = Path(folder.name) / "fleet"
        made = tiller("make", cls.fleet, "--robots", 9, "--odd", 1, "--seed", 1002)
        assert made.returncode == 0, made.stderr
        cls.first = tiller("identify", cls.fleet, "--jobs", 1, "--", "--particles", 64)

    def test_end_to_end(self):
        self.assertEqual(self.first.returncode, 0, self.first.stderr)
        self.assertIn("[9/9] ", self.first.stderr)
        self.assertIn(" left", self.first.stderr)
        result = json.loads((self.fleet / "fleet_identify/fleet.json").read_text())
        self.assertEqual(len(result["robots"]), 9)
        self.assertEqual([p["name"] for p in result["population"]["parameters"]], ["mass_kg", "damping_Nms"])
        page = (self.fleet / "fleet_identify/fleet.html").read_text()
        for robot in result["robots"]:
            self.assertIn(robot["robot"], page)
        self.assertNotIn("http://", page.replace("http://www.w3.org", ""))

    def test_a_rerun_fits_nothing_and_a_changed_log_again(self):
        again = tiller("identify", self.fleet, "--", "--particles", 64)
        self.assertIn("9 of 9 are fitted already", again.stderr)
        log = self.fleet / "robot_5.csv"
        text = log.read_text()
        log.write_text(text.rsplit("\n", 2)[0] + "\n")
        self.addCleanup(log.write_text, text)
        changed = tiller("identify", self.fleet, "-o", self.fleet / "fleet_identify", "--", "--particles", 64)
        self.assertIn("8 of 9 are fitted already", changed.stderr)
        self.assertIn("robot_5", changed.stderr)
        log.write_text(text)
        tiller("identify", self.fleet, "--", "--particles", 64)

    def test_a_killed_run_goes_on_to_the_same_bytes(self):
        out = self.fleet.parent / "killed"
        command = [TILLER, "fleet", "identify", self.fleet, "-o", out, "-j", "2", "--", "--particles", "64"]
        run = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        while run.poll() is None and len(list(out.glob("results/*.json"))) < 2:
            time.sleep(0.02)
        run.send_signal(signal.SIGKILL)
        run.wait()
        self.assertGreaterEqual(len(results(out)), 2)
        rest = tiller("identify", self.fleet, "-o", out, "-j", "2", "--", "--particles", "64")
        self.assertEqual(rest.returncode, 0, rest.stderr)
        self.assertEqual(results(out), results(self.fleet / "fleet_identify"))
        self.assertEqual((out / "fleet.json").read_bytes(), (self.fleet / "fleet_identify/fleet.json").read_bytes())

    def test_gap_names_the_effect_of_one_robot_and_why_a_log_is_of_no_use(self):
        fleet = self.fleet.parent / "longer"
        self.assertEqual(tiller("make", fleet, "--robots", 8, "--odd", 2, "--seed", 3, "--seconds", 24).returncode, 0)
        (fleet / "too_short.csv").write_text((self.fleet / "robot_1.csv").read_text())
        ran = tiller("gap", fleet, "--jobs", 2)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        result = json.loads((fleet / "fleet_gap/fleet.json").read_text())
        truth = json.loads((fleet / "truth.json").read_text())["odd"]
        self.assertEqual([r["robot"] for r in result["robots"] if "coulomb_friction (joint)" in r["effects"]],
                         [name for name, odd in truth.items() if odd["kind"] == "dry_friction"])
        self.assertEqual([r["robot"] for r in result["refused"]], ["too_short"])
        self.assertIn("too short; record at least", ran.stdout)

    def test_what_is_wrong_is_said(self):
        gone = tiller("identify", self.fleet / "nowhere")
        self.assertEqual(gone.returncode, 1)
        self.assertIn("is no folder", gone.stderr)
        quiet = tiller("identify", self.fleet, "--scheduler", "tcp://127.0.0.1:1", "--fresh")
        self.assertEqual(quiet.returncode, 1)
        self.assertRegex(quiet.stderr, "dask scheduler|pip install distributed")


if __name__ == "__main__":
    unittest.main()
