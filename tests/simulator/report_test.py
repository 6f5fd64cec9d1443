"""The page of `tiller infer`: what must be on it, and what it says of a file that is none."""

import json
import os
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])
from tiller_tools import infer_report  # noqa: E402


def result(rounds: int = 3) -> dict:
    draws = [[0.3 + 0.001 * (i % 37), 1.0 - 0.002 * (i % 23)] for i in range(120)]
    prior = [[0.1 + 0.8 * (i % 41) / 41, 2.0 * (i % 29) / 29] for i in range(120)]
    learnt = {"fixed": False, "mean": 0.318, "sd": 0.01, "median": 0.318, "interval_90": [0.302, 0.334],
              "prior": {"interval_90": [0.14, 0.86]}}
    return {"tiller": "0.1", "simulator": "puck <1>", "simulator_file": "puck.toml", "command": ["python3", "puck.py"],
            "period_s": 0.02, "method": {"name": "bayes_sim", "citation": "RSS 2019", "caveat": "a caveat"},
            "summary": "linear", "simulations": 5000, "failed": 3, "pieces": 2, "periods": 200, "seconds": 3.25,
            "effective_samples": 3000.0, "warnings": ["3 of 5000 simulations failed"], "logs": ["logs/run1.csv"],
            "parameters": [{"name": "friction", "unit": "1", **learnt},
                           {"name": "mass_kg", "unit": "kg", "fixed": True, "mean": 0.5},
                           {"name": "length_m", "unit": "m", **learnt}],
            "rounds": [{"mean": [0.3, 0.5, 1.0], "sd": [0.1, 0.0, 0.1]}] * rounds, "samples": draws,
            "prior_samples": prior}


class InferReport(unittest.TestCase):
    def test_tells_the_result(self):
        page = infer_report.build(result())
        for text in ("puck &lt;1&gt;", "friction", "length_m", "0.3020 .. 0.3340", "known", "run1.csv",
                     "3 of 5000 simulations failed", "a caveat", "python3 puck.py", "From round to round"):
            self.assertIn(text, page)
        self.assertEqual(page.count("<figure"), 5)  # two marginals, pairs, two by round

    def test_leaves_out_rounds_where_there_was_one(self):
        self.assertNotIn("From round to round", infer_report.build(result(rounds=1)))

    def test_refuses_another_file(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "infer.json"
            path.write_text(json.dumps({"candidates": []}), encoding="utf-8")
            self.assertEqual(infer_report.main([str(path)]), 1)
            path.write_text(json.dumps(result()), encoding="utf-8")
            self.assertEqual(infer_report.main([str(path)]), 0)
            self.assertTrue((Path(folder) / "infer.html").stat().st_size > 1000)


if __name__ == "__main__":
    unittest.main()
