"""One page about learnt forces: python -m tiller_tools.learn_report learn.json -o learn.html

The JSON is what `tiller learn -o FOLDER` writes: errors of held-out rollouts with each candidate and without, and some
periods of the logs with the force that the model lacks there beside what each candidate's members say.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from . import page
from .table import ReportError, read_json, write_page


def candidate_table(result: dict) -> str:
    before = result["before"]
    body = [["model alone", page.number(before["rms_sigma"], 3), "1", f"{100 * before['covered']:.0f} %", "", ""]]
    residual = result["residual"]
    if residual["joint"]:
        body.append([f"nine weights at {residual['joint']}", page.number(residual["rms_sigma"], 3),
                     page.number(residual["ratio"], 2), f"{100 * residual['covered']:.0f} %", "",
                     "9"])
    for one in result["candidates"]:
        held, spread = one["held_out"], one["spread_ratio"]
        body.append([one["name"].replace("_", " "), page.number(held["rms_sigma"], 3), page.number(one["ratio"], 2),
                     f"{100 * held['covered']:.0f} %", "" if spread is None else f"{page.number(spread, 2)} ×",
                     str(one["weights"] or "")])
    return page.rows(["", "rollout error (sensor deviations)", "of the model alone", "central 90 % hold",
                      "spread beyond the data", "weights"], body)


def force_figure(one: dict, joint: dict, along: str) -> str:
    """The force of a joint against its position or velocity: from the logs, and what the members say there."""
    seen = one["seen"]
    x, truth = np.array(seen[along]), np.array(seen[joint["force"]])
    mean, spread = np.array(seen["mean " + joint["force"]]), np.array(seen["sd " + joint["force"]])
    figure, ax = page.axes(f"{joint['name']}: {one['name'].replace('_', ' ')}", joint["force"], xlabel=along, height=3.4)
    ax.plot(x, truth, ".", markersize=3, alpha=0.5, color=page.MEASURED, label="logs")
    ax.errorbar(x, mean, yerr=1.64 * spread, fmt=".", markersize=2.5, elinewidth=0.6, alpha=0.5, color=page.ESTIMATE,
                label="members, 90 %")
    page.legend(ax)
    return page.svg(figure, "Each dot is a period of the logs; what else the force depends on scatters it.")


def build(result: dict) -> str:
    body = [f"<h1>{page.html.escape(result['robot'])}: learnt forces</h1>",
            f"<p class=lead>{page.html.escape(result['why'])}.</p>",
            page.facts([("logs", f"{result['seconds']:.0f} s"), ("periods learnt from", f"{result['samples']}"),
                        ("held-out rollouts of 1 s", str(result["before"]["rollouts"])),
                        ("chosen", result["chosen"].replace("_", " ") or "nothing")]),
            "<h2>What it is worth where it was not trained</h2>", candidate_table(result)]
    for one in result["candidates"]:
        if not one["seen"]:  # effects of the catalogue: equations, no members
            continue
        figures = []
        for joint in result["joints"]:
            figures += [force_figure(one, joint, along) for along in (joint["position"], joint["velocity"]) if along]
        body += [f"<h2>{page.html.escape(one['name'].replace('_', ' '))}</h2>", page.grid(figures)]
    return page.page(f"{result['robot']}: learnt forces", "".join(body))


def write_report(json_path: str | Path, out: str | Path) -> Path:
    """Reads learn.json and writes the page; raises ReportError with a sentence for the user."""
    result = read_json(json_path)
    for key in ("robot", "before", "candidates", "joints", "why"):
        if key not in result:
            raise ReportError(f"{json_path}: no key '{key}'; expected the JSON of `tiller learn -o FOLDER`")
    write_page(out, build(result))
    return Path(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.learn_report", description="A page from learn.json.")
    parser.add_argument("json", help="what `tiller learn -o FOLDER` left")
    parser.add_argument("-o", "--out", help="page to write (default: the JSON's name with .html)")
    options = parser.parse_args(argv)
    try:
        print(write_report(options.json, options.out or Path(options.json).with_suffix(".html")))
    except ReportError as error:
        print(f"learn report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
