"""One page about a simulator's parameters: python -m tiller_tools.infer_report infer.json -o infer.html

The JSON is what `tiller infer -o FOLDER` writes: parameters with priors and intervals, draws, and how the rounds went.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from . import identify_report, page
from .table import ReportError, read_json, write_page


def _candidate(result: dict) -> dict:
    """The result as identify's figures know one."""
    return {**result, "method": {**result["method"], "simulations": result["simulations"], "iterations": []}}


def rounds_figure(result: dict, index: int) -> str | None:
    """How wide the posterior is after each round, and how far from the last one its mean: both shrink by orders."""
    if len(result["rounds"]) < 2:
        return None
    everything = result["parameters"]
    at = [i for i, p in enumerate(everything) if not p["fixed"]][index]
    param, rounds = everything[at], np.arange(1, len(result["rounds"]) + 1)
    mean = np.array([r["mean"][at] for r in result["rounds"]], dtype=float)
    sd = np.array([r["sd"][at] for r in result["rounds"]], dtype=float)
    low, high = param["prior"]["interval_90"]
    figure, ax = page.axes(f"{param['name']} by round", page.unit_label(param["name"], param.get("unit")),
                           xlabel="round", height=3.0)
    ax.axhline((high - low) / 3.29, color=page.MEASURED, linestyle="--", linewidth=1.2, label="prior's deviation")
    ax.plot(rounds, sd, "o-", color=page.ESTIMATE, markersize=4, label="deviation")
    ax.plot(rounds[:-1], np.abs(mean - mean[-1])[:-1], "s:", color=page.BAND, markersize=4,
            label="mean, from the last")
    ax.set_yscale("log")
    ax.set_xticks(rounds)
    page.legend(ax)
    return page.svg(figure, "A posterior that still narrows by the last round needs more rounds or simulations; one "
                    "whose mean moves by more than its deviation was too sure before.")


def _rows(result: dict) -> list[list[str]]:
    rows = []
    for p in result["parameters"]:
        if p["fixed"]:
            rows.append([p["name"], "known", page.number(p["mean"]), "", ""])
        else:
            low, high = p["interval_90"]
            prior = p["prior"]["interval_90"]
            rows.append([p["name"], page.interval(*prior), page.mean(p["mean"], p["sd"]),
                         page.number(p["sd"], 2), page.interval(low, high)])
    return rows


def build(result: dict) -> str:
    learnt = [p for p in result["parameters"] if not p["fixed"]]
    candidate, method, escape = _candidate(result), result["method"], page.html.escape
    logs = ", ".join(Path(log).name for log in result["logs"])
    figures = [identify_report.marginal_figure(candidate, i) for i in range(len(learnt))]
    figures.append(identify_report.pairs_figure(candidate))
    rounds = [figure for i in range(len(learnt)) if (figure := rounds_figure(result, i))]
    body = [f"<h1>{escape(result['simulator'])}: parameters of a simulator</h1>",
            f"<p class=lead>From {escape(logs)}: {result['periods']} periods in {result['pieces']} pieces.</p>",
            page.facts([("simulations", str(result["simulations"])), ("failed", str(result["failed"])),
                        ("effective sample size", page.number(result["effective_samples"], 3)),
                        ("seconds", page.number(result["seconds"], 3))]),
            f"<p>Learnt by {escape(method['name'])} ({escape(method['citation'])}), summary "
            f"{escape(result['summary'])}. "
            f"Mind: {escape(method['caveat'])}.</p>",
            page.warnings(result["warnings"]), "<h2>What was learnt</h2>",
            page.rows(["parameter", "prior 5 .. 95 %", "mean", "sd", "90 % interval"], _rows(result)),
            page.grid([figure for figure in figures if figure])]
    if rounds:
        body += ["<h2>From round to round</h2>", page.grid(rounds)]
    body.append(f"<footer>From <code>{escape(result['simulator_file'])}</code>, which runs "
                f"<code>{escape(' '.join(result['command']))}</code>; tiller {escape(result['tiller'])}.</footer>")
    return page.page(f"{result['simulator']}: parameters of a simulator", "".join(body))


def write_report(json_path: str | Path, out: str | Path) -> Path:
    """Reads infer.json and writes the page; raises ReportError with a sentence for the user."""
    result = read_json(json_path)
    for key in ("simulator", "parameters", "rounds", "samples"):
        if key not in result:
            raise ReportError(f"{json_path}: no key '{key}'; expected the JSON of `tiller infer -o FOLDER`")
    write_page(out, build(result))
    return Path(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.infer_report", description="A page from infer.json.")
    parser.add_argument("json", help="what `tiller infer -o FOLDER` left")
    parser.add_argument("-o", "--out", help="page to write (default: the JSON's name with .html)")
    options = parser.parse_args(argv)
    try:
        print(write_report(options.json, options.out or Path(options.json).with_suffix(".html")))
    except ReportError as error:
        print(f"infer report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
