"""The pages: one file, nothing from the network, and a sentence for every input that cannot be drawn."""

import os
import re
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

import numpy as np  # noqa: E402

from tiller_tools import identify_report, page, report, table  # noqa: E402

PARAMS = {"pole_mass_kg": (0.05, 0.15, 0.083), "cart.damping_SI": (0.1, 0.3, 0.2)}


def write_run(path: Path, rows: int = 200, drop: tuple = ()) -> Path:
    """A run as RunLog writes it: two states of which one is measured, one input, two parameters."""
    t = 0.02 * np.arange(rows)
    columns = {"time_s": t, "angle_rad": np.cos(t), "force_N": 5 * np.sin(t), "mean.angle_rad": np.cos(t),
               "mean.rate_rad_s": -np.sin(t), "sd.angle_rad": 0.01 + 0 * t, "sd.rate_rad_s": 0.1 + 0 * t}
    for prefix, share in (("mean.", 0.5), ("sd.", None), ("q05.", 0.05), ("q95.", 0.95)):
        for name, (low, high, truth) in PARAMS.items():
            width = (high - low) / (1 + t)
            columns[prefix + name] = width / 3.5 if share is None else truth + (share - 0.5) * width
    columns.update({"ess": 100 + 50 * np.sin(t), "noise_scale": 1 + 0 * t, "plan_cost": np.exp(-t),
                    "iterations": 2 + 0 * t, "tick_us": 2000 + 100 * np.sin(9 * t), "deadline_us": 12000 + 0 * t,
                    "state": ["active"] * rows, "status": ["ok", "rate_limited"] * (rows // 2),
                    "true.angle_rad": np.cos(t), "true.pole_mass_kg": 0.083 + 0 * t})
    names = [name for name in columns if name not in drop]
    with open(path, "w", encoding="utf-8") as file:
        file.write(",".join(names) + "\n")
        for i in range(rows):
            file.write(",".join(str(columns[name][i]) for name in names) + "\n")
    return path


class Pages(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp())

    def expect_error(self, call, *words):
        with self.assertRaises(table.ReportError) as caught:
            call()
        for word in words:
            self.assertIn(word, str(caught.exception))

    def check_page(self, path: Path) -> str:
        text = path.read_text(encoding="utf-8")
        for loads in ("<script", "<link", "<img", "@import", "src="):
            self.assertNotIn(loads, text, "the page must load nothing")
        # names of namespaces are no addresses that anybody fetches
        for address in re.findall(r'(?:href|url)\W{0,3}(https?:[^"\')]*)', text):
            self.fail(f"the page refers to {address}")
        ids = re.findall(r'\bid="([^"]*)"', text)
        self.assertEqual(len(ids), len(set(ids)), "an id that appears twice clips one figure by another's frame")
        for target in set(re.findall(r'href="#([^"]*)"|url\(#([^)]*)\)', text)):
            self.assertIn(target[0] or target[1], ids)
        self.assertIn('name="viewport"', text)
        return text

    def test_run(self):
        out = report.write_report(write_run(self.folder / "run.csv"), self.folder / "run.html")
        text = self.check_page(out)
        for word in ("pole_mass_kg", "cart.damping_SI", "angle_rad", "rate_rad_s", "force_N", "deadline 12 ms",
                     "effective sample size", "rate_limited", "0.08300"):
            self.assertIn(word, text)
        self.assertLess(len(text), 3_000_000)

    def test_run_with_facts_beside_it(self):
        (self.folder / "run.json").write_text('{"title": "a <b> run", "outcome": "upright", "good": true, '
                                              '"limits": {"force_N": [-20, 20]}, "facts": {"seed": "7"}}')
        text = self.check_page(report.write_report(write_run(self.folder / "run.csv"), self.folder / "run.html"))
        self.assertIn("a &lt;b&gt; run", text)
        self.assertIn("upright", text)
        self.assertIn("limit", text)

    def test_run_without_truth_posterior_or_times(self):
        drop = [f"{p}{n}" for p in ("mean.", "sd.", "q05.", "q95.") for n in PARAMS]
        drop += ["true.angle_rad", "true.pole_mass_kg", "ess", "tick_us", "deadline_us", "state", "status"]
        text = self.check_page(
            report.write_report(write_run(self.folder / "run.csv", drop=tuple(drop)), self.folder / "run.html"))
        self.assertNotIn("What was learnt", text)

    def test_same_log_same_page(self):
        run = write_run(self.folder / "run.csv")
        page._figures = 0
        first = report.write_report(run, self.folder / "a.html").read_bytes()
        page._figures = 0
        self.assertEqual(first, report.write_report(run, self.folder / "b.html").read_bytes())

    def test_bad_runs(self):
        write = lambda text: (self.folder / "bad.csv").write_text(text) and self.folder / "bad.csv"  # noqa: E731
        draw = lambda text: report.write_report(write(text), self.folder / "bad.html")  # noqa: E731
        self.expect_error(lambda: report.write_report(self.folder / "none.csv", "x.html"), "none.csv", "no such file")
        self.expect_error(lambda: draw("\n"), "empty")
        self.expect_error(lambda: draw("a,b\n1,2\n"), ":1:", "no column 'time_s'", "a, b")
        self.expect_error(lambda: draw("time_s,force_N\n"), "no rows")
        self.expect_error(lambda: draw("time_s,force_N\n0,1\n0.1\n"), ":3:", "1 values where the header names 2")
        self.expect_error(lambda: draw("time_s,force_N\n0,left\n"), ":2:", "'force_N'", "'left' is not a number")
        self.expect_error(lambda: draw("time_s,force_N,force_N\n0,1,1\n"), "appears 2 times")
        self.expect_error(lambda: draw("time_s,force_N\n,1\n"), "time_s", "empty cells")
        self.assertFalse((self.folder / "bad.html").exists())

    def test_folder_that_cannot_be_written(self):
        run = write_run(self.folder / "run.csv")
        self.expect_error(lambda: report.write_report(run, "/proc/nowhere/run.html"), "cannot be written", "-o")

    def test_command_line(self):
        run = write_run(self.folder / "run.csv")
        self.assertEqual(report.main([str(run)]), 0)
        self.assertTrue((self.folder / "run.html").exists())
        self.assertEqual(report.main([str(self.folder / "none.csv")]), 1)

    def test_bad_fits(self):
        bad = self.folder / "identify.json"
        self.expect_error(lambda: identify_report.write_report(bad, "x.html"), "no such file")
        bad.write_text("{")
        self.expect_error(lambda: identify_report.write_report(bad, "x.html"), "not valid JSON")
        bad.write_text("{}")
        self.expect_error(lambda: identify_report.write_report(bad, "x.html"), "no key 'robot'")

    def test_numbers(self):
        self.assertEqual(page.number(0.45283), "0.4528")
        self.assertEqual(page.number(0.0007, 2), "0.00070")
        self.assertEqual(page.number(1234567.0), "1.235e+06")
        self.assertEqual(page.number(float("nan")), "–")
        self.assertEqual(page.number(0.0), "0")


if __name__ == "__main__":
    unittest.main(verbosity=2)
