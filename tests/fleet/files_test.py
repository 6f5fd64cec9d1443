"""What a result depends on, what is kept, and what a pool does with processes that die: with a stand-in command."""

import os
import stat
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

from tiller_tools.fleet import files, jobs, make, pool, store  # noqa: E402
from tiller_tools.fleet.files import DiskFull, FleetError  # noqa: E402

# Answers with its arguments; the first run of a log that says "die" kills itself.
COMMAND = """#!/bin/sh
[ "$1" = --version ] && { echo "tiller 9.9, test"; exit 0; }
if grep -q die "$3" && [ ! -e "$MARK" ]; then : >"$MARK"; kill -9 $$; fi
if grep -q refuse "$3"; then echo "$3:1: no good" >&2; exit 1; fi
printf '{"tiller":"9.9","robot":"r","logs":[],"warnings":[],"candidates":[{"name":"%s","noise_scale":1}]}' "$3"
"""


class Fleet(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.write("robot.toml", "[model]\nfile = 'own.hpp'\n")
        self.write("own.hpp", "// a model")
        self.write("a.csv", "time_s\n1\n")
        self.write("b/one.csv", "time_s\n2\n")
        self.write("b/two.csv", "time_s\n3\n")

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    def packages(self, what="identify", options=(), version="tiller 9.9"):
        found = jobs.jobs_of(jobs.find_robots(self.folder), what)
        return {j.name: jobs.pack(j, what, list(options), version, jobs.RobotFiles()) for j in found}

    def test_robots_and_their_logs(self):
        self.assertEqual(list(self.packages()), ["a", "b.one", "b.two"])
        self.assertEqual(list(self.packages("gap")), ["a", "b"])
        self.assertEqual(self.packages("gap")["b"].arguments,
                         ["gap", "robot.toml", "b.logs/one.csv", "b.logs/two.csv", "--json"])

    def test_the_signature_is_that_of_all_that_matters(self):
        before = {name: p.signature for name, p in self.packages().items()}
        self.assertEqual(before, {name: p.signature for name, p in self.packages().items()})
        changes = {"log": lambda: self.write("a.csv", "time_s\n7\n"), "model": lambda: self.write("own.hpp", "// new"),
                   "robot file": lambda: self.write("robot.toml", "[model]\nfile = 'own.hpp' # \n")}
        seen = {before["a"]}
        for what, change in changes.items():
            change()
            seen.add(self.packages()["a"].signature)
            self.assertEqual(len(seen), 2 + list(changes).index(what), what)
        seen.add(self.packages(options=["--particles", "256"])["a"].signature)
        seen.add(self.packages(version="tiller 10")["a"].signature)
        self.assertEqual(len(seen), 6)

    def test_what_a_robot_file_names_travels_along(self):
        self.assertEqual(self.packages()["a"].files["own.hpp"], b"// a model")
        self.write("robot.toml", "[model]\nfile = '../own.hpp'\n")
        (self.folder.parent / "own.hpp").write_text("")
        self.addCleanup((self.folder.parent / "own.hpp").unlink)
        with self.assertRaisesRegex(FleetError, "copy it there"):
            self.packages()

    def test_a_fleet_that_is_none(self):
        with tempfile.TemporaryDirectory() as empty, self.assertRaisesRegex(FleetError, "no log in it"):
            jobs.find_robots(empty)
        self.write("b.csv", "time_s\n")
        with self.assertRaisesRegex(FleetError, "'b' is there twice"):
            jobs.find_robots(self.folder)
        (self.folder / "b.csv").unlink()
        (self.folder / "robot.toml").unlink()
        with self.assertRaisesRegex(FleetError, "no such robot file"):
            jobs.find_robots(self.folder)

    def command(self):
        path = self.write("command", COMMAND)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        os.environ["MARK"] = str(self.folder / "mark")
        return str(path)

    def run_pool(self, tiller):
        got = {}
        pool.Pool(2, tiller, "tiller 9.9").run(iter(self.packages().values()), lambda p, ran: got.update({p.name: ran}))
        return got

    def test_a_killed_process_is_run_again(self):
        self.write("b/one.csv", "die")
        got = self.run_pool(self.command())
        self.assertTrue((self.folder / "mark").exists())
        self.assertEqual({name: ran["code"] for name, ran in got.items()}, {"a": 0, "b.one": 0, "b.two": 0})

    def test_another_version_is_refused(self):
        with self.assertRaisesRegex(FleetError, "no `tiller` of version 'tiller 9.8'"):
            pool.Pool(1, self.command(), "tiller 9.8").run(iter(self.packages().values()), lambda p, ran: None)

    def test_answers_and_refusals_are_kept(self):
        self.write("a.csv", "refuse")
        kept = store.Store(self.folder / "out", "identify")
        for name, ran in self.run_pool(self.command()).items():
            kept.put(name, "s", ran)
        self.assertEqual(kept.get("b.one", "s")["result"]["name"], "b.logs/one.csv")
        self.assertIn("no good", kept.get("a", "s")["refusal"])
        self.assertIsNone(kept.get("a", "another"))
        kept.path("a").write_text('{"signature": "s", "resu')
        self.assertIsNone(kept.get("a", "s"))

    def test_a_full_disk_leaves_what_was_there(self):
        path = self.write("result.json", "old")
        with mock.patch.object(files.os, "fsync", side_effect=OSError(28, "No space left on device")):
            with self.assertRaisesRegex(DiskFull, "same command again"):
                files.replace_file(path, b"new")
        self.assertEqual(path.read_text(), "old")
        self.assertEqual([p.name for p in self.folder.iterdir() if p.name.endswith(".tmp")], [])

    def test_a_simulated_fleet_is_the_same_bytes(self):
        for name in ("one", "two"):
            make.make(self.folder / name, 6, 2, 1.0, 3)
        for path in (self.folder / "one").iterdir():
            self.assertEqual(path.read_bytes(), (self.folder / "two" / path.name).read_bytes())

    def test_its_pendulum_keeps_its_energy(self):
        """No torque, no damping: the Runge-Kutta steps lose less than 1e-6 of it in ten seconds."""
        plants = make.Plants(make.np.array([[0.5, 0.0]]), {})
        angle, rate = make.np.array([1.0]), make.np.array([0.0])
        energy = lambda: 0.5 * 0.5 * 0.25 * rate**2 - 0.5 * 9.81 * 0.5 * make.np.cos(angle)
        before = energy()
        for _ in range(2000):
            angle, rate = plants.step(angle, rate, 0.0, 0.005)
        self.assertAlmostEqual(float(energy()[0]), float(before[0]), delta=1e-6)


if __name__ == "__main__":
    unittest.main()
