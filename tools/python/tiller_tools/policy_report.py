"""One page about a policy search: python -m tiller_tools.policy_report search.json -o search.html

The JSON is what `tiller policy --page` writes beside its page: of each trial expected and real cost, the true states,
the commands, and what the model forecast.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from . import page
from .table import ReportError, read_json, write_page


def _rows(values: list) -> np.ndarray:
    return np.array([[np.nan if v is None else v for v in row] for row in values], dtype=float)


def cost_figure(search: dict) -> str:
    """Expected and real cost by trial; each period costs between zero and one."""
    trials = search["trials"]
    at = np.arange(1, len(trials) + 1)
    figure, ax = page.axes("cost by trial", f"cost of {search['horizon']} periods", "trial")
    expected = np.array([np.nan if t["predicted"] is None else t["predicted"] for t in trials], dtype=float)
    ax.plot(at, expected, "s--", color=page.ESTIMATE, label="expected before it")
    ax.plot(at, [t["cost"] for t in trials], "o-", color=page.TRUTH, label="of the trial")
    ax.set_xticks(at)
    ax.set_ylim(0, 1.05 * search["horizon"])
    page.legend(ax)
    return page.svg(figure, "Where the two meet, the model explains what the policy does.")


def state_figure(search: dict, trial: dict, index: int) -> str:
    """One state of a trial over what was forecast for it."""
    name = search["states"][index]
    state = _rows(trial["state"])[index]
    t = search["period_s"] * np.arange(state.size)
    figure, ax = page.axes(name, page.unit_label(name, search.get("units", {}).get(name)))
    mean, sd = _rows(trial["forecast_mean"]), _rows(trial["forecast_sd"])
    if mean.size:
        ax.fill_between(t, mean[index] - 2 * sd[index], mean[index] + 2 * sd[index], color=page.PREDICTIVE,
                        label="forecast, two deviations")
        ax.plot(t, mean[index], color=page.ESTIMATE, label="forecast")
    ax.plot(t, state, color=page.TRUTH, label="trial")
    page.legend(ax)
    return page.svg(figure)


def command_figure(search: dict, trial: dict, index: int) -> str:
    """One command of a trial, held over each period."""
    name = search["commands"][index]
    row = _rows(trial["command"])[index]
    figure, ax = page.axes(name, page.unit_label(name, search.get("command_units", {}).get(name)))
    ax.step(search["period_s"] * np.arange(row.size + 1), np.append(row, row[-1]), where="post", color=page.TRUTH)
    return page.svg(figure)


def build(search: dict) -> str:
    """The page's HTML."""
    trials = search["trials"]
    last = trials[-1]
    robot = page.html.escape(Path(search["robot"]).name)
    body = f"<h1>{robot}: a policy from trials</h1>"
    body += page.facts([("method", search["method"]), ("policy", search["kind"]),
                       ("trials", str(len(trials))), ("last cost", page.number(last["cost"]))])
    figures = [cost_figure(search)]
    figures += [state_figure(search, last, i) for i in range(len(search["states"]))]
    figures += [command_figure(search, last, i) for i in range(len(search["commands"]))]
    body += "<h2>Costs, and the last trial</h2>" + page.grid(figures) + "<h2>Trials</h2>"
    body += page.rows(["trial", "expected", "cost", "search, s"],
                      [[str(i + 1), "–" if t["predicted"] is None else page.number(t["predicted"]),
                        page.number(t["cost"]), "–" if t["predicted"] is None else page.number(t["seconds"], 2)]
                       for i, t in enumerate(trials)])
    return page.page(f"{robot}: a policy from trials", body)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("search", help="JSON of tiller policy --page")
    parser.add_argument("-o", "--out", required=True, help="the page")
    args = parser.parse_args()
    try:
        search = read_json(args.search)
        if search.get("format") != "tiller policy search" or not search.get("trials"):
            raise ReportError(f"{args.search}: is no policy search with trials; write one with tiller policy --page")
        write_page(args.out, build(search))
    except ReportError as error:
        print(f"policy report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
