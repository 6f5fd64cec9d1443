"""The page of a gap: one file, looked at in a browser, and a sentence for every JSON that cannot be drawn."""

import copy
import json
import os
import re
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent / "pages")]

import numpy as np  # noqa: E402

from browser import CHROMIUM, Browser  # noqa: E402
from page_fixture import gap_result  # noqa: E402
from schema_check import problems  # noqa: E402
from tiller_tools import gap_report, page, table  # noqa: E402

VERDICTS = ("no_gap", "named", "ambiguous", "partly_explained", "unnamed", "leading", "off_prior", "unfit")


class Page(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def draw(self, result: dict) -> Path:
        file = self.folder / "gap.json"
        file.write_text(json.dumps(result))
        return gap_report.write_report(file, self.folder / "gap.html")

    def test_schema_takes_what_it_should_and_nothing_else(self):
        for verdict in VERDICTS:
            self.assertEqual(problems(gap_result(verdict)), [])
        for change in (lambda r: r.pop("verdict"), lambda r: r.update(verdict="perhaps"), lambda r: r.update(more=1),
                       lambda r: r["ranking"][0].pop("effects"), lambda r: r["where"]["maps"][0]["bins"][0].update(low="x"),
                       lambda r: r["ranking"][0]["parameters"][0].update(interval_95=[1]), lambda r: r.update(version=2)):
            bad = copy.deepcopy(gap_result("named"))
            change(bad)
            self.assertNotEqual(problems(bad), [])

    def test_every_verdict_has_a_page_that_loads_nothing(self):
        for verdict in VERDICTS:
            text = self.draw(gap_result(verdict)).read_text()
            for loads in ("<script", "<link", "<img", "@import", "src="):
                self.assertNotIn(loads, text, "the page must load nothing")
            for address in re.findall(r'(?:href|url)\W{0,3}(https?:[^"\')]*)', text):
                self.fail(f"the page refers to {address}")
            self.assertIn(f"A sentence about &lt;{verdict}&gt;", text)
            self.assertIn("arm &lt;1&gt;", text)
            self.assertLess(text.index("A sentence about"), text.index("What to do next"))
            ids = re.findall(r'\bid="([^"]*)"', text)
            self.assertEqual(len(ids), len(set(ids)))
            self.assertLess(len(text), 3_000_000)

    def test_what_changed_has_a_section_of_its_own(self):
        changed = {"name": "mass_kg", "unit": "kg", "of": "robot_file", "before": 0.5, "before_sd": 0.002, "after": 0.6,
                   "after_sd": 0.002, "change": 0.1, "interval_95": [0.094, 0.106]}
        new = {"name": "torque_Nm.delay_s", "unit": "s", "of": "effect", "before": None, "before_sd": None, "after": 0.02,
               "after_sd": 0.001, "change": 0.02, "interval_95": [0.018, 0.022]}
        other = {**changed, "name": "joint.friction_SI", "change": 0.001, "interval_95": [-0.002, 0.004]}
        before = {"logs": ["runs/old.csv"], "hash": "fnv1a-1", "seconds": 40.0, "verdict": "named",
                  "sentence": "It was <so>.", "sigma": 1.02, "robot_file": None}
        for verdict, words in (("named", "what changed has a name"), ("no_gap", "nothing changed")):
            result = gap_result(verdict)
            result["change"] = {"before": before, "frozen_sigma": 4.2, "others": [other],
                                "changed": [changed, new] if verdict == "named" else []}
            result["ranking"][0]["effects"] = [{"kind": "changed_parameter", "port_kind": "parameter", "port": "mass_kg"}]
            self.assertEqual(problems(result), [])
            text = self.draw(result).read_text()
            for said in (words, "What changed", "joint.friction_SI", "old.csv", "It was &lt;so&gt;."):
                self.assertIn(said, text)
            self.assertEqual("torque_Nm.delay_s" in text, verdict == "named")

    def test_what_each_verdict_tells(self):
        ambiguous = self.draw(gap_result("ambiguous")).read_text()
        for word in ("cannot be told apart", "tiller excite", "move slowly through standstill", "● coulomb friction",
                     "● stribeck friction", "force = -friction sign(v)", "499 permutations", "0.1010 N m",
                     "fnv1a-4567"):
            self.assertIn(word, ambiguous)
        unfit = self.draw(gap_result("unfit")).read_text()
        self.assertIn("runs/a.csv:302", unfit)
        self.assertNotIn("Where it is", unfit)
        self.assertIn("out/arm_gap.toml", self.draw(gap_result("named")).read_text())
        self.assertIn("residual", self.draw(gap_result("unnamed")).read_text())
        self.assertIn("mass_kg at its lower bound 0.5: widen the prior in <code>arm.toml</code>", ambiguous)

    def test_the_force_that_the_model_lacks_is_drawn_over_time(self):
        result = gap_result("named")
        text = self.draw(result).read_text()
        self.assertIn("joint: the force that the model lacks", text)
        self.assertIn("Along a.csv", text)
        result["where"]["forces"] = []
        self.assertNotIn("the force that the model lacks", self.draw(result).read_text())

    def test_a_strong_map_without_a_region_is_not_told_as_nothing(self):
        result = gap_result("named")
        result["where"]["region"] = None
        self.assertIn("beyond chance (z = 61.0)", self.draw(result).read_text())
        for m in result["where"]["maps"]:
            m.update(p_value=0.4, z=1.0)
        text = self.draw(result).read_text()
        self.assertIn("no stronger than chance makes one of them: z = 1.00, probability 0.40", text)
        self.assertNotIn("beyond chance (", text)

    def test_every_figure_of_the_gap_says_of_which_windows_it_is(self):
        """The sentence's gap is that of the windows worked on, and stands in the table beside those of the proof."""
        text = self.draw(gap_result("named")).read_text()
        table = text[text.index("windows worked on"):text.index("</table>", text.index("windows worked on"))]
        self.assertIn("<td>40</td><td>5.45 σ</td><td>1.01 σ</td>", table)
        self.assertIn("<td>1 s, kept for the proof</td><td>12</td><td>5.20 σ</td><td>1.02 σ</td>", table)
        facts = text[text.index("<ul class=facts>"):text.index("</ul>", text.index("<ul class=facts>"))]
        self.assertIn("<b>5.45 σ</b><span>gap, before</span>", facts)
        self.assertIn("<b>1.02 σ</b><span>after, at worst</span>", facts)

    def test_a_robot_of_sixteen_joints_has_longer_tables_not_wider_ones(self):
        def widest(channels: int) -> tuple[int, int]:
            tables = re.findall(r"<table.*?</table>", self.draw(gap_result("named", channels)).read_text(), re.S)
            return max(t.count("<th>") for t in tables), max(t.count("<tr>") for t in tables)

        self.assertEqual(widest(16)[0], widest(1)[0])
        self.assertGreater(widest(16)[1], widest(1)[1])

    def test_same_result_same_page(self):
        page._figures = 0
        first = self.draw(gap_result("named")).read_bytes()
        page._figures = 0
        self.assertEqual(first, self.draw(gap_result("named")).read_bytes())

    def test_bad_files(self):
        for text, word in (("{", "not valid JSON"), ("{}", "is no result"),
                           ('{"format": "tiller-gap", "version": 9}', "version 9"),
                           ('{"format": "tiller-gap", "version": 1}', "no key")):
            file = self.folder / "bad.json"
            file.write_text(text)
            with self.assertRaises(table.ReportError) as caught:
                gap_report.write_report(file, self.folder / "bad.html")
            self.assertIn(word, str(caught.exception))
        self.assertFalse((self.folder / "bad.html").exists())
        self.assertEqual(gap_report.main([str(self.folder / "none.json")]), 1)

    @unittest.skipUnless(CHROMIUM, "no chromium: ./dev setup installs it")
    def test_in_a_browser(self):
        out = self.draw(gap_result("ambiguous"))
        browser = Browser(self.folder, out)
        shot = browser.screenshot()
        self.assertGreater(shot.shape[0], 1000)
        inked = np.mean(np.any(shot < 0.95, axis=2))  # about 0.12 of this page
        self.assertGreater(inked, 0.03)
        self.assertLess(inked, 0.6)
        colors = np.unique((shot[::3, ::3] * 15).astype(int).reshape(-1, 3), axis=0)
        self.assertGreater(len(colors), 20)
        for third in np.array_split(shot, 3):  # no part of it is empty
            self.assertGreater(np.mean(np.any(third < 0.95, axis=2)), 0.01)
        document, console, asked = browser.load()
        for word in ("several effects explain the gap equally well", "What it is", "Where it is", "mass_kg", "<svg"):
            self.assertIn(word, document)
        self.assertEqual(console, [])
        self.assertEqual(asked, [])

    @unittest.skipUnless(CHROMIUM, "no chromium: ./dev setup installs it")
    def test_the_browser_would_have_told(self):
        bad = self.folder / "bad.html"
        bad.write_text('<body><script>console.error("no")</script><img src="http://tiller-test.example/x.png"></body>')
        _, console, asked = Browser(self.folder, bad).load()
        self.assertTrue(any("no" in line for line in console), console)
        self.assertIn("http://tiller-test.example/x.png", asked)


if __name__ == "__main__":
    unittest.main(verbosity=2)
