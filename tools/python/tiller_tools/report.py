"""One page about a run: python -m tiller_tools.report run.csv -o run.html

The CSV is the log of `tiller run --report` or `tiller demo`: a row a tick, columns as RunLog writes them (measured
states and commands by name, mean.*, sd.*, q05.*, q95.*, true.*, ref.*, ess, tick_us, deadline_us, state, status).
Beside it lies the JSON of the same name (or --meta FILE), which says what the columns are, and what the log does not
say:

    {"columns": {"states": {"angle_rad": "rad", "rate_rad_s": "rad/s"}, "angles": ["angle_rad"],
                 "measured": ["angle_rad"], "inputs": {"force_N": "N"}, "parameters": {"pole_mass_kg": "kg"},
                 "tracked": []},
     "title": "cart_pole", "outcome": "upright after 2.4 s", "good": true,
     "limits": {"force_N": [-20, 20]}, "target": {"angle_rad": 0},
     "priors": {"pole_mass_kg": [0.052, 0.148]}, "facts": {"planner": "mppi", "seed": "1"},
     "edges": {"pole_mass_kg": {"at": "upper bound", "value": 0.15, "by": "prior",
                                "text": "pole_mass_kg at its upper bound 0.15: widen the prior"}}}

Where outputs of the model have costs, "columns" has them too ("outputs": {"tip_x_m": "m"}), and the frames that are
wanted somewhere ("frames": [{"name": "tool0", "turns": true}], in the log as out.tool0_x_m ... out.tool0_rzz), and
"output_target" the targets of all outputs, for which the log's goal.* stand where they changed; "output_bounds" has those
of outputs without a target, "clearance" the spheres' distances ({"apart_a_1_b_1_m": {"radii_m": .., "margin_m": ..}}).

With [posterior] disturbance "columns" has the forces beyond the model ("forces": {"joint_Nm": "Nm"}), in the log as
force.mean.* and force.sd.*; "contacts" their limits. Those at a frame ("tip_x_N") are empty where joints do not tell
them.

With [probe] the log has probing (1: a plan that finds out, 2: a calibration), probe_value, probe_cost, probe_spent and
probe_allowed.

With [planner] predict_spread the log has foreseen.mean.* and foreseen.sd.*, of each row's state "foreseen_s" before.

Where the robot file has a [figure], "figure" holds it: its links with all values as sums of [factor, name], and the
parameters that the log has no column of ("parameters", of the plant "true_parameters").

"columns" is required, with the unit of each ("angles": of one turn, where whole turns are the same); every other key
is optional. "tracked" states have a reference to follow, in the log as ref.*; "plane" names two states that span one,
and the obstacles in it: {"x": "x_m", "y": "z_m", "obstacles": [[x, y, radius]]}. "priors" holds 5 % and 95 % of the
prior; without it the first row's quantiles stand for it. "edges" are the parameters whose posterior stands on its
prior's edge.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from . import animation, page
from .table import ReportError, Table, read_json, read_table, write_page

_WORDS = ("state", "status")
_INSIDE_90 = 1.645  # standard deviations to each side hold 90 % of a Gaussian


class Run:
    """A log, and what its writer says of its columns."""

    def __init__(self, table: Table, words: dict[str, list[str]], meta: dict):
        self.table, self.words, self.meta = table, words, meta
        self.time = table["time_s"]
        if not np.all(np.isfinite(self.time)):
            raise ReportError(f"{table.path}: column 'time_s' has empty cells")
        columns = meta["columns"]
        self.states, self.inputs, self.params = (list(columns[key]) for key in ("states", "inputs", "parameters"))
        self.measured, self.angles = set(columns["measured"]), set(columns["angles"])
        self.tracked = [name for name in self.states if name in columns["tracked"]]
        self.outputs, self.frames = columns.get("outputs", {}), columns.get("frames", [])
        self.forces = columns.get("forces", {})
        self.units = {**self.outputs, **self.forces, **columns["states"], **columns["inputs"], **columns["parameters"]}

    def column(self, name: str) -> np.ndarray | None:
        return self.table[name] if name in self.table else None

    def last(self, name: str) -> float:
        """The last value that is there; NaN if there is none."""
        values = self.column(name)
        finite = values[np.isfinite(values)] if values is not None else np.array([])
        return float(finite[-1]) if len(finite) else float("nan")

    def prior(self, name: str) -> tuple[float, float]:
        given = self.meta.get("priors", {}).get(name)
        return tuple(given) if given else (float(self.table[f"q05.{name}"][0]), float(self.table[f"q95.{name}"][0]))


    def reference(self, name: str) -> np.ndarray:
        """Of an angle the turns that the run was on: the task does not tell them apart."""
        rows = self.table[f"ref.{name}"]
        if name not in self.angles:
            return rows
        return rows + 2 * np.pi * np.round((self.table[f"mean.{name}"] - rows) / (2 * np.pi))

    def output_goal(self, name: str) -> np.ndarray:
        """Where an output was wanted, row by row."""
        rows = self.column(f"goal.{name}")
        return rows if rows is not None else np.full(len(self.time), float(self.meta["output_target"][name]))

    def edge(self, name: str) -> dict | None:
        return self.meta.get("edges", {}).get(name)

    def target(self, name: str) -> float | None:
        """Of an angle the turn of it that the run ended at: the task does not tell them apart."""
        target = self.meta.get("target", {}).get(name)
        last = self.last(f"mean.{name}")
        if target is None or name not in self.angles or not np.isfinite(last):
            return target
        return target + 2 * np.pi * round((last - target) / (2 * np.pi))


def _check_columns(columns, path: Path) -> None:
    """The log's writer says what a column is; nothing is concluded from its name."""
    shape = {"states": dict, "angles": list, "measured": list, "inputs": dict, "parameters": dict, "tracked": list}
    if not isinstance(columns, dict) or any(not isinstance(columns.get(key), kind) for key, kind in shape.items()):
        raise ReportError(f"{path}: no key 'columns' with {', '.join(shape)}, so nothing says what the log's columns "
                          "are; `tiller run --report` writes it")


def read_run(path: Path, meta_path: Path | None) -> Run:
    table = read_table(path, required=("time_s",), text=_WORDS)
    meta_path = meta_path or path.with_suffix(".json")
    if not meta_path.exists():
        raise ReportError(f"{meta_path}: no such file; it says what the columns of {path.name} are, and "
                          "`tiller run --report` writes it beside the log")
    meta = read_json(meta_path)
    _check_columns(meta.get("columns") if isinstance(meta, dict) else None, meta_path)
    return Run(table, _read_words(path), meta)


def _read_words(path: Path) -> dict[str, list[str]]:
    with open(path, newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file)]
    return {name: [row[name] for row in rows] for name in _WORDS if rows and name in rows[0]}


# ---- figures ---------------------------------------------------------------------------------------


def _finite_line(ax, time, values, **style):
    keep = np.isfinite(values)
    ax.plot(time[keep], values[keep], **style)


def state_figure(run: Run, name: str) -> str:
    figure, ax = page.axes(name, page.unit_label(name, run.units[name]))
    cut = page.thin(len(run.time))
    time = run.time[cut]
    if name in run.measured:
        _finite_line(ax, time, run.table[name][cut], color=page.MEASURED, linestyle="none", marker=".", markersize=3.5,
                     label="measured")
    mean, sd = run.table[f"mean.{name}"][cut], run.table[f"sd.{name}"][cut]
    ax.fill_between(time, mean - _INSIDE_90 * sd, mean + _INSIDE_90 * sd, color=page.BAND, linewidth=0)
    _finite_line(ax, time, mean, color=page.ESTIMATE, label="estimate, 90 %")
    truth = run.column(f"true.{name}")
    if truth is not None:
        _finite_line(ax, time, truth[cut], color=page.TRUTH, linewidth=1.2, linestyle=(0, (4, 2)), label="truth")
    if name in run.tracked:
        _finite_line(ax, time, run.reference(name)[cut], color=page.INK, linewidth=1.2, linestyle=(0, (1, 1.2)),
                     label="reference")
    target = run.target(name)
    if target is not None:
        ax.axhline(target, color=page.INK, linewidth=0.9, linestyle=":", label="target")
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure)


def foreseen_figure(run: Run, name: str) -> str | None:
    """Where the state was foreseen half a horizon before, as a band, and where it then was."""
    mean, sd = run.column(f"foreseen.mean.{name}"), run.column(f"foreseen.sd.{name}")
    if mean is None or sd is None or not np.any(np.isfinite(mean)):
        return None
    truth = run.column(f"true.{name}")
    what, now = ("truth", truth) if truth is not None else ("estimate", run.table[f"mean.{name}"])
    off = _wrapped(now - mean) if name in run.angles else now - mean
    figure, ax = page.axes(f"{name}, as foreseen", page.unit_label(name, run.units[name]))
    cut = page.thin(len(run.time))
    time, near = run.time[cut], (now - off)[cut]  # angles on the turn that the run was on
    ax.fill_between(time, near - _INSIDE_90 * sd[cut], near + _INSIDE_90 * sd[cut], color=page.BAND, linewidth=0,
                    label=f"foreseen {page.number(run.meta['foreseen_s'], 3)} s before, 90 %")
    _finite_line(ax, time, now[cut], color=page.TRUTH if truth is not None else page.ESTIMATE, linewidth=1.2, label=what)
    ax.margins(x=0.01)
    page.legend(ax)
    known = np.isfinite(off) & np.isfinite(sd)
    inside = 100 * np.mean(np.abs(off[known]) <= _INSIDE_90 * sd[known])
    return page.svg(figure, f"The {what} lies in the band in {page.number(inside, 3)} % of {np.count_nonzero(known)} "
                            "rows.")


def force_figure(run: Run, name: str) -> str:
    """What pushed a joint beyond the model, as it was believed from tick to tick."""
    mean, sd = run.table[f"force.mean.{name}"], run.table[f"force.sd.{name}"]
    figure, ax = page.axes(f"force beyond the model at {name}", page.unit_label(name, run.units[name]))
    cut = page.thin(len(run.time))
    ax.axhline(0, color=page.MEASURED, linewidth=1.0)
    ax.fill_between(run.time[cut], (mean - _INSIDE_90 * sd)[cut], (mean + _INSIDE_90 * sd)[cut], color=page.BAND, linewidth=0)
    _finite_line(ax, run.time[cut], mean[cut], color=page.ESTIMATE, label="estimate, 90 %")
    limit = run.meta.get("contacts", {}).get(name)
    known = np.isfinite(mean) & np.isfinite(sd)
    # before it has learnt anything a band as wide as the motor is strong would flatten the rest
    top = 1.3 * np.percentile((np.abs(mean) + _INSIDE_90 * sd)[known], 95) if known.any() else 1.0
    if limit is not None and limit < 3 * top:
        top = max(top, 1.1 * limit)
    for side in (-1, 1) if limit is not None and limit <= top else ():
        ax.axhline(side * limit, color=page.LIMIT, linewidth=0.9, linestyle=":", label="contact" if side > 0 else None)
    ax.set_ylim(-top or -1.0, top or 1.0)
    ax.margins(x=0.01)
    page.legend(ax)
    told = page.number(100 * np.mean(known), 3)
    note = f"The joints tell it in {told} % of the rows: elsewhere a force in this direction moves none of them."
    return page.svg(figure, "" if known.all() else note)


def _normalised_figure(run: Run, title: str, values: np.ndarray, note: str, **style) -> str:
    """What should be noise of deviation one, within its 90 % band nine times in ten."""
    figure, ax = page.axes(title, "standard deviations")
    cut = page.thin(len(run.time))
    ax.axhspan(-_INSIDE_90, _INSIDE_90, color=page.BAND, linewidth=0, label="90 %")
    ax.axhline(0, color=page.MEASURED, linewidth=1.0)
    _finite_line(ax, run.time[cut], values[cut], color=page.ESTIMATE, **style)
    known = np.abs(values[np.isfinite(values)])
    # all of it, but a first tick far off must not flatten the others
    top = max(3.5, min(1.1 * known.max(), 3 * np.percentile(known, 99)))
    ax.set_ylim(-top, top)
    ax.margins(x=0.01)
    page.legend(ax)
    inside = f"{page.number(100 * np.mean(known <= _INSIDE_90), 3)} % of {known.size} rows lie in the band"
    beyond = np.count_nonzero(known > top)
    return page.svg(figure, f"{inside}, RMS {page.number(np.sqrt(np.mean(known ** 2)), 3)}"
                            f"{f'; {beyond} beyond the plot' if beyond else ''}. {note}")


def estimate_error_figure(run: Run, name: str) -> str | None:
    """Truth less estimate in units of the estimate's deviation: in the state's own plot the two lie on each other."""
    truth = run.column(f"true.{name}")
    if truth is None:
        return None
    error, sd = run.table[f"mean.{name}"] - truth, run.table[f"sd.{name}"]
    if name in run.angles:
        error = _wrapped(error)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(sd > 0, error / sd, np.nan)
    if not np.any(np.isfinite(values)):
        return None
    at_most = np.nanmax(np.abs(error))
    return _normalised_figure(run, f"error of the estimate of {name}", values, "At most "
                              f"{page.number(at_most, 3)} {page.unit_text(run.units[name])} off.", linewidth=1.2,
                              label="estimate less truth")


def innovation_figure(run: Run, name: str) -> str | None:
    values = run.column(f"innovation.{name}")
    if values is None or not np.any(np.abs(values) > 0):  # the first row's is zero; an attitude's w has no other
        return None
    steps = values[1:] * values[:-1]
    memory = np.nanmean(steps) / np.nanmean(values ** 2) if np.any(np.isfinite(steps)) else np.nan
    return _normalised_figure(run, f"innovation of {name}", values, "Each correlates with the one before "
                              f"by {page.number(memory, 2)}; noise by 0.", linestyle="none", marker=".",
                              markersize=3, label="measured less predicted")


def missed_section(run: Run) -> str:
    """What estimate and prediction missed, in units of what they said of themselves."""
    figures = [estimate_error_figure(run, name) for name in run.states]
    figures += [innovation_figure(run, name) for name in run.states if name in run.measured]
    figures = [figure for figure in figures if figure]
    if not figures:
        return ""
    return ("<h2>What the estimate missed</h2><p>Errors and innovations over the deviation that the filter states for them. "
            "A right model stays in the band nine times in ten, without a pattern.</p>" + page.grid(figures))


def _wrapped(values: np.ndarray) -> np.ndarray:
    return values - 2 * np.pi * np.round(values / (2 * np.pi))


def error_figure(run: Run, name: str) -> str:
    """How far the robot is from the reference, and how far it is believed to be."""
    figure, ax = page.axes(f"tracking error of {name}", page.unit_label(name, run.units[name]))
    cut = page.thin(len(run.time))
    reference, truth, sd = run.reference(name), run.column(f"true.{name}"), run.table[f"sd.{name}"]
    errors = {"estimate": run.table[f"mean.{name}"] - reference}
    if truth is not None:
        errors["truth"] = truth - reference
    if name in run.angles:
        errors = {which: _wrapped(error) for which, error in errors.items()}
    time, error = run.time[cut], errors["estimate"][cut]
    ax.axhline(0, color=page.MEASURED, linewidth=1.0)
    ax.fill_between(time, error - _INSIDE_90 * sd[cut], error + _INSIDE_90 * sd[cut], color=page.BAND, linewidth=0)
    _finite_line(ax, time, error, color=page.ESTIMATE, label="estimate, 90 %")
    if truth is not None:
        _finite_line(ax, time, errors["truth"][cut], color=page.TRUTH, linewidth=1.2, linestyle=(0, (4, 2)),
                     label="truth")
    ax.margins(x=0.01)
    page.legend(ax)
    which = "truth" if truth is not None else "estimate"
    known = errors[which][np.isfinite(errors[which])]
    if not known.size:
        return page.svg(figure)
    unit = page.unit_text(run.units[name])
    return page.svg(figure, f"Of the {which}: RMS {page.number(np.sqrt(np.mean(known ** 2)), 3)} {unit}, at most "
                            f"{page.number(np.max(np.abs(known)), 3)} {unit}.")


def output_figure(run: Run, name: str) -> str:
    figure, ax = page.axes(name, page.unit_label(name, run.units[name]))
    cut = page.thin(len(run.time))
    _finite_line(ax, run.time[cut], run.table[f"out.{name}"][cut], color=page.ESTIMATE, label="estimate")
    bounds = run.meta.get("output_bounds", {}).get(name)
    if bounds is None:
        _finite_line(ax, run.time[cut], run.output_goal(name)[cut], color=page.INK, linewidth=1.2,
                     linestyle=(0, (1, 1.2)), label="goal")
    for bound in bounds or []:
        if bound is not None:
            ax.axhline(bound, color=page.INK, linewidth=1.2, linestyle=(0, (4, 2)), label="bound")
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure)


def clearance_figures(run: Run) -> list[str]:
    """Of the spheres that are to stay apart, how far apart the nearest two surfaces are at each moment."""
    pairs = run.meta.get("clearance", {})
    if not pairs:
        return []
    names = list(pairs)
    gaps = 1e3 * np.array([run.table[f"out.{name}"] - pairs[name]["radii_m"] for name in names])
    known = np.flatnonzero(np.all(np.isfinite(gaps), axis=0))
    if not known.size:
        return []
    figure, ax = page.axes("least clearance", "mm")
    cut = page.thin(len(run.time))
    nearest = np.min(gaps, axis=0)
    _finite_line(ax, run.time[cut], nearest[cut], color=page.ESTIMATE, label="estimate")
    margin = 1e3 * pairs[names[0]]["margin_m"]
    ax.axhline(margin, color=page.INK, linewidth=1.2, linestyle=(0, (4, 2)), label="margin")
    ax.margins(x=0.01)
    page.legend(ax)
    row = known[np.argmin(nearest[known])]
    which = names[int(np.argmin(gaps[:, row]))]
    return [page.svg(figure, f"At least {page.number(nearest[row], 3)} mm, of {which}, at {page.number(run.time[row], 3)} "
                             f"s; wanted {page.number(margin, 3)} mm.")]


def frame_errors(run: Run, frame: dict) -> tuple[np.ndarray, np.ndarray | None]:
    """How far a frame is from its goal: metres, and radians where its rotation has a cost."""
    name = frame["name"]

    def rows(axes) -> np.ndarray:
        return np.array([[run.table[f"out.{name}_{axis}"], run.output_goal(f"{name}_{axis}")] for axis in axes])

    position = rows([f"{axis}_m" for axis in "xyz"])
    distance = np.sqrt(np.sum((position[:, 0] - position[:, 1]) ** 2, axis=0))
    if not frame["turns"]:
        return distance, None
    rotation = rows([f"r{row}{column}" for row in "xyz" for column in "xyz"])
    # |R - G|^2 = 8 sin^2(angle / 2)
    apart = np.sqrt(np.sum((rotation[:, 0] - rotation[:, 1]) ** 2, axis=0) / 8)
    return distance, 2 * np.arcsin(np.minimum(apart, 1))


def frame_figures(run: Run, frame: dict) -> list[str]:
    distance, angle = frame_errors(run, frame)
    cut = page.thin(len(run.time))
    figures = []
    for values, what, unit in ((distance, "distance", "mm"), (angle, "angle", "deg")):
        if values is None:
            continue
        values = values * 1e3 if unit == "mm" else np.degrees(values)
        figure, ax = page.axes(f"{what} of {frame['name']} from its goal", unit)
        _finite_line(ax, run.time[cut], values[cut], color=page.ESTIMATE, label="estimate")
        ax.set_yscale("log")
        ax.margins(x=0.01)
        known = values[np.isfinite(values)]
        figures.append(page.svg(figure, f"At the end {page.number(known[-1], 3)} {unit}." if known.size else ""))
    return figures


def path_figure(run: Run, plane: dict) -> str:
    """Where it went in the plane, from a circle to a square; lengths are the same along both axes."""
    names = [plane["x"], plane["y"]]
    x, y = (page.quantity_label(name, run.units[name]) for name in names)
    figure, ax = page.axes("path in the plane", y, xlabel=x, height=4.6)
    cut = page.thin(len(run.time))
    if set(names) <= set(run.tracked):
        ax.plot(*(run.reference(name)[cut] for name in names), color=page.INK, linewidth=1.2, linestyle=(0, (1, 1.2)),
                label="reference")
    paths = [("estimate", "mean.", {"color": page.ESTIMATE}),
             ("truth", "true.", {"color": page.TRUTH, "linewidth": 1.2, "linestyle": (0, (4, 2))})]
    for label, prefix, style in paths:
        points = [run.column(prefix + name) for name in names]
        if all(values is not None for values in points):
            ax.plot(*(values[cut] for values in points), label=label, **style)
    start, end = ([run.table[f"mean.{name}"][i] for name in names] for i in (0, -1))
    ax.plot(*start, "o", color=page.ESTIMATE, markersize=5, fillstyle="none", label="start")
    ax.plot(*end, "s", color=page.ESTIMATE, markersize=5, fillstyle="none", label="end")
    target = [run.target(name) for name in names]
    if all(value is not None for value in target):
        ax.plot(*target, "+", color=page.INK, markersize=6, label="target")
    for i, (at_x, at_y, radius) in enumerate(plane.get("obstacles", [])):
        ax.add_patch(page.plt.Circle((at_x, at_y), radius, color=page.LIMIT, alpha=0.35, linewidth=0,
                                     label=None if i else "obstacle"))
    ax.margins(0.06)
    ax.set_aspect("equal", adjustable="datalim")
    page.legend(ax)
    return page.svg(figure)


def input_figure(run: Run, name: str) -> str:
    figure, ax = page.axes(f"command {name}", page.unit_label(name, run.units[name]))
    # every tick: a command that is thinned would look smoother than it is
    ax.step(run.time, run.table[name], where="post", color=page.ESTIMATE, linewidth=1.1, label="command")
    limits = run.meta.get("limits", {}).get(name)
    if limits:
        for i, limit in enumerate(limits):
            ax.axhline(limit, color=page.LIMIT, linewidth=1.1, linestyle=(0, (5, 3)), label="limit" if i == 0 else None)
        room = 0.08 * (limits[1] - limits[0])
        ax.set_ylim(limits[0] - room, limits[1] + room)
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure)


def _spans(run: Run, kind: int) -> list[tuple[float, float]]:
    """From when to when commands were of that kind (1: probing, 2: calibrating)."""
    column = run.column("probing")
    if column is None:
        return []
    inside = np.concatenate([[False], column == kind, [False]])
    edges = np.flatnonzero(inside[1:] != inside[:-1])
    ends = np.append(run.time[1:], run.time[-1])
    return [(run.time[begin], ends[end - 1]) for begin, end in zip(edges[::2], edges[1::2])]


def _shade_probing(run: Run, ax) -> None:
    for kind, colour, label in ((2, page.PREDICTIVE, "calibrating"), (1, page.CYCLE[4], "probing")):
        for i, (begin, end) in enumerate(_spans(run, kind)):
            ax.axvspan(begin, end, ymax=0.04, color=colour, linewidth=0, label=label if i == 0 else None)


def probing_section(run: Run) -> str:
    """What was moved for the sake of knowing, what it cost, and how far each parameter was known before and after."""
    column = run.column("probing")
    if column is None or not np.any(column > 0):
        return ""
    figure, ax = page.axes("account of probing", "cost")
    ax.step(run.time, run.table["probe_allowed"], where="post", color=page.LIMIT, linestyle=(0, (5, 3)), label="allowed")
    ax.step(run.time, run.table["probe_spent"], where="post", color=page.ESTIMATE, label="spent, as expected")
    _shade_probing(run, ax)
    ax.margins(x=0.01)
    page.legend(ax)
    account = page.svg(figure, "A plan is sent for what it tells only if what it adds to the cost is within the budget.")
    figure, ax = page.axes("plans that were tried", "cost")
    for name, label, colour in (("probe_value", "expected to save", page.TRUTH), ("probe_cost", "and to add", page.ESTIMATE)):
        values = np.where(column == 1, run.table[name], np.nan)
        _finite_line(ax, run.time, values, linestyle="", marker=".", color=colour, label=label)
    _shade_probing(run, ax)
    ax.margins(x=0.01)
    page.legend(ax)
    tried = page.svg(figure, "Of the plans that went out: what they were expected to save by what they tell.")
    moved = np.flatnonzero(column > 0)
    first, last = moved[0], moved[-1]
    without = run.meta.get("sd_without_probing", {})
    body = []
    for name in run.params:
        sd = run.table[f"sd.{name}"]
        body.append([name, page.number(sd[first], 2), page.number(sd[last], 2), page.number(sd[-1], 2)] +
                    ([page.number(without[name], 2)] if without else []))
    period = float(np.median(np.diff(run.time)))
    seconds = [f"{np.sum(column == kind) * period:.1f} s {what}" for kind, what in ((2, "calibrating"), (1, "probing"))
               if np.any(column == kind)]
    table = page.rows(["parameter", "sd when it began", "when it ended", "at the end"] +
                      (["at the end of the same run without it"] if without else []), body)
    return f"<h2>What was found out on purpose</h2><p>{' and '.join(seconds)}.</p>" + table + page.grid(
        [account, tried] if np.any(column == 1) else [])


def param_figure(run: Run, name: str) -> str:
    figure, ax = page.axes(f"posterior of {name}", page.unit_label(name, run.units[name]))
    _shade_probing(run, ax)
    cut = page.thin(len(run.time))
    time, mean = run.time[cut], run.table[f"mean.{name}"][cut]
    low, high = run.prior(name)
    ax.axhspan(low, high, color=page.PRIOR, label="prior 90 %")
    ax.fill_between(time, run.table[f"q05.{name}"][cut], run.table[f"q95.{name}"][cut], color=page.BAND, linewidth=0,
                    label="posterior 90 %")
    _finite_line(ax, time, mean, color=page.ESTIMATE, label="mean")
    truth = run.last(f"true.{name}")
    if np.isfinite(truth):
        ax.axhline(truth, color=page.TRUTH, linewidth=1.3, linestyle=(0, (4, 2)), label="truth")
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure)


def spread_figure(run: Run) -> str:
    """All parameters in one view: a posterior that has narrowed a hundredfold is a line in its own plot."""
    figure, ax = page.axes("spread of the posterior", "width / prior's")
    cut = page.thin(len(run.time))
    least, most = 0.5, 1.2  # at least: a posterior that stays as it is must not be magnified
    for i, name in enumerate(run.params):
        low, high = run.prior(name)
        width = (run.table[f"q95.{name}"] - run.table[f"q05.{name}"]) / (high - low)
        keep = np.isfinite(width) & (width > 0)
        ax.plot(run.time[keep][cut], width[keep][cut], label=name, linewidth=1.4, **page.curve(i))
        least, most = min([least, *(0.8 * width[keep])]), max([most, *(1.2 * width[keep])])
    page.log_axis(ax.yaxis, least, most)
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure, "Width of the 90 % interval over that of the prior.")


def ess_figure(run: Run) -> str:
    figure, ax = page.axes("effective sample size", "particles")
    _finite_line(ax, run.time, run.table["ess"], color=page.ESTIMATE, linewidth=1.1)
    ax.set_ylim(bottom=0)
    ax.margins(x=0.01)
    return page.svg(figure, "Particles that carry the posterior; it falls as data come in and rises at each resampling.")


def tick_figure(run: Run) -> str:
    ticks = run.table["tick_us"] / 1000
    ticks = ticks[np.isfinite(ticks) & (ticks > 0)]
    deadline = run.last("deadline_us") / 1000
    figure, ax = page.axes("time of a tick", "ticks", xlabel="time (ms)")
    if len(ticks):
        # the first tick also faults the pages in; it must not stretch the axis for all others
        top = 1.15 * max(np.percentile(ticks, 99.5), deadline if np.isfinite(deadline) else 0)
        outside = int(np.sum(ticks > top))
        ax.hist(ticks[ticks <= top], bins=np.linspace(0, top, 60), color=page.ESTIMATE, label="ticks")
        if outside:
            ax.text(0.99, 0.9, f"{outside} longer, up to {ticks.max():.1f} ms", transform=ax.transAxes, ha="right",
                    fontsize=9)
    if np.isfinite(deadline) and deadline > 0:
        ax.axvline(deadline, color=page.LIMIT, linestyle=(0, (5, 3)), label=f"deadline {deadline:g} ms")
    page.legend(ax)
    late = np.mean(ticks > deadline) if np.isfinite(deadline) and deadline > 0 and len(ticks) else None
    note = "" if late is None else f"{late:.1%} of the ticks took longer than the deadline on this machine."
    return page.svg(figure, note)


# ---- the page --------------------------------------------------------------------------------------


def param_table(run: Run) -> str:
    body = []
    for name in run.params:
        low, high, truth = run.last(f"q05.{name}"), run.last(f"q95.{name}"), run.last(f"true.{name}")
        prior = run.prior(name)
        shrink = (prior[1] - prior[0]) / (high - low) if high > low else float("nan")
        inside = "" if not np.isfinite(truth) else "yes" if low <= truth <= high else "no"
        edge = run.edge(name)
        if inside == "no" and edge and edge["by"] == "physics" and truth == edge["value"]:
            inside = "at its bound"  # which an interval from 5 to 95 % never reaches
        body.append([name, page.number(truth), page.interval(*prior, between=" … "),
                     page.mean(run.last(f"mean.{name}"), run.last(f"sd.{name}")), page.number(run.last(f"sd.{name}"), 2),
                     page.interval(low, high, between=" … "), inside or "–",
                     f"{shrink:.0f} ×" if np.isfinite(shrink) else "–"])
    header = ["parameter", "truth", "prior 90 %", "mean", "sd", "posterior 90 %", "truth inside", "narrower by"]
    return page.rows(header, body)


def run_facts(run: Run) -> str:
    given = run.meta.get("facts")
    if given:
        return page.facts([(name, str(value)) for name, value in given.items()])
    pairs = [("length", f"{run.time[-1] - run.time[0]:.2f} s"), ("ticks", f"{len(run.time)}")]
    if "tick_us" in run.table:
        ticks = run.table["tick_us"] / 1000
        pairs.append(("tick, median / 99 %", f"{np.nanmedian(ticks):.2f} / {np.nanpercentile(ticks, 99):.2f} ms"))
    if run.words.get("state"):
        pairs.append(("ended in", run.words["state"][-1]))
    return page.facts(pairs)


def status_table(run: Run) -> str:
    counts = Counter(run.words.get("status", []))
    if set(counts) <= {"ok"}:
        return ""
    body = [[name, str(count)] for name, count in counts.most_common()]
    return "<h2>What the ticks reported</h2>" + page.rows(["status", "ticks"], body)


def build(run: Run) -> str:
    title = run.meta.get("title") or run.table.path.stem
    body = [f"<h1>{page.html.escape(title)}</h1>"]
    if run.meta.get("outcome"):
        body.append(page.outcome(run.meta["outcome"], run.meta.get("good")))
    body.append(run_facts(run))
    body.append(animation.section(run))
    foreseen = [figure for figure in (foreseen_figure(run, name) for name in run.states) if figure]
    if run.params:
        edges = [run.edge(name)["text"] for name in run.params if run.edge(name)]
        body += ["<h2>What was learnt</h2>", page.warnings(edges), param_table(run),
                 page.grid([param_figure(run, name) for name in run.params] + [spread_figure(run)])]
    body.append(probing_section(run))
    body.append("<h2>How it moved</h2>")
    plane = run.meta.get("plane")
    body.append(page.grid(([path_figure(run, plane)] if plane else []) +
                          [figure for frame in run.frames for figure in frame_figures(run, frame)] +
                          clearance_figures(run) + [output_figure(run, name) for name in run.outputs] +
                          [error_figure(run, name) for name in run.tracked] +
                          [state_figure(run, name) for name in run.states] +
                          [input_figure(run, name) for name in run.inputs]))
    if run.forces:
        body += ["<h2>What pushed it</h2>", page.grid([force_figure(run, name) for name in run.forces])]
    body.append(missed_section(run))
    if foreseen:
        body += ["<h2>What was foreseen</h2>", page.grid(foreseen)]
    inner = [ess_figure(run)] if "ess" in run.table else []
    inner += [tick_figure(run)] if "tick_us" in run.table else []
    if inner:
        body += ["<h2>How it computed</h2>", page.grid(inner)]
    body.append(status_table(run))
    body.append(f"<footer>From <code>{page.html.escape(run.table.path.name)}</code>. Bands are 5 to 95 %.</footer>")
    return page.page(title, "".join(body))


def write_report(csv_path: str | Path, out: str | Path, meta: str | Path | None = None,
                 title: str | None = None) -> Path:
    """Reads the log and writes the page; raises ReportError with a sentence for the user."""
    run = read_run(Path(csv_path), Path(meta) if meta else None)
    if title:
        run.meta["title"] = title
    write_page(out, build(run))
    return Path(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.report", description="A page from the log of a run.")
    parser.add_argument("csv", help="log of `tiller run` or `tiller demo`")
    parser.add_argument("-o", "--out", help="page to write (default: the log's name with .html)")
    parser.add_argument("--meta", help="JSON with title, outcome, limits, ... (default: the log's name with .json)")
    parser.add_argument("--title", help="heading of the page")
    options = parser.parse_args(argv)
    try:
        out = write_report(options.csv, options.out or Path(options.csv).with_suffix(".html"), options.meta,
                           options.title)
    except ReportError as error:
        print(f"report: {error}", file=sys.stderr)
        return 1
    print(out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
