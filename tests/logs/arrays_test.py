"""Logs in MAT and NPZ: what of them becomes a column, and what is said of those that cannot be read."""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])
from tiller_tools import channels, table  # noqa: E402

ROOT = Path(os.environ["TILLER_SOURCE"])


class Arrays(unittest.TestCase):
    def setUp(self):
        self.home = tempfile.TemporaryDirectory()
        self.folder = Path(self.home.name)
        self.addCleanup(self.home.cleanup)

    def columns(self, path, element=None):
        return channels.columns_of(channels.load_arrays(path, channels.first_bytes(path)), element, path)

    def test_vectors_and_matrices_are_columns(self):
        path = self.folder / "run.npz"
        q = np.arange(12.0).reshape(6, 2)
        np.savez(path, t=np.arange(6) * 0.1, q=q, across=q.T, gain=3.0, note="words", other=np.zeros(4))
        columns = self.columns(path)
        self.assertEqual(list(columns), ["t", "q.0", "q.1", "across.0", "across.1"])
        self.assertEqual((columns["t"][5], columns["q.1"][5], columns["across.1"][5]), (0.5, 11, 11))

    def test_columns_that_lack_are_told_with_those_that_are_there(self):
        path = self.folder / "run.npz"
        np.savez(path, t=np.arange(3.0), q=np.array([1.0, np.nan, 3.0]))
        topics, clocks, found, names, problems, note = channels.read(str(path), ["t", "qq"])
        self.assertEqual((topics, clocks, names, note), (False, [], ["t", "q"], ""))
        self.assertEqual([name for name, _, _ in found], ["t"])
        self.assertIn("it has: t, q (did you mean 'q'?)", problems["qq"])

    def test_runs_of_a_published_file(self):
        path = ROOT / "data/multiarm_pendulum/single_pendulum.mat"
        columns = self.columns(path, 3)
        self.assertEqual({len(v) for v in columns.values()}, {9167})
        self.assertEqual(set(columns), {"Time_id", "Y_id.0", "Y_id.1"})  # there are two runs for validation
        self.assertIn("Time_vad", self.columns(path, 0))
        for element, said in ((None, "holds 4 runs"), (4, "no #4")):
            with self.assertRaisesRegex(table.ReportError, said):
                self.columns(path, element)

    def test_a_pendulum_that_swings_freely(self):
        """From the published bytes and a robot file written before: friction by name, the length as published."""
        folder = ROOT / "data/multiarm_pendulum"
        logs = [f"{folder / 'single_pendulum.mat'}#{k}" for k in range(4)]
        run = subprocess.run([os.environ["TILLER_COMMAND"], "gap", folder / "free_pendulum.toml", *logs, "--json"],
                             capture_output=True, text=True, check=False)
        result = json.loads(run.stdout)
        self.assertIn(result["verdict"], ("named", "ambiguous"), run.stdout[:2000])
        for i in result["ambiguity"]:
            kinds = {effect["kind"] for effect in result["ranking"][i]["effects"]}
            self.assertTrue(kinds & {"viscous_friction", "quadratic_drag"}, kinds)
        length = next(p["mean"] for p in result["ranking"][0]["parameters"] if p["name"] == "length_m")
        self.assertLess(abs(length / 0.1528 - 1), 0.15)
        self.assertLess(result["remaining_sigma"], 0.2 * result["gate"]["nominal_sigma"])
        self.assertIn("cannot be told", " ".join(result["notes"]))

    def test_what_cannot_be_read_is_told(self):
        broken = self.folder / "broken.npz"
        broken.write_bytes(b"PK\x03\x04 and nothing else")
        empty = self.folder / "empty.npz"
        np.savez(empty, gain=3.0)
        parquet = self.folder / "log.parquet"
        parquet.write_bytes(b"PAR1 and nothing else")
        for path, said in ((broken, "cannot be read"), (empty, "no vector of numbers; it has: gain"),
                           (parquet, "pyarrow|cannot be read"), (self.folder / "none.mat", "no such file")):
            with self.assertRaisesRegex(table.ReportError, said):
                self.columns(path)


if __name__ == "__main__":
    unittest.main()
