"""One page about a distilled policy: python -m tiller_tools.distill_report policy.report.json -o policy.html

The JSON is what `tiller distill` writes beside the policy: rounds of lessons, and held-out draws on which the whole
controllers were compared.
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


def error_figure(result: dict) -> str:
    rounds = result["rounds"]
    count = np.arange(1, len(rounds) + 1)
    figure, ax = page.axes("error of the answers", "share of half the range", xlabel="round", height=3.2)
    ax.plot(count, _array([r["error_trained"] for r in rounds]), marker="o", label="trained on", **page.curve(0))
    ax.plot(count, _array([r["error_held_out"] for r in rounds]), marker="o", label="held out", **page.curve(1))
    ax.set_ylim(bottom=0)
    if len(rounds) <= 12:
        ax.set_xticks(count)
    page.legend(ax)
    return page.svg(figure, "Root mean square. It may rise from round to round: later rounds add states to which the "
                            "policy itself leads, which are harder.")


def ratio_figure(result: dict) -> str:
    ratios = _array([r["cost_ratio"] for r in result["rounds"]])
    figure, ax = page.axes("cost over the teacher's, on the model", "ratio", xlabel="round", height=3.2)
    ax.axhline(1, color=page.MEASURED, linewidth=0.8)
    ax.plot(np.arange(1, len(ratios) + 1), ratios, marker="o", color=page.ESTIMATE)
    ax.axvline(result["best_round"], color=page.TRUTH, linestyle=(0, (4, 2)), label="kept")
    ax.set_ylim(0, 1.15 * np.nanmax(ratios, initial=1.0))
    if len(ratios) <= 12:
        ax.set_xticks(np.arange(1, len(ratios) + 1))
    page.legend(ax)
    return page.svg(figure, "Undisturbed episodes with hidden parameters drawn from the priors. A gap: an episode was "
                            "lost.")


def draws_figure(result: dict) -> str:
    tests = result["held_out"]
    teacher, policy = _array([t["teacher_cost"] for t in tests]), _array([t["policy_cost"] for t in tests])
    figure, ax = page.axes("held-out draws", "policy: mean stage cost", xlabel="teacher: mean stage cost", height=3.6)
    most = 1.05 * max(np.nanmax(teacher), np.nanmax(policy))
    ax.plot([0, most], [0, most], color=page.MEASURED, linewidth=0.8, label="equal")
    ax.plot(teacher, policy, "o", color=page.ESTIMATE, markersize=4)
    ax.set_xlim(0, most)
    ax.set_ylim(0, most)
    page.legend(ax)
    return page.svg(figure, "A point a draw: whole controllers with their posterior, on the plant of [sim].")


def rounds_table(result: dict) -> str:
    body = [[str(i + 1) + (" (kept)" if i + 1 == result["best_round"] else ""), str(r["samples"]), str(r["epochs"]),
             page.number(r["error_held_out"], 3), page.number(r["cost_ratio"], 4)]
            for i, r in enumerate(result["rounds"])]
    return page.rows(["round", "samples", "epochs", "held-out error", "cost over the teacher's"], body)


def _safe(tests: list[dict], who: str) -> str:
    return f"{sum(t[who] for t in tests)} of {len(tests)}"


def _facts(result: dict) -> list[tuple[str, str]]:
    facts = [("teacher", result["teacher"]), ("layers", " × ".join(str(w) for w in result["hidden"])),
             ("weights", f"{result['weights']} ({4 * result['weights'] / 1024:.1f} KiB)")]
    if result["held_out"]:
        facts += [("cost over the teacher's, held-out draws", page.number(result["held_out_cost_ratio"], 4)),
                  ("ended in SAFE: policy", _safe(result["held_out"], "policy_safe")),
                  ("ended in SAFE: teacher", _safe(result["held_out"], "teacher_safe"))]
    return facts


def build(result: dict) -> str:
    body = [f"<h1>{page.html.escape(result['robot'])}: a policy from its planner</h1>",
            f"<p class=lead>A tanh network that answers for {page.html.escape(result['teacher'])}. It reads "
            f"{page.html.escape(', '.join(result['inputs']))}.</p>", page.facts(_facts(result)),
            "<h2>Rounds of lessons</h2>", rounds_table(result),
            page.grid([error_figure(result), ratio_figure(result)])]
    if result["held_out"]:
        body += ["<h2>Whole controllers</h2>", page.grid([draws_figure(result)])]
    body.append(f"<footer>From <code>{page.html.escape(result['robot_file'])}</code>, tiller "
                f"{page.html.escape(result['tiller'])}.</footer>")
    return page.page(f"{result['robot']}: a policy from its planner", "".join(body))


def write_report(json_path: str | Path, out: str | Path) -> Path:
    """Reads the JSON and writes the page; raises ReportError with a sentence for the user."""
    result = read_json(json_path)
    for key in ("robot", "rounds", "held_out", "teacher", "weights"):
        if key not in result:
            raise ReportError(f"{json_path}: no key '{key}'; expected the JSON that `tiller distill` leaves")
    write_page(out, build(result))
    return Path(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.distill_report", description="A page about a distilled policy.")
    parser.add_argument("json", help="what `tiller distill` left beside the policy, ending .report.json")
    parser.add_argument("-o", "--out", help="page to write (default: the JSON's name with .html)")
    options = parser.parse_args(argv)
    try:
        print(write_report(options.json, options.out or Path(options.json).with_suffix(".html")))
    except ReportError as error:
        print(f"distill report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
