"""look_test.py FOLDER: the pages of fixed data beside the approved ones; and that a broken page is told from a good
one, and another reader's font is not. TILLER_APPROVE=1 approves the pages: look at their pictures in FOLDER first."""

import itertools
import json
import os
import re
import shutil
import sys
import unittest
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])
sys.path[:0] = [str(HERE), str(HERE.parent / "gap"), str(HERE.parent / "identify")]

import numpy as np  # noqa: E402

import look  # noqa: E402
from browser import CHROMIUM, Browser  # noqa: E402
from page_fixture import gap_result  # noqa: E402
from report_test import fit_result, write_run  # noqa: E402
from robots_test import text_of  # noqa: E402
from tiller_tools import gap_report, identify_report, page, report  # noqa: E402

FOLDER = Path(sys.argv.pop() if len(sys.argv) > 1 else "out/pages_look")
RUN_FACTS = {"title": "a run", "outcome": "upright after 2.4 s", "good": True, "limits": {"force_N": [-6, 6]},
             "target": {"angle_rad": 0.0}, "facts": {"planner": "mppi", "seed": "7"}}


def run_page(folder: Path) -> Path:
    return report.write_report(write_run(folder / "run.csv", rows=400, facts=RUN_FACTS), folder / "run.html")


def reference_page(folder: Path) -> Path:
    """A robot in a plane that cuts the corners of its reference, an obstacle, a parameter at its prior's bound."""
    t = 0.02 * np.arange(300)
    at = {"x_m": np.cos(t), "z_m": np.sin(2 * t), "tilt_rad": t}  # the angle's reference stays within a turn
    columns = {"time_s": t, "x_m": at["x_m"], "force_N": np.sin(t)}
    columns |= {f"mean.{name}": 0.9 * values for name, values in at.items()}
    columns |= {f"sd.{name}": 0.02 + 0 * t for name in at}
    columns |= {f"true.{name}": 0.91 * at[name] for name in ("x_m", "z_m")}
    columns |= {"ref.x_m": at["x_m"], "ref.z_m": at["z_m"], "ref.tilt_rad": np.angle(np.exp(1j * t))}
    mass = 0.5 - 0.1 * np.exp(-t)  # of a prior whose width stays
    columns |= {"mean.mass_kg": mass, "sd.mass_kg": 0.02 + 0 * t, "q05.mass_kg": mass - 0.09, "q95.mass_kg": mass}
    write_table(folder / "run.csv", columns)
    facts = {"columns": {"states": {"x_m": "m", "z_m": "m", "tilt_rad": "rad"}, "angles": ["tilt_rad"],
                         "measured": ["x_m"], "inputs": {"force_N": "N"}, "parameters": {"mass_kg": "kg"},
                         "tracked": ["x_m", "z_m", "tilt_rad"]},
             "plane": {"x": "x_m", "y": "z_m", "obstacles": [[0.0, 0.5, 0.2]]},
             "edges": {"mass_kg": {"at": "upper bound", "value": 0.5, "by": "prior",
                                   "text": "mass_kg at its upper bound 0.5: widen the prior"}}}
    (folder / "run.json").write_text(json.dumps(facts))
    return report.write_report(folder / "run.csv", folder / "run.html")


def write_table(path: Path, columns: dict) -> None:
    rows = [",".join(columns)] + [",".join(f"{value:.6g}" for value in row) for row in zip(*columns.values())]
    path.write_text("\n".join(rows) + "\n")


def identify_page(folder: Path) -> Path:
    (folder / "identify.json").write_text(json.dumps(fit_result()))
    return identify_report.write_report(folder / "identify.json", folder / "identify.html")


def gap_page(folder: Path) -> Path:
    (folder / "gap.json").write_text(json.dumps(gap_result("ambiguous")))
    return gap_report.write_report(folder / "gap.json", folder / "gap.html")


@unittest.skipUnless(CHROMIUM, "no chromium: ./dev setup installs it")
class Look(unittest.TestCase):
    def folder(self, name: str) -> Path:
        folder = FOLDER / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder

    def look_at(self, file: Path) -> tuple[list, list]:
        probe, picture = Browser(file.parent, file).look()
        return look.measure(probe, picture), look.faults(probe, picture)

    def approved(self, name: str, figures: list) -> list:
        file = HERE / "approved" / f"{name}.json"
        if os.environ.get("TILLER_APPROVE"):
            file.write_text(text_of(figures), encoding="utf-8")
        return json.loads(file.read_text(encoding="utf-8"))

    def check(self, name: str, make) -> None:
        figures, faults = self.look_at(make(self.folder(name)))
        self.assertEqual(faults, [])
        self.assertEqual(look.differences(figures, self.approved(name, figures), look.SAME_DATA), [])

    def test_run(self):
        self.check("run", run_page)

    def test_reference(self):
        self.check("reference", reference_page)
        text = (FOLDER / "reference" / "run.html").read_text(encoding="utf-8")
        self.assertIn("⚠ mass_kg at its upper bound 0.5: widen the prior", text)
        # a tenth less than cos t, and the reference's turns are those of the robot: 0.09 cos t, and 0.1 t
        self.assertIn("Of the truth: RMS 0.0", text)
        self.assertIn("Of the estimate: RMS 0.3", text)

    def test_identify(self):
        self.check("identify", identify_page)

    def test_gap(self):
        self.check("gap", gap_page)

    # ---- the test of the test: what is done to a page, and what it must say of it

    def after(self, name: str, *changes) -> list[str]:
        """What is said of the run's page after changes of its text."""
        folder = self.folder(name)
        file = run_page(folder)
        text = file.read_text(encoding="utf-8")
        for change in changes:
            bad = change(text)
            self.assertNotEqual(text, bad, "a change found nothing to change")
            text = bad
        file.write_text(text, encoding="utf-8")
        figures, faults = self.look_at(file)
        approved = json.loads((HERE / "approved" / "run.json").read_text(encoding="utf-8"))
        return faults + look.differences(figures, approved, look.SAME_DATA)

    def expect(self, found: list[str], *words: str) -> None:
        self.assertTrue(any(all(word in text for word in words) for text in found), f"{words} not in {found}")

    @staticmethod
    def within(title: str, pattern: str, by: str):
        """A change of one figure: the first match of the pattern in it is replaced."""
        def change(text: str) -> str:
            old = re.search(rf"<figure[^>]*><h3>{re.escape(title)}</h3>.*?</figure>", text, re.S).group(0)
            return text.replace(old, re.sub(pattern, by, old, count=1, flags=re.S))
        return change

    def test_another_font_is_no_difference(self):
        for family in ("serif", "monospace"):
            self.assertEqual(self.after(family, lambda text: text.replace("DejaVu Sans", family)), [])

    def test_what_is_broken_is_told_and_nothing_else(self):
        curve = r'<g id="f\d+-line2d_\d+">\s*<path d="[^"]{400,}"[^>]*/>\s*</g>'  # of many points: not a tick
        limit = r'<g id="f\d+-line2d_\d+">\s*<path d="[^"]*"[^>]*stroke: #b3261e[^>]*/>\s*</g>'
        band = r'<g id="f\d+-(?:FillBetween)?PolyCollection_\d+">.*?</g>'
        found = self.after(
            "broken",
            self.within("effective sample size", curve, ""),
            self.within("command force_N", limit, ""), self.within("command force_N", limit, ""),
            self.within("posterior of pole_mass_kg", band, ""),
            self.within("angle_rad", r'(<g id="f\d+-legend_\d+")', r'\1 transform="translate(0 60)"'),
            self.within("rate_rad_s", r">time \(s\)</text>", ">" + 90 * "W" + "</text>"),
            self.within("time of a tick", r">ticks</text>", "></text>"),
            lambda text: text.replace("<td>0.08300</td>", "<td>0.083000000000000004</td>", 1))
        self.expect(found, "effective sample size: a plot is empty")
        self.expect(found, "command force_N", "are red")
        self.expect(found, "posterior of pole_mass_kg", "are band")
        self.expect(found, "posterior of pole_mass_kg", "brightness")
        self.expect(found, "angle_rad: the legend lies over the plot")
        self.expect(found, "rate_rad_s: the text 'WWW", "leaves the figure")
        self.expect(found, "time of a tick: an axis has no label")
        self.expect(found, "missing: time of a tick")
        self.expect(found, "the number 0.083000000000000004 has too many digits")
        for text in found:
            self.assertNotIn("cart.damping_SI", text, "that figure was left as it is")

    def test_texts_that_overlap_or_overflow_are_told(self):
        found = self.after("overlap", lambda text: text.replace(
            "</head>", "<style>svg text { font-size: 30px !important; }</style></head>"),
            lambda text: text.replace("<h1>a run</h1>", f"<h1>{200 * 'W'}</h1>"))
        self.expect(found, "angle_rad: the texts", "overlap")
        self.expect(found, "wider than the window", "H1")

    def test_figures_that_are_missing_or_too_many_are_told(self):
        approved = json.loads((HERE / "approved" / "run.json").read_text(encoding="utf-8"))
        self.assertEqual(look.differences(approved, approved, look.SAME_DATA), [])
        self.expect(look.differences(approved[1:], approved, look.SAME_DATA), "missing: posterior of pole_mass_kg | ti")
        extra = approved + [approved[0] | {"title": "command now_us"}]
        self.expect(look.differences(extra, approved, look.SAME_DATA), "not expected: command now_us")
        without_unit = [approved[0] | {"y": ["value"]}] + approved[1:]
        self.expect(look.differences(without_unit, approved, look.SAME_DATA), "missing: posterior of pole_mass_kg")


class Colours(unittest.TestCase):
    """Curves are told apart by their colours alone, also by colour-blind readers (Machado, Oliveira and Fernandes 2009,
    severity 1)."""

    SIGHT = {
        "full": np.eye(3),
        "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
        "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]}

    @staticmethod
    def lab(colour: str, sight) -> np.ndarray:
        srgb = np.array([int(colour[i:i + 2], 16) / 255 for i in (1, 3, 5)])
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        seen = np.clip(np.array(sight) @ linear, 0, 1)
        xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ seen
        f = np.cbrt(np.maximum(xyz / [0.9505, 1.0, 1.089], 1e-4))
        return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])

    def nearest(self, colours: list) -> float:
        return min(float(np.linalg.norm(self.lab(a, sight) - self.lab(b, sight)))
                   for sight in self.SIGHT.values() for a, b in itertools.combinations(colours, 2))

    def test_curves_stay_apart(self):
        # 2.3 is just noticeable side by side; thin lines with the page's white between them ask for several times that
        self.assertGreater(self.nearest(page.CYCLE), 15)
        self.assertGreater(self.nearest([page.ESTIMATE, page.TRUTH, page.MEASURED]), 15)
        self.assertGreater(self.nearest([page.ESTIMATE, page.LIMIT]), 15)
        self.assertGreater(self.nearest([page.ESTIMATE, page.BAND, page.PRIOR]), 15)

    def test_the_measure_tells_what_was_wrong_once(self):
        self.assertLess(self.nearest(["#1f5fa8", "#7a4fa3"]), 3, "blue and purple are one to a protan reader")

    def test_no_two_curves_share_their_dashes(self):
        self.assertEqual(len({str(dash) for dash in page.DASHES}), len(page.CYCLE))


if __name__ == "__main__":
    unittest.main(verbosity=2)
