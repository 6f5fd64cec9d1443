"""One page about a learnt cost or policy: python -m tiller_tools.imitate_report imitate.json -o imitate.html

The JSON is what `tiller imitate --page FOLDER` writes: weights with their intervals, and for each demonstration what
the robot file's weights and the learnt ones do from the same start; of a policy what it does, beside cloning.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from . import page
from .table import ReportError, read_json, write_page


_POLICIES = {"adversarial": "adversarial imitation (GAIL)", "wasserstein": "adversarial imitation, Wasserstein form",
             "iq_learn": "IQ-Learn"}


def _acts(result: dict) -> bool:
    return result["method"] in _POLICIES


def _array(values) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def _judgement(weight: dict) -> str:
    if not weight["varies"]:
        return "its feature has no slope in any demonstration: stays"
    return "" if weight["identified"] else "not identified: stays near the file's"


def _interval(weight: dict) -> str:
    low, high = weight["interval_90"]
    return "–" if low is None or high is None else page.interval(low, high)


def weights_table(result: dict) -> str:
    body = [[w["key"], page.number(w["file"]), page.number(w["value"]), _interval(w), _judgement(w)]
            for w in result["weights"]]
    body += [[t["key"], page.number(t["file"]), page.number(t["value"]), _interval(t),
              "" if t["identified"] else "not identified: stays near the file's"] for t in result.get("targets", [])]
    body += [[k["key"], page.number(k["value"]), page.number(k["value"]), "kept", ""] for k in result["kept"]]
    return page.rows(["weight", "file", "learnt", "90 % interval", ""], body)


def _ratio_limits(drawn: list[dict]) -> tuple[float, float]:
    """What holds every value and the intervals that are told; the others run off both ends."""
    ratios = [w["value"] / w["file"] for w in drawn] + [0.5, 2.0]
    ratios += [bound / w["file"] for w in drawn if w["identified"] for bound in w["interval_90"]]
    return 0.7 * min(ratios), 1.4 * max(ratios)


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
    ax.set_xlim(*_ratio_limits(drawn))
    ax.set_yticks(range(len(drawn)), [w["key"].removeprefix("cost.") for w in reversed(drawn)], fontsize=8)
    return page.svg(figure, "Bars: 90 % by the curvature of the likelihood. A grey bar is a weight that the "
                            "demonstrations do not tell.")


def gap_figure(result: dict) -> str:
    """How far the critic tells the demonstrations from the policy's rollouts."""
    gap = _array(result["policy"]["gap"])
    figure, ax = page.axes("what the critic tells apart", "mean shown less mean made", "iteration")
    ax.plot(np.arange(1, gap.size + 1), gap, color=page.BAND, linewidth=1, label="an iteration")
    width = max(1, gap.size // 20)
    smooth = np.convolve(gap, np.ones(width) / width, mode="valid")
    ax.plot(np.arange(width, gap.size + 1) - (width - 1) / 2, smooth, color=page.ESTIMATE, label=f"mean of {width}")
    ax.axhline(0, color=page.MEASURED, linewidth=0.8)
    page.legend(ax)
    return page.svg(figure, "The critic's output over the demonstrations less that over the policy's rollouts. At zero "
                            "it no longer tells them apart.")


def distance_table(result: dict) -> str:
    body = [[d["path"], page.number(d["distance_after"], 3), page.number(d["distance_before"], 3),
             f"{100 * d['at_limits']:.0f} %"] for d in result["demonstrations"]]
    return page.rows(["demonstration", "distance, policy", "distance, cloning", "inputs at limits"], body)


def channel_figure(demonstration: dict, kind: str, name: str, unit: str, names: tuple[str, str]) -> str:
    """What was demonstrated beside what the two costs, or the two policies, do."""
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
            label=names[0])
    ax.plot(time[cut], _array(demonstration["after"][kind][name])[cut], color=page.ESTIMATE, linestyle=(0, (3, 1)),
            label=names[1])
    page.legend(ax)
    return page.svg(figure)


def demonstration_section(result: dict, demonstration: dict) -> str:
    units = result["units"]
    names = ("cloning", "policy") if _acts(result) else ("file's cost", "learnt cost")
    figures = [channel_figure(demonstration, kind, name, units.get(name, ""), names)
               for kind in ("states", "inputs") for name in demonstration["demonstrated"][kind]]
    facts = page.facts([(f"distance, {names[1]}", page.number(demonstration["distance_after"], 3)),
                        (f"distance, {names[0]}", page.number(demonstration["distance_before"], 3)),
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
    text += [f"{a} and {b} are told better as a ratio than in size." for a, b in result["alike"]]
    return " ".join(text)


def _cost_body(result: dict) -> str:
    horizon = f"a horizon of {result['horizon']} periods" if result["horizon"] else "each one plan to its end"
    body = f"<h1>{page.html.escape(result['robot'])}: a cost from demonstrations</h1>"
    body += f"<p>Method {page.html.escape(result['method'])}; {horizon}.</p>" + page.warnings(result["warnings"])
    body += page.outcome(_headline(result), None) + weights_table(result)
    figure = weights_figure(result)
    return body + (page.grid([figure]) if figure else "")


def _policy_body(result: dict) -> str:
    policy = result["policy"]
    body = f"<h1>{page.html.escape(result['robot'])}: a policy from demonstrations</h1>"
    body += f"<p class=lead>By {_POLICIES[result['method']]}. It reads " \
            f"{page.html.escape(', '.join(policy['inputs']))}.</p>" + page.warnings(result["warnings"])
    body += page.facts([("layers", " × ".join(str(w) for w in policy["hidden"])), ("weights", str(policy["weights"])),
                        ("iterations", str(len(policy["gap"]))), ("periods of a rollout", str(result["horizon"]))])
    return body + distance_table(result) + page.grid([gap_figure(result)])


def write_report(source: str | Path, out: str | Path) -> str:
    result = read_json(source)
    body = _policy_body(result) if _acts(result) else _cost_body(result)
    body += "".join(demonstration_section(result, d) for d in result["demonstrations"])
    body += "<p>Distance: RMS of the states from the demonstrated ones, each over its spread there.</p>"
    what = "policy" if _acts(result) else "cost"
    write_page(out, page.page(f"{result['robot']}: {what} from demonstrations", body))
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
