"""The pages: one file, nothing from the network, and a sentence for every input that cannot be drawn."""

import json
import os
import re
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

import numpy as np  # noqa: E402

from tiller_tools import identify_report, interval, page, report, table  # noqa: E402

# Meaning of write_run's columns, as run_facts_json gives it.
COLUMNS = {"states": {"angle_rad": "rad", "rate_rad_s": "rad/s"}, "angles": ["angle_rad"], "measured": ["angle_rad"],
           "inputs": {"force_N": "N"}, "parameters": {"pole_mass_kg": "kg", "cart.damping_SI": "N s/m"}, "tracked": []}
PARAMS = {"pole_mass_kg": (0.05, 0.15, 0.083), "cart.damping_SI": (0.1, 0.3, 0.2)}


def write_run(path: Path, rows: int = 200, drop: tuple = (), facts: dict | None = None) -> Path:
    """A run as RunLog writes it: two states of which one is measured, one input, two parameters."""
    path.with_suffix(".json").write_text(json.dumps({"columns": COLUMNS} | (facts or {})))
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
                    "true.angle_rad": np.cos(t) - 0.02 * np.sin(37 * t), "true.pole_mass_kg": 0.083 + 0 * t,
                    "innovation.angle_rad": np.random.default_rng(3).standard_normal(rows),
                    "tick": np.arange(rows), "now_us": 1e6 * t, "stamp_us": 1e6 * t, "adequacy_statistic": 0.5 + 0 * t,
                    "a_column_of_next_year": 1 + 0 * t})
    names = [name for name in columns if name not in drop]
    with open(path, "w", encoding="utf-8") as file:
        file.write(",".join(names) + "\n")
        for i in range(rows):
            file.write(",".join(str(columns[name][i]) for name in names) + "\n")
    return path


def fit_result(learnt: int = 2, history: bool = True, held_out: bool = True, adequacy: bool = True) -> dict:
    """What `tiller identify` leaves: a nominal candidate and one with `learnt` parameters."""
    rng = np.random.default_rng(1)
    curve = list(np.linspace(0.01, 0.3, 100))
    trace = {"path": "runs/c.csv", "state": "angle_rad", "start_s": 0.5, "period_s": 0.02, "measured": curve,
             "mean": curve, **{key: [v + d for v in curve] for key, d in (
                 ("low", -0.1), ("high", 0.1), ("predictive_low", -0.2), ("predictive_high", 0.2))}}
    trace["measured"] = curve[:50] + [None] + curve[51:]
    horizons = [{"horizon_s": 1.0, "rollouts": 40, "rms_end": 0.1, "median_abs_end": 0.05, "rms_along": 0.05,
                 "coverage_90": 0.875},
                {"horizon_s": 2.0, "rollouts": 0, "rms_end": 0, "median_abs_end": 0, "rms_along": 0, "coverage_90": 0}]
    errors = [{"state": "angle_rad", "horizons": horizons, "rms_by_step": curve}]

    def candidate(name: str, learns: bool) -> dict:
        params = [{"name": "mass_kg", "fixed": True, "mean": 1.0}]
        over_time = []
        time = 0.01 * np.arange(200)
        for i in range(learnt if learns else 0):
            width = 1 / (1 + 50 * time)
            params.append({"name": f"damping_{i}_SI", "fixed": False, "mean": 0.5, "sd": 0.01, "median": 0.5,
                           "interval_90": [0.49, 0.51],
                           "prior": {"mean": 0.5, "sd": 0.3, "interval_90": [0.05, 0.95]},
                           "edge": None if i else {"at": "lower bound", "value": 0.0, "by": "physics",
                                                   "text": "damping_0_SI at 0, its bound by physics"}})
            over_time.append({"name": f"damping_{i}_SI", "mean": [0.5] * 200, "low": list(0.5 - 0.5 * width),
                              "high": list(0.5 + 0.5 * width)})
        out = {"name": name, "learns": learns, "parameters": params, "noise_scale": 1.1, "particles": 512,
               "effective_samples": 300.0, "exponent": 1.0, "transitions": 800, "refused": 0, "gated": 0, "diverged": 0,
               "fitted": errors, "held_out": errors if held_out else [], "traces": [trace],
               "samples": (0.5 + 0.01 * rng.standard_normal((512, learnt))).tolist() if learns else [],
               "prior_samples": rng.random((512, learnt)).tolist() if learns else []}
        if adequacy:
            out["alarm"] = None if learns else {"data_s": 0.7, "channel": "angle_rad", "feature": "velocity_sign"}
            out["rollout_sigma"], out["adequate"] = (1.02, True) if learns else (6.31, False)
        if history:
            out["history"] = {"data_s": list(time), "stretches_s": [0.0, 1.2], "parameters": over_time,
                              **{key: [0.5] * 200 for key in ("effective_samples", "noise_scale", "exponent",
                                                              "acceptance", "adequacy")}}
            out["history"]["residuals"] = [
                {"name": name, "low": [None] + [-2.0] * 199, "high": [None] + [40.0] + [2.0] * 198,
                 "rms": [None] + [1.0] * 199} for name in ("angle_rad", "rate_rad_s")]
        return out

    return {"tiller": "0.1", "robot": "arm <1>", "robot_file": "arm.toml", "model": "pendulum", "period_s": 0.02,
            "warnings": ["a warning"], "logs": [{"path": "runs/a.csv"}],
            "held_out": [{"path": "runs/c.csv"}] if held_out else [],
            "candidates": [candidate("nominal", False), candidate("pendulum", learnt > 0)]}


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

    def figures_of(self, run: Path) -> list[str]:
        text = self.check_page(report.write_report(run, self.folder / "run.html"))
        return re.findall(r"<figure[^>]*><h3>([^<]*)</h3>", text)

    def test_only_columns_with_a_role_are_drawn(self):
        self.assertEqual(self.figures_of(write_run(self.folder / "run.csv")),
                         ["posterior of pole_mass_kg", "posterior of cart.damping_SI", "spread of the posterior",
                          "angle_rad", "rate_rad_s", "command force_N", "error of the estimate of angle_rad",
                          "innovation of angle_rad", "effective sample size", "time of a tick"])

    def test_errors_and_innovations_are_told_in_their_own_deviations(self):
        """The error is 0.02 rad times a sine, of an estimate that says 0.01: within 1.645 for 61 % of the time."""
        run = write_run(self.folder / "run.csv", rows=2000)
        text = self.check_page(report.write_report(run, self.folder / "run.html"))
        caption = {name: re.search(rf"<h3>{name}</h3>.*?<figcaption>(.*?)</figcaption>", text, re.S)[1]
                   for name in ("error of the estimate of angle_rad", "innovation of angle_rad")}
        share, rms = re.search(r"([0-9.]+) % of 2000 rows lie in the band, RMS ([0-9]+[.][0-9]+)",
                               caption["error of the estimate of angle_rad"]).groups()
        self.assertAlmostEqual(float(share), 100 * 2 / np.pi * np.arcsin(1.645 / 2), delta=1)
        self.assertAlmostEqual(float(rms), 2 / np.sqrt(2), delta=0.02)
        self.assertIn("At most 0.0200 rad off", caption["error of the estimate of angle_rad"])
        share, rms = re.search(r"([0-9.]+) % of 2000 rows lie in the band, RMS ([0-9]+[.][0-9]+)",
                               caption["innovation of angle_rad"]).groups()
        self.assertAlmostEqual(float(share), 90, delta=2)  # three standard errors of 2000 normal values
        self.assertAlmostEqual(float(rms), 1, delta=0.05)
        without = write_run(self.folder / "run.csv", drop=("innovation.angle_rad", "true.angle_rad"))
        self.assertNotIn("What the estimate missed", self.check_page(report.write_report(without,
                                                                                        self.folder / "run.html")))

    def test_an_error_of_a_whole_turn_is_none(self):
        run = report.read_run(write_run(self.folder / "run.csv"), None)
        truth = run.column("true.angle_rad")
        truth += 2 * np.pi
        self.assertIn("At most 0.0200 rad off", report.estimate_error_figure(run, "angle_rad"))

    def test_what_says_nothing_of_the_columns_is_refused(self):
        run = write_run(self.folder / "run.csv")
        facts = self.folder / "run.json"
        for text in ("{}", "[]", '{"columns": {"states": {}}}', '{"columns": ["force_N"]}'):
            facts.write_text(text)
            self.expect_error(lambda: report.write_report(run, self.folder / "run.html"), "run.json", "'columns'",
                              "tiller run --report")
        facts.unlink()
        self.expect_error(lambda: report.write_report(run, self.folder / "run.html"), "run.json", "no such file",
                          "tiller run --report")
        write_run(run, facts={"columns": COLUMNS | {"inputs": {"torque_Nm": "N m"}}})
        self.expect_error(lambda: report.write_report(run, self.folder / "run.html"), "run.csv", "torque_Nm")

    def test_target_of_an_angle_is_drawn_where_the_run_ended(self):
        run = report.read_run(write_run(self.folder / "run.csv", facts={"target": {"angle_rad": 4 * np.pi}}), None)
        self.assertAlmostEqual(run.target("angle_rad"), 0.0)  # cos t ends within half a turn of it
        self.assertIsNone(run.target("rate_rad_s"))

    def test_run_with_facts_beside_it(self):
        run = write_run(self.folder / "run.csv", facts={
            "title": "a <b> run", "outcome": "upright", "good": True, "limits": {"force_N": [-20, 20]},
            "facts": {"seed": "7"}})
        text = self.check_page(report.write_report(run, self.folder / "run.html"))
        for word in ("a &lt;b&gt; run", "upright", ">limit</text>"):
            self.assertIn(word, text)

    def test_run_without_truth_posterior_or_times(self):
        drop = [f"{p}{n}" for p in ("mean.", "sd.", "q05.", "q95.") for n in PARAMS]
        drop += ["true.angle_rad", "true.pole_mass_kg", "ess", "tick_us", "deadline_us", "state", "status"]
        run = write_run(self.folder / "run.csv", drop=tuple(drop), facts={"columns": COLUMNS | {"parameters": {}}})
        text = self.check_page(report.write_report(run, self.folder / "run.html"))
        self.assertNotIn("What was learnt", text)

    def test_same_log_same_page(self):
        run = write_run(self.folder / "run.csv")
        page._figures = 0
        first = report.write_report(run, self.folder / "a.html").read_bytes()
        page._figures = 0
        self.assertEqual(first, report.write_report(run, self.folder / "b.html").read_bytes())

    def test_bad_runs(self):
        (self.folder / "bad.json").write_text(json.dumps({"columns": COLUMNS}))
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

    def draw_fit(self, **options) -> str:
        path = self.folder / "identify.json"
        path.write_text(json.dumps(fit_result(**options)))
        return self.check_page(identify_report.write_report(path, self.folder / "identify.html"))

    def test_fit(self):
        text = self.draw_fit()
        for word in ("arm &lt;1&gt;", "damping_1_SI", "pairs of parameters", "While the logs were taken in",
                     "effective sample size", "acceptance of moves", "300 of 512", "88 %", "90 % of readings",
                     "rollouts on held-out logs", "a warning", "Does the model explain the logs?", "dry friction",
                     "inadequate", "6.31", "angle_rad, from 0.700 s on", "normalised residuals of rate_rad_s", "1 beyond the axes",
                     "⚠ damping_0_SI at 0, its bound by physics"):
            self.assertIn(word, text)
        self.assertLess(len(text), 2_000_000)

    def test_fit_of_a_method_that_takes_all_data_at_once(self):
        result = fit_result(history=False, adequacy=False)
        step = {"mean": [1.0, 0.5, 0.5], "sd": [0.0, 0.1, 0.1], "temperature": 0.2, "kl": 1.0,
                "effective_samples": 300.0, "discrepancy": 0.3, "smallest_discrepancy": None}
        result["candidates"][-1].update(noise_scale=None, exponent=None, method={
            "name": "trajectory_simopt", "citation": "a paper & its equation", "caveat": "it is no posterior",
            "simulations": 4321, "diverged": 0, "iterations": [step] * 3})
        path = self.folder / "identify.json"
        path.write_text(json.dumps(result))
        text = self.check_page(identify_report.write_report(path, self.folder / "identify.html"))
        self.assertNotIn("While the logs were taken in", text)
        self.assertNotIn("Does the model explain the logs?", text)
        self.assertNotIn("noise over the robot file", text)
        for word in ("damping_1_SI", "trajectory_simopt", "a paper &amp; its equation", "it is no posterior", "4321",
                     "From iteration to iteration", "discrepancy"):
            self.assertIn(word, text)

    def test_fit_of_one_parameter_or_none(self):
        self.assertNotIn("pairs of parameters", self.draw_fit(learnt=1))
        text = self.draw_fit(learnt=0, held_out=False)
        self.assertNotIn("While the logs were taken in", text)
        self.assertIn("rollouts on fitted logs", text)

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

    def test_intervals_do_not_collapse(self):
        self.assertEqual(page.interval(9.81, 9.92), "9.810 .. 9.920")
        self.assertEqual(page.interval(1.20001, 1.20049), "1.20001 .. 1.20049")
        self.assertEqual(page.interval(-0.5, 0.25, between=" … "), "-0.5000 … 0.2500")
        self.assertEqual(page.interval(1.2, 1.2), "1.200 .. 1.200")
        self.assertEqual(page.interval(None, 1.2), "– .. 1.200")
        self.assertEqual(page.interval(0.0, 0.0), "0 .. 0")
        self.assertEqual(page.mean(1.2000449, 1.1e-4), "1.20004")
        self.assertEqual(page.mean(1.2, None), "1.200")
        self.assertEqual(interval.plain_interval(1.20001, 1.20049), "1.20001 .. 1.20049")
        for exponent in range(12):  # the ends differ in what is shown, however narrow
            low, high = 1.2, 1.2 + 10.0 ** -exponent
            for text in (page.interval(low, high), interval.plain_interval(low, high)):
                ends = [float(end) for end in text.split(" .. ")]
                self.assertAlmostEqual((ends[1] - ends[0]) / (high - low), 1.0, delta=0.1, msg=text)


if __name__ == "__main__":
    unittest.main(verbosity=2)
