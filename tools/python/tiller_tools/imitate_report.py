"""One page about a learnt cost: python -m tiller_tools.imitate_report imitate.json -o imitate.html

The JSON is what `tiller imitate --page FOLDER` writes: weights with their intervals, and for each demonstration what
the robot file's weights and the learnt ones do from the same start.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from . import page
from .table import ReportError, read_json, write_page


def _array(values) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def _judgement(weight: dict) -> str:
    if not weight["varies"]:
        return "its feature has no slope in any demonstration: stays"
    return "" if weight["identified"] else "not identified: stays near the file's"


def _interval(weight: dict) -> str:
    low, high = weight["interval_90"]
    return "–" if low is None or high is None else f"{page.number(low)} .. {page.number(high)}"


def weights_table(result: dict) -> str:
    body = [[w["key"], page.number(w["file"]), page.number(w["value"]), _interval(w), _judgement(w)]
            for w in result["weights"]]
    body += [[k["key"], page.number(k["value"]), page.number(k["value"]), "kept", ""] for k in result["kept"]]
    return page.rows(["weight", "file", "learnt", "90 % interval", ""], body)


def weights_figure(result: dict) -> str | None:
    """Each weight over the file's, with its interval."""
    drawn = [w for w in result["weights"] if w["varies"] and w["interval_90"][0]]
    if not drawn:
        return None
    figure, ax = page.axes("weights over the file's", "", "learnt / file", height=0.9 + 0.34 * len(drawn))
    for row, w in enumerate(reversed(drawn)):
        low, high = (bound / w["file"] for bound in w["interval_90"])
        ax.plot([low, high], [row, row], color=page.BAND if w["identified"] else page.MEASURED, linewidth=5)
        ax.plot([w["value"] / w["file"]], [row], "o", color=page.ESTIMATE)
    ax.axvline(1.0, color=page.MEASURED, linewidth=1)
    ax.set_xscale("log")
    ax.set_yticks(range(len(drawn)), [w["key"].removeprefix("cost.") for w in reversed(drawn)], fontsize=8)
    return page.svg(figure, "Bars: 90 % by the curvature of the likelihood. A grey bar is a weight that the "
                            "demonstrations do not tell.")


def channel_figure(demonstration: dict, kind: str, name: str, unit: str) -> str:
    """What was demonstrated beside what the two costs do."""
    shown = _array(demonstration["demonstrated"][kind][name])
    time = demonstration["period_s"] * np.arange(shown.size)
    figure, ax = page.axes(name, page.quantity_label(name, unit), height=2.6)
    measured = demonstration["measured"].get(name) if kind == "states" else None
    if measured and np.isfinite(_array(measured)).any():
        ax.plot(demonstration["period_s"] * np.arange(len(measured)), _array(measured), ".", markersize=2,
                color=page.MEASURED, label="measured")
    cut = page.thin(shown.size)
    ax.plot(time[cut], shown[cut], color=page.INK, label="demonstrated")
    ax.plot(time[cut], _array(demonstration["before"][kind][name])[cut], color=page.MEASURED, linestyle=(0, (5, 2)),
            label="file's cost")
    ax.plot(time[cut], _array(demonstration["after"][kind][name])[cut], color=page.ESTIMATE, linestyle=(0, (3, 1)),
            label="learnt cost")
    page.legend(ax)
    return page.svg(figure)


def demonstration_section(result: dict, demonstration: dict) -> str:
    units = result["units"]
    figures = [channel_figure(demonstration, kind, name, units.get(name, ""))
               for kind in ("states", "inputs") for name in demonstration["demonstrated"][kind]]
    facts = page.facts([("distance, learnt cost", page.number(demonstration["distance_after"], 3)),
                        ("distance, file's cost", page.number(demonstration["distance_before"], 3)),
                        ("inputs at limits", f"{100 * demonstration['at_limits']:.0f} %"),
                        ("misfit of the model", page.number(demonstration["misfit"], 3))])
    return f"<h2>{page.html.escape(demonstration['path'])}</h2>{facts}{page.grid(figures)}"


def _headline(result: dict) -> str:
    unknown = [w["key"] for w in result["weights"] if w["varies"] and not w["identified"]]
    still = [w["key"] for w in result["weights"] if not w["varies"]]
    text = [f"{len(result['weights']) - len(unknown) - len(still)} of {len(result['weights'])} weights are told by the "
            f"demonstrations."]
    if unknown:
        text.append("Not identified: " + ", ".join(unknown) + ".")
    if still:
        text.append("Without a slope anywhere: " + ", ".join(still) + ".")
    text += [f"{a} and {b} are told as a ratio alone." for a, b in result["alike"]]
    return " ".join(text)


def write_report(source: str | Path, out: str | Path) -> str:
    result = read_json(source)
    horizon = f"a horizon of {result['horizon']} periods" if result["horizon"] else "each one plan to its end"
    body = f"<h1>{page.html.escape(result['robot'])}: a cost from demonstrations</h1>"
    body += f"<p>Method {page.html.escape(result['method'])}; {horizon}.</p>" + page.warnings(result["warnings"])
    body += page.outcome(_headline(result), None) + weights_table(result)
    figure = weights_figure(result)
    body += page.grid([figure]) if figure else ""
    body += "".join(demonstration_section(result, d) for d in result["demonstrations"])
    body += "<p>Distance: RMS of the states from the demonstrated ones, each over its spread there.</p>"
    write_page(out, page.page(f"{result['robot']}: cost from demonstrations", body))
    return str(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.imitate_report", description="A page from imitate.json.")
    parser.add_argument("json", help="what `tiller imitate --page FOLDER` left")
    parser.add_argument("-o", "--out", help="page to write (default: the JSON's name with .html)")
    options = parser.parse_args(argv)
    try:
        print(write_report(options.json, options.out or Path(options.json).with_suffix(".html")))
    except ReportError as error:
        print(f"imitate report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
