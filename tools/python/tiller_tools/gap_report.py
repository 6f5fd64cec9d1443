"""One page about a gap: python -m tiller_tools.gap_report gap.json -o gap.html

The JSON is what `tiller gap -o FOLDER` writes (gap.schema.json says what stands in it): the verdict, where the residual
force sits, which effects explain it, what adding the best one brings on windows that no fit has seen.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from textwrap import wrap

import numpy as np

from . import page
from .table import ReportError, read_json, write_page

_HEADLINE = {"no_gap": "model and data agree", "named": "the missing effect has a name",
             "ambiguous": "several effects explain the gap equally well",
             "partly_explained": "a part of the gap has a name", "unnamed": "no known effect explains the gap",
             "leading": "an effect leads, not yet proven", "off_prior": "a parameter lies far off its prior",
             "unfit": "the data cannot answer"}
_GOOD = {"no_gap": True, "named": False, "ambiguous": None, "partly_explained": None, "unnamed": None, "leading": None,
         "off_prior": None, "unfit": False}
_CHANGED = {"no_gap": "nothing changed", "named": "what changed has a name",
            "ambiguous": "something changed; several explain it equally well",
            "partly_explained": "something changed; a part of it has a name",
            "unnamed": "something changed that has no name", "leading": "something changed; an explanation leads"}
_AXES = {"position": "position", "velocity": "velocity", "input": "command", "input_rate": "change of the command",
         "time": "time", "input_sign_square": "direction of movement times load"}
_MEANING = {
    "position": "A force that depends on where the joint is: gravity and its tilt, springs, cogging, payload.",
    "velocity": "A force that depends on how fast the joint moves: friction of some kind, drag, back-EMF.",
    "input": "A force that depends on the command: gain, dead zone, saturation of the actuator.",
    "input_rate": "A force that follows the command's change: the command acts later than logged (delay, lag).",
    "time": "A force that is there at all times, or that changes over time: an offset, a drift.",
    "input_sign_square": "Friction that grows with the load on the drive."}

_INSIDE_90 = 1.645  # standard deviations to each side hold 90 % of a Gaussian


def _esc(text) -> str:
    return page.html.escape(str(text))


def _array(values) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def _effect(effect: dict) -> str:
    if effect["port_kind"] == "parameter":
        return f"{effect['port']} changed"
    return f"{effect['kind'].replace('_', ' ')} ({effect['port']})"


def _effects(explanation: dict) -> str:
    return " + ".join(_effect(e) for e in explanation["effects"]) or "the model as it is"


def _headline(result: dict) -> str:
    words = _CHANGED if result.get("change") else {}
    return words.get(result["verdict"], _HEADLINE.get(result["verdict"], result["verdict"]))


def _as_it_was(result: dict) -> str:
    return "model of before" if result.get("change") else "robot file as it is"


def _best(result: dict) -> dict | None:
    return result["ranking"][0] if result["ranking"] else None


def _adds(result: dict) -> bool:
    """Whether the best explanation is more than the robot file as it is."""
    best = _best(result)
    return bool(best and best["effects"])


def _edges(result: dict) -> list[dict]:
    """Of the best explanation's parameters, those that stand on their prior's edge."""
    best = _best(result)
    return [p["edge"] for p in best["parameters"] if p.get("edge")] if best else []


def _sigma(value) -> str:
    return f"{page.number(value, 3)} σ"


# ---- before and after ------------------------------------------------------------------------------


def horizon_figure(result: dict) -> str:
    horizons = result["horizons"]
    figure, ax = page.axes("error of rollouts on held-out windows", "RMS error (σ)", xlabel="length of the rollout (s)",
                           height=3.4)
    at = np.arange(len(horizons))
    before, after = (_array([h[key] for h in horizons]) for key in ("before_sigma", "after_sigma"))
    bars = [(at - 0.2, before, page.MEASURED, _as_it_was(result)),
            (at + 0.2, after, page.ESTIMATE, "with the change" if result.get("change") else "with the effect")]
    if not _adds(result):
        bars = [(at, before, page.MEASURED, _as_it_was(result))]
    for x, height, color, label in bars:
        ax.bar(x, height, 0.38, color=color, label=label)
    ax.axhline(1, color=page.INK, linewidth=1.0, linestyle=(0, (4, 3)), label="noise alone")
    for x, value in (pair for x, height, *_ in bars for pair in zip(x, height)):
        if np.isfinite(value):
            ax.annotate(page.number(value, 3), (x, value), xytext=(0, 2), textcoords="offset points", ha="center",
                        va="bottom", fontsize=9, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6})
    ax.set_xticks(at, [f"{h['seconds']:g}" for h in horizons])
    ax.grid(axis="x", visible=False)
    if np.nanmax(before, initial=1) > 30 * max(np.nanmin(after, initial=np.inf), 1e-9):
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(page.plain)
    ax.margins(y=0.15)
    page.legend(ax)
    return page.svg(figure, "Root mean square deviation of the measurement from the rollout, in standard deviations of "
                            "what noise leaves. At 1 nothing but noise is left.")


def horizon_table(result: dict) -> str:
    """First the windows that the sentence and the budget go by, then those that no fit has seen."""
    body = []
    if result["ranking"]:
        change = result.get("change")
        before = change["frozen_sigma"] if change else result["gate"]["nominal_sigma"]
        body.append(["windows worked on", str(result["data"]["fit_windows"]), _sigma(before),
                     _sigma(_best(result)["remaining_sigma"])])
    body += [[f"{h['seconds']:g} s, kept for the proof", str(h["windows"]), _sigma(h["before_sigma"]),
              _sigma(h["after_sigma"])] for h in result["horizons"]]
    return page.rows(["rollouts", "windows", "before", "after"], body)


def channel_table(result: dict) -> str:
    """A row for each measured channel: a robot of many joints makes it long, not wide."""
    horizons = result["horizons"]
    header = ["RMS error, kept for the proof"] + [f"{h['seconds']:g} s: before → after" for h in horizons]
    body = [[page.quantity_label(channel["name"], channel["unit"])]
            + [" → ".join(page.number(h[key][k], 3) if k < len(h[key]) else "–" for key in ("before_rms", "after_rms"))
               for h in horizons] for k, channel in enumerate(result["data"]["channels"])]
    return page.rows(header, body)


def proof_section(result: dict) -> str:
    if not result["horizons"]:
        return ""
    return ("<h2>The gap before and after</h2>"
            + page.grid([horizon_figure(result)]) + horizon_table(result) + channel_table(result))


# ---- what changed ----------------------------------------------------------------------------------


def _relative(change: dict) -> bool:
    """Whether the change is told as a share of what was before."""
    return bool(change["before"]) and abs(change["before"]) > 0.05 * abs(change["after"] or 0)


def change_figure(title: str, changes: list[dict]) -> str:
    """Changes with 95 %, in shares of what was before; nothing changed where the bar reaches over zero."""
    shown = [c for c in changes if _relative(c) and c["interval_95"][0] is not None]
    if not shown:
        return ""
    figure, ax = page.axes(title, "parameter", xlabel="change (% of the value before)", height=1.1 + 0.36 * len(shown))
    for i, c in enumerate(shown):
        scale = 100 / abs(c["before"])
        low, high = (scale * v for v in c["interval_95"])
        color = page.MEASURED if low <= 0 <= high else page.ESTIMATE
        ax.plot([low, high], [i, i], color=color, linewidth=4, solid_capstyle="butt")
        ax.plot([scale * c["change"]], [i], "o", color=color)
    ax.axvline(0, color=page.INK, linewidth=1.0)
    ax.set_yticks(range(len(shown)), [c["name"] for c in shown], fontsize=8)
    ax.set_ylim(-0.6, len(shown) - 0.4)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.margins(x=0.15)
    return page.svg(figure, "Dot: the change; bar: 95 %.")


def change_table(changes: list[dict]) -> str:
    body = []
    for c in changes:
        low, high = c["interval_95"]
        share = "–"
        if _relative(c) and low is not None:
            scale = 100 / abs(c["before"])
            share = f"{scale * c['change']:+.3g} % ({scale * low:+.3g} … {scale * high:+.3g} %)"
        before = "was not there" if c["of"] == "effect" else f"{page.mean(c['before'], c['before_sd'])} {c['unit']}"
        body.append([c["name"], before, f"{page.mean(c['after'], c['after_sd'])} {c['unit']}",
                     page.number(c["change"], 3), page.interval(low, high, between=" … "), share])
    return page.rows(["parameter", "before", "after", "change", "95 %", "of before"], body)


def change_section(result: dict) -> str:
    change = result.get("change")
    if not change or not (change["changed"] or change["others"]):
        return ""
    parts = ["<h2>What changed</h2>"]
    if change["changed"]:
        parts += [change_table(change["changed"]),
                  page.grid([f for f in (change_figure("what changed", change["changed"]),) if f])]
    if change["others"]:
        beside = "besides" if change["changed"] else "by itself"
        parts += [f"<p>Each other parameter, if it had changed {beside}: an interval about zero bounds what can have "
                  "changed unseen.</p>", change_table(change["others"]),
                  page.grid([f for f in (change_figure("what else may have changed", change["others"]),) if f])]
    before = change["before"]
    parts.append(f"<p>The model of before, from {page.number(before['seconds'], 3)} s of logs, leaves "
                 f"{_sigma(before['sigma'])} on them; all errors on this page are in units of that. "
                 f"{_esc(before['sentence'])}</p>")
    return "".join(parts)


# ---- where -----------------------------------------------------------------------------------------


def map_figure(result: dict, index: int) -> str:
    """The residual force over one axis: bins with two standard deviations, the region shaded."""
    m, region = result["where"]["maps"][index], result["where"]["region"]
    low, high = _array([b["low"] for b in m["bins"]]), _array([b["high"] for b in m["bins"]])
    mean, sd = _array([b["mean"] for b in m["bins"]]), _array([b["sd"] for b in m["bins"]])
    used = _array([b["count"] for b in m["bins"]]) >= 4  # fewer test functions tell little
    figure, ax = page.axes(f"{m['joint']}: over {_AXES.get(m['axis'], m['axis'])}", f"residual {m['force']}",
                           xlabel=m["axis_label"], height=3.2)
    if region and region["joint"] == m["joint"] and region["axis"] == m["axis"]:
        ax.axvspan(region["low"], region["high"], color="#fdeecf", label="region")
    ax.axhline(0, color="#8b929a", linewidth=1.0)
    middle = 0.5 * (low + high)
    ax.fill_between(np.repeat(np.append(low, high[-1:]), 2)[1:-1], np.repeat(np.where(used, mean - 2 * sd, np.nan), 2),
                    np.repeat(np.where(used, mean + 2 * sd, np.nan), 2), color=page.BAND, linewidth=0, label="± 2 sd")
    ax.hlines(mean[used], low[used], high[used], color=page.ESTIMATE, linewidth=2.0)
    ax.plot(middle[used], mean[used], color=page.ESTIMATE, linewidth=0.8)
    ax.margins(x=0.01)
    page.legend(ax)
    chance = "at most " if m["p_value"] * (len(m["null"]) + 1) < 1.5 else ""
    return page.svg(figure, f"z = {page.number(m['z'], 3)}; by chance with probability {chance}"
                            f"{page.number(m['p_value'], 2)}.")


def force_figure(force: dict) -> str:
    """The smoothed force that the model lacks at a joint, over time."""
    time, mean, sd = (_array(force[key]) for key in ("time_s", "mean", "sd"))
    figure, ax = page.axes(f"{force['joint']}: the force that the model lacks", force["force"], xlabel="time (s)",
                           height=3.2)
    ax.axhline(0, color="#8b929a", linewidth=1.0)
    ax.fill_between(time, mean - _INSIDE_90 * sd, mean + _INSIDE_90 * sd, color=page.BAND, linewidth=0, label="90 %")
    ax.plot(time, mean, color=page.ESTIMATE, linewidth=1.2, label="smoothed")
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure, f"Along {_esc(Path(force['log']).name)}, of the robot file with its parameters fitted. A step "
                            "is spread over the time in which the sensors tell a force.")


def beyond_chance(spectrum: dict) -> np.ndarray:
    return _array(spectrum["amplitude"]) > _array(spectrum["chance"])


def order_figure(spectrum: dict) -> str:
    """The residual force of a joint that turns, by whole orders of its revolution; peaks beyond chance have their order
    beside them."""
    amplitude, chance = _array(spectrum["amplitude"]), _array(spectrum["chance"])
    order = np.arange(1, len(amplitude) + 1)
    figure, ax = page.axes(f"{spectrum['joint']}: orders of a turn", f"amplitude, {spectrum['force']}",
                           xlabel="periods in a turn", height=3.2)
    ax.vlines(order, 0, amplitude, color=page.ESTIMATE, linewidth=1.6)
    ax.plot(order, chance, color="#8b929a", linewidth=1.0, label="chance")
    beyond = beyond_chance(spectrum)
    peaks = [n for n in np.argsort(-amplitude)[:6] if beyond[n]]
    for n in peaks:
        ax.annotate(str(order[n]), (order[n], amplitude[n]), ha="center", va="bottom", fontsize=8, color=page.INK)
    ax.margins(x=0.01, y=0.1)
    ax.set_ylim(bottom=0)
    page.legend(ax)
    return page.svg(figure, "Of the residual force, phase-coherent over all logs. One of twenty spectra of chance "
                            "reaches the grey line anywhere. Fast orders are flattened by the smoothing.")


def null_figure(result: dict) -> str:
    """What the strongest map's statistic is when the residual's blocks change places and signs."""
    m = result["where"]["maps"][0]
    null = _array(m["null"])
    figure, ax = page.density_axes("what chance would give", "evidence of the strongest map")
    ax.hist(null, bins=30, color=page.MEASURED, label=f"{len(null)} permutations")
    ax.axvline(m["statistic"], color=page.TRUTH, linewidth=2.0, label="these data")
    if m["statistic"] > 5 * np.nanmax(null, initial=1e-12):
        ax.set_xscale("symlog", linthresh=float(np.nanmax(null, initial=1e-12)))
        ax.xaxis.set_major_formatter(page.plain)
    page.legend(ax)
    return page.svg(figure, f"The residual force of {m['joint']} over {_AXES.get(m['axis'], m['axis'])}, after its "
                            "blocks of about 2 s changed places and signs: it then goes with nothing.")


def _no_region(maps: list[dict]) -> str:
    """Of maps without a region: chance, or something that no stretch of the axis holds."""
    m = maps[0]
    what = f"The strongest of {len(maps)} maps, the residual force of {m['joint']} over {_AXES.get(m['axis'], m['axis'])}"
    if m["p_value"] > 0.05 / len(maps):
        return (f"{what}, is no stronger than chance makes one of them: z = {page.number(m['z'], 3)}, probability "
                f"{page.number(m['p_value'], 2)}.")
    return (f"{what}, is beyond chance (z = {page.number(m['z'], 3)}), but no stretch of that axis holds a force of one "
            "sign: look at the map.")


def where_section(result: dict) -> str:
    maps, region = result["where"]["maps"], result["where"]["region"]
    if not maps:
        return ""
    parts = ["<h2>Where it is</h2>"]
    if region:
        label = next(m["axis_label"] for m in maps if (m["joint"], m["axis"]) == (region["joint"], region["axis"]))
        parts.append(f"<p>At <b>{_esc(region['joint'])}</b>, {_esc(label)} from {page.number(region['low'])} to "
                     f"{page.number(region['high'])}: <b>{page.number(region['mean'], 3)} ± "
                     f"{page.number(region['sd'], 2)}</b> ({_esc(region['force'])}) are missing in the model's equation. "
                     f"{_MEANING.get(region['axis'], '')}</p>")
    else:
        parts.append(f"<p>{_esc(_no_region(maps))}</p>")
    figures = [force_figure(force) for force in result["where"]["forces"]]
    figures += [order_figure(spectrum) for spectrum in result["where"]["orders"] if beyond_chance(spectrum).any()]
    figures += [map_figure(result, 0), null_figure(result)] + [map_figure(result, i) for i in range(1, len(maps))]
    return "".join(parts) + page.grid(figures)


# ---- what ------------------------------------------------------------------------------------------


def ranking_table(result: dict) -> str:
    rivals = set(result["ambiguity"])
    body = []
    for i, x in enumerate(result["ranking"][:12]):
        mark = "● " if i in rivals else ""
        body.append([mark + _effects(x), page.number(x["gain_nats"], 4), page.number(x["z"], 3),
                     page.number(x["z_to_best"], 3), page.number(x["robust_z_to_best"], 3),
                     page.number(x["rollout_ratio"], 3), _sigma(x["remaining_sigma"])])
    return page.rows(["explanation", "gain (nats)", "z", "z to the best", "robust", "rollouts / best's", "leaves"], body)


def _powers_of_ten(low: float, high: float, most: int = 7) -> list[float]:
    """Zero and powers of ten from 10 on, both signs, as many as have room beside each other."""
    powers = [math.floor(math.log10(x)) if x >= 10 else 0 for x in (-low, high)]
    step = max(1, math.ceil(sum(powers) / (most - 1)))
    down, up = ([10.0**k for k in range(step, most_power + 1, step)] for most_power in powers)
    return [-x for x in reversed(down)] + [0.0] + up


def behind_figure(result: dict) -> str:
    """How far each explanation stays behind the best one; the gains themselves differ too little to be seen."""
    ranking = [x for x in result["ranking"][:10] if x["gain_nats"] is not None]
    if len(ranking) < 2:
        return ""
    rivals = set(result["ambiguity"])
    figure, ax = page.axes("log density behind the best", "explanation", xlabel="nats",
                           height=1.0 + 0.36 * len(ranking))
    behind = ranking[0]["gain_nats"] - _array([x["gain_nats"] for x in ranking])
    colors = [page.ESTIMATE if i in rivals else page.MEASURED for i in range(len(ranking))]
    ax.barh(np.arange(len(ranking)), behind, color=colors)
    for i, value in enumerate(behind):  # right of the bar, also of one that goes to the left: there the names stand
        ax.annotate(f" {page.number(value, 3)} ", (max(value, 0.0), i), ha="left", va="center", fontsize=8,
                    color=page.INK)
    ax.set_yticks(np.arange(len(ranking)), ["\n".join(wrap(_effects(x), 32)[:2]) for x in ranking], fontsize=8)
    ax.set_xscale("symlog", linthresh=10)
    ax.xaxis.set_major_formatter(page.plain)
    low, high = min(0.0, 2 * float(np.nanmin(behind))), max(30.0, 10 * float(np.nanmax(behind)))
    ax.set_xlim(low, high)
    ax.set_xticks(_powers_of_ten(low, high))
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    return page.svg(figure, "On windows held out of the fit that predicts them. Blue: the answer, and what cannot be told "
                            "from it on these data. What has more effects must be ahead by more than chance to win.")


def catalogue_list(result: dict) -> str:
    names = [e["kind"] for i in result["ambiguity"] for e in result["ranking"][i]["effects"]]
    rows = []
    for name in dict.fromkeys(names):
        info = result["catalogue"].get(name, {})
        rows.append([name.replace("_", " "), info.get("help") or "–", info.get("equation") or "–",
                     info.get("source") or "–"])
    return _wrapped_rows(["effect", "what it is", "equation", "source"], rows) if rows else ""


def _wrapped_rows(header: list[str], body: list[list[str]]) -> str:
    """A table whose cells are sentences."""
    return page.rows(header, body).replace("<table>", '<table class="sentences">')


def what_section(result: dict) -> str:
    if not result["ranking"]:
        return ""
    parts = ["<h2>What it is</h2>"]
    if len(result["ambiguity"]) > 1:
        parts.append("<p>Marked ●: these cannot be told apart on these data.</p>")
    figure = behind_figure(result)
    return "".join(parts) + ranking_table(result) + (page.grid([figure]) if figure else "") + catalogue_list(result)


# ---- parameters ------------------------------------------------------------------------------------


def parameter_table(explanation: dict) -> str:
    body = []
    for p in explanation["parameters"]:
        before = page.number(p["before"]) if p["of"] == "robot_file" else "–"
        if p["before_sd"]:
            before += f" ± {page.number(p['before_sd'], 2)}"
        if p["fixed"]:
            body.append([p["name"], "known", page.number(p["mean"]), "", ""])
            continue
        low, high = p["interval_95"]
        body.append([p["name"], before, f"{page.mean(p['mean'], p['sd'])} {p['unit']}",
                     page.number(p["sd"], 2), page.interval(low, high, between=" … ")])
    return page.rows(["parameter", "before", "after", "sd", "95 %"], body)


def parameter_figure(p: dict) -> str:
    figure, ax = page.axes(p["name"], "fit", xlabel=page.quantity_label(p["name"], p["unit"]), height=2.2)
    rows = []
    if p["before_sd"]:
        rows.append(("before", p["before"], p["before"] - 1.96 * p["before_sd"], p["before"] + 1.96 * p["before_sd"],
                     page.MEASURED))
    rows.append(("after", p["mean"], *p["interval_95"], page.ESTIMATE))
    for i, (label, mean, low, high, color) in enumerate(rows):
        ax.plot([low, high], [i, i], color=color, linewidth=4, solid_capstyle="butt")
        ax.plot([mean], [i], "o", color=color)
    ax.set_yticks(range(len(rows)), [row[0] for row in rows])
    ax.set_ylim(-0.6, len(rows) - 0.4)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.margins(x=0.2)
    return page.svg(figure)


def parameter_section(result: dict) -> str:
    best = _best(result)
    if not best or not best["parameters"]:
        return ""
    free = [p for p in best["parameters"] if not p["fixed"] and p["sd"]]
    text = f"<h2>Parameters before and after</h2><p>Of the best explanation: {_esc(_effects(best))}.</p>"
    text += page.warnings([edge["text"] for edge in _edges(result)])
    return text + parameter_table(best) + (page.grid([parameter_figure(p) for p in free]) if free else "")


# ---- trajectories ----------------------------------------------------------------------------------


def overlay_figure(result: dict, overlay: dict) -> str:
    channels, inputs = result["data"]["channels"], result["robot"]["inputs"]
    n = len(overlay["measured"]) + len(overlay["input"])
    figure, axes = page.plt.subplots(n, 1, figsize=(6.0, 1.0 + 1.6 * n), sharex=True, squeeze=False)
    figure.set_label(f"{Path(overlay['log']).name} from {overlay['first_time_s']:.2f} s")
    time = _array(overlay["time_s"])
    for k, measured in enumerate(overlay["measured"]):
        ax = axes[k][0]
        ax.plot(time, _array(measured), ".", markersize=2.5, color=page.TRUTH, label="measured")
        if _adds(result):
            ax.plot(time, _array(overlay["before"][k]), color=page.MEASURED, linestyle=(0, (4, 2)), label="before")
        ax.plot(time, _array(overlay["after"][k]), color=page.ESTIMATE,
                label="after" if _adds(result) else _as_it_was(result))
        ax.set_ylabel(channels[k]["name"], fontsize=8)
        ax.margins(x=0.01)
        if k == 0:
            page.legend(ax)
    for i, values in enumerate(overlay["input"]):
        ax = axes[len(overlay["measured"]) + i][0]
        ax.step(time, _array(values), where="post", color=page.INK, linewidth=1.2)
        ax.set_ylabel(inputs[i], fontsize=8)
        ax.margins(x=0.01)
    axes[-1][0].set_xlabel("time (s)")
    return page.svg(figure)


def overlay_section(result: dict) -> str:
    if not result["overlays"]:
        return ""
    return ("<h2>Held-out stretches, rolled out from their first state</h2>"
            + page.grid([overlay_figure(result, overlay) for overlay in result["overlays"]]))


# ---- what to do next -------------------------------------------------------------------------------


def next_steps(result: dict) -> list[str]:
    """HTML sentences, most useful first."""
    verdict, robot = result["verdict"], _esc(result["robot"]["file"])
    new = _esc(result["robot_file"]) if result["robot_file"] else None
    steps = []
    if verdict == "unfit":
        return ["Mend what is listed above, and run again. Good data: six logs of 8 s in which the input varies all the "
                "time, with reversals, slow and fast (<code>tiller excite</code> proposes them)."]
    for edge in _edges(result):
        if edge["by"] == "prior":
            steps.append(f"{_esc(edge['text'])} in <code>{robot}</code>, and run again: what a parameter may not make "
                         "up for looks like physics that is missing.")
    if result.get("change"):
        return steps + _after_a_change(result, robot, new)
    if verdict == "no_gap":
        return steps + ["Nothing. Let CI watch: <code>tiller gap "
                f"{robot} nightly/*.csv --budget {page.number(result['budget_sigma'], 2)}</code> ends with another code "
                "than 0 where a gap opens."]
    if len(result["ambiguity"]) > 1 or verdict == "ambiguous":
        if result["separation"]:
            steps.append(f"Tell the candidates apart: {_esc(result['separation'])}.")
        steps.append(f"<code>tiller excite {robot} --gap gap.json -o excite.csv</code> proposes the input that "
                     "separates them best, and says how long to record. Then run <code>tiller gap</code> on the new logs "
                     "too.")
    if new:
        steps.append(f"Run with the effect: <code>tiller run {new}</code>. Its prior is wider than the fit, so "
                     "the posterior goes on estimating it.")
    if verdict in ("unnamed", "partly_explained"):
        steps.append("What is left is in no catalogue. Look at the maps: what changes there? The effect "
                     "<code>residual</code> learns it without a name (docs/reference/effects.md), and the planner then knows where "
                     "it does not know.")
    return steps


def _after_a_change(result: dict, robot: str, new: str | None) -> list[str]:
    verdict, steps = result["verdict"], []
    if verdict == "no_gap":
        return [f"Nothing. Let CI watch: <code>tiller gap {robot} --before normal/*.csv --after nightly/*.csv</code> ends "
                "with another code than 0 where something changed."]
    if verdict in ("ambiguous", "leading") and result["separation"]:
        steps.append(f"Tell them apart: {_esc(result['separation'])}.")
    if new:
        steps.append(f"Run with the robot as it is now: <code>tiller run {new}</code>; or mend the robot, and compare again.")
    if verdict in ("unnamed", "partly_explained"):
        steps.append("Look at the maps: on what does the force depend that was not there before?")
    return steps


def next_section(result: dict) -> str:
    items = "".join(f"<li>{step}</li>" for step in next_steps(result))
    return f"<h2>What to do next</h2><ul class=next>{items}</ul>" if items else ""


# ---- the page --------------------------------------------------------------------------------------


def _facts(result: dict) -> list[tuple[str, str]]:
    facts = []
    before, best = result["gate"]["nominal_sigma"], _best(result)
    change = result.get("change")
    if change:
        facts.append(("model of before, on after", _sigma(change["frozen_sigma"])))
    elif before:  # the sentence's figure, and what the budget is compared with
        facts.append(("gap, before" if result["verdict"] != "no_gap" else "gap", _sigma(before)))
    if best and result["verdict"] != "no_gap":
        facts.append(("with the change, at worst" if change else "after, at worst",
                      _sigma(max(best["remaining_sigma"], result["remaining_sigma"] or 0))))
    facts.append(("noise / robot file's", page.number(result["gate"]["noise_ratio"], 2)))
    facts.append(("data", f"{page.number(result['data']['seconds'], 3)} s"))
    facts.append(("windows: worked on, proof", f"{result['data']['fit_windows']}, {result['data']['test_windows']}"))
    facts.append(("computing", f"{page.number(result['cost']['cpu_s'], 2)} s"))
    return facts


_STYLE = """<style>
table.sentences td { white-space: normal; text-align: left; vertical-align: top; min-width: 9em; }
table.sentences th { text-align: left; }
.verdict { font-size: 18px; max-width: 90ch; margin: 4px 0 10px; }
.next li, .reasons li { margin: 6px 0; max-width: 95ch; }
.reasons li { font-family: ui-monospace, monospace; font-size: 14px; overflow-wrap: anywhere; }
code { overflow-wrap: anywhere; }
</style>"""


def build(result: dict) -> str:
    logs = ", ".join(Path(log).name for log in result["data"]["logs"])
    held = ", ".join(Path(log).name for log in result["data"]["hold_out"])
    verdict = result["verdict"]
    change = result.get("change")
    if change:
        logs = f"Before: {', '.join(Path(log).name for log in change['before']['logs'])}. After: {logs}"
    what = "what changed" if change else "model and measurement"
    body = [_STYLE, f"<h1>{_esc(result['robot']['name'])}: {what}</h1>",
            f"<p class=lead>{_esc(logs)}{'. For the proof alone: ' + _esc(held) if held else ''}.</p>",
            page.outcome(_headline(result) + (" (interrupted)" if result["interrupted"] else ""),
                         _GOOD.get(verdict)),
            f"<p class=verdict>{_esc(result['sentence'])}</p>"]
    if result["reasons"]:
        body.append("<ul class=reasons>" + "".join(f"<li>{_esc(r)}</li>" for r in result["reasons"]) + "</ul>")
    if verdict != "unfit":
        body.append(page.facts(_facts(result)))
    body += [next_section(result), change_section(result), proof_section(result), where_section(result),
             what_section(result), "" if change else parameter_section(result), overlay_section(result)]
    if result["notes"]:
        body.append("<h2>Notes</h2><ul class=next>" + "".join(f"<li>⚠ {_esc(n)}</li>" for n in result["notes"]) + "</ul>")
    body.append(f"<footer>Robot file <code>{_esc(result['robot']['file'])}</code> ({_esc(result['robot']['hash'])}), data "
                f"{_esc(result['data']['hash'])}, seed {result['seed']}, tiller {_esc(result['tiller'])}. σ: standard "
                "deviation of what sensor and process noise of the robot file leave.</footer>")
    return page.page(f"{result['robot']['name']}: {_headline(result)}", "".join(body))


def write_report(json_path: str | Path, out: str | Path) -> Path:
    """Reads gap.json and writes the page; raises ReportError with a sentence for the user."""
    result = read_json(json_path)
    if result.get("format") != "tiller-gap":
        raise ReportError(f"{json_path}: is no result of `tiller gap -o FOLDER`")
    if result.get("version") != 1:
        raise ReportError(f"{json_path}: version {result.get('version')} of the format, expected 1; use the tiller that "
                          "wrote it")
    try:
        write_page(out, build(result))
    except KeyError as error:
        raise ReportError(f"{json_path}: no key {error}; the file is incomplete") from None
    return Path(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.gap_report", description="A page from gap.json.")
    parser.add_argument("json", help="what `tiller gap -o FOLDER` left")
    parser.add_argument("-o", "--out", help="page to write (default: the JSON's name with .html)")
    options = parser.parse_args(argv)
    try:
        print(write_report(options.json, options.out or Path(options.json).with_suffix(".html")))
    except ReportError as error:
        print(f"gap report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
