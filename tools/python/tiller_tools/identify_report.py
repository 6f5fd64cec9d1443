"""One page about a fit: python -m tiller_tools.identify_report identify.json -o identify.html

The JSON is what `tiller identify -o FOLDER` writes: candidates from the nominal model to the one with every effect,
each with parameters, draws, rollout errors and a few rollouts beside what was measured.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from . import page
from .table import ReportError, read_json, write_page


def _learnt(candidate: dict) -> list[dict]:
    return [p for p in candidate["parameters"] if not p["fixed"]]


def _short(candidate: dict, model: str) -> str:
    """The part of a candidate's name that tells it from the others."""
    name = candidate["name"]
    if name == "nominal":
        return "nominal"
    extra = name.split(" + ")[1:]
    return "+ " + extra[-1].split(" (")[0].replace("_", " ") if extra else f"{model}, fitted"


def _method(candidate: dict) -> dict:
    """By what it was learnt; a file from before there was a choice has the posterior."""
    return candidate.get("method", {"name": "posterior", "citation": "", "caveat": "", "simulations": 0,
                                    "iterations": []})


def _is_posterior(candidate: dict) -> bool:
    return _method(candidate)["name"] == "posterior"


def _noise(candidate: dict) -> str:
    return "–" if candidate["noise_scale"] is None else f"{page.number(candidate['noise_scale'], 3)} ×"


def _array(values) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


# ---- figures ---------------------------------------------------------------------------------------


def _prior_draws(candidate: dict, index: int) -> np.ndarray:
    return np.array([row[index] for row in candidate.get("prior_samples", [])])


def marginal_figure(candidate: dict, index: int) -> str:
    """The posterior over the prior, on the prior's scale while the posterior can still be seen there."""
    param = _learnt(candidate)[index]
    draws, before = np.array(candidate["samples"])[:, index], _prior_draws(candidate, index)
    low, high = param["prior"]["interval_90"]
    times = (high - low) / max(param["interval_90"][1] - param["interval_90"][0], 1e-300)
    figure, ax = page.density_axes(param["name"], page.quantity_label(param["name"], param.get("unit")), height=3.0)
    ax.axvspan(low, high, color=page.PRIOR, label="prior 90 %")
    edges = np.linspace(min(draws.min(), *before), max(draws.max(), *before), 60) if before.size else 40
    notes = []
    if times > 15:
        reach = 0.8 * (draws.max() - draws.min()) + 1e-300
        ax.set_xlim(draws.min() - reach, draws.max() + reach)
        edges = 40
        notes.append(f"Drawn on the posterior's scale: the prior's 90 % are {page.number(times, 2)} times as wide.")
    elif before.size:
        ax.hist(before, bins=edges, density=True, histtype="step", color=page.MEASURED, linewidth=1.2, label="prior")
    ax.hist(draws, bins=edges, density=True, color=page.BAND, label=_method(candidate)["name"].replace("_", " "))
    ax.axvline(param["mean"], color=page.ESTIMATE, label="mean")
    page.legend(ax)
    if param.get("edge"):
        notes.append(f"Mind: {param['edge']['text']}.")
    elif not low <= param["mean"] <= high:
        notes.append("The posterior leaves the prior's 90 %: the prior, or the model, deserves a second look.")
    return page.svg(figure, " ".join(notes))


def _pair(ax, x: np.ndarray, y: np.ndarray, color: str) -> None:
    ax.plot(x, y, ".", markersize=2.5, alpha=0.5, color=color)


def pairs_figure(candidate: dict) -> str | None:
    """Lower triangle: the posterior on its own scale; upper triangle: the same inside the prior."""
    learnt = _learnt(candidate)
    if len(learnt) < 2:
        return None
    # some dots tell as much as all, and each weighs 150 bytes of the page
    draws, before = np.array(candidate["samples"])[:250], np.array(candidate.get("prior_samples", []))[:150]
    n = len(learnt)
    side = max(5.6, 1.6 * n)
    figure, axes = page.plt.subplots(n, n, figsize=(side + 0.4, side), squeeze=False)
    figure.set_label("pairs of parameters")
    for r in range(n):
        for c in range(n):
            ax = axes[r][c]
            if c == r:
                ax.hist(draws[:, r], bins=30, color=page.BAND)
                ax.set_yticks([])
            elif c < r:
                _pair(ax, draws[:, c], draws[:, r], color=page.ESTIMATE)
            elif before.size:
                _pair(ax, before[:, c], before[:, r], color=page.MEASURED)
                _pair(ax, draws[:, c], draws[:, r], color=page.ESTIMATE)
                ax.set_facecolor("#f8f8f8")
            else:
                ax.axis("off")
            ax.tick_params(labelsize=7, labelleft=c == 0 and r > 0, labelbottom=r == n - 1)
            if c > r:  # a scale of its own: labelled at the outside
                ax.tick_params(labeltop=r == 0, labelright=c == n - 1, labelbottom=False)
            ax.locator_params(nbins=3)
            if r == n - 1:
                ax.set_xlabel(learnt[c]["name"], fontsize=8)
            if c == 0 and r > 0:
                ax.set_ylabel(learnt[r]["name"], fontsize=8)
    return page.svg(figure, "Draws from the posterior. A slanted cloud means that the logs fix a combination better "
                            "than each parameter alone. Shaded panels: the same on the scale of the prior (grey).")


# ---- while the logs were taken in --------------------------------------------------------------------


def _history_axes(history: dict, title: str, ylabel: str):
    figure, ax = page.axes(title, ylabel, xlabel="data taken in (s)", height=3.2)
    for start in history["stretches_s"][1:]:
        ax.axvline(start, color=page.MEASURED, linewidth=0.8, linestyle=(0, (1, 2)))
    return figure, ax


def _learnt_early(history: dict) -> bool:
    """Whether every parameter's interval had halved within a twentieth of the data: drawn over a logarithmic axis."""
    time = _array(history["data_s"])
    halved = []
    for param in history["parameters"]:
        width = _array(param["high"]) - _array(param["low"])
        below = np.flatnonzero(width < 0.5 * width[0])
        halved.append(time[below[0]] if below.size else np.inf)
    return max(halved) < time[-1] / 20


def learning_figure(candidate: dict, index: int) -> str:
    """Mean and 90 % of a parameter while data come in, inside the prior's 90 %."""
    history = candidate["history"]
    param, prior = history["parameters"][index], _learnt(candidate)[index]["prior"]["interval_90"]
    time = _array(history["data_s"])
    figure, ax = _history_axes(history, f"posterior of {param['name']}",
                               page.unit_label(param["name"], _learnt(candidate)[index].get("unit")))
    ax.axhspan(*prior, color=page.PRIOR, label="prior 90 %")
    ax.fill_between(time, _array(param["low"]), _array(param["high"]), color=page.BAND, linewidth=0, label="90 %")
    ax.plot(time, _array(param["mean"]), color=page.ESTIMATE, label="mean")
    if _learnt_early(history):
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(page.plain)
        ax.set_xlim(time[1], time[-1])
    ax.margins(x=0)
    page.legend(ax)
    return page.svg(figure)


def count_figure(candidate: dict) -> str:
    history = candidate["history"]
    figure, ax = _history_axes(history, "effective sample size", "particles")
    ax.plot(_array(history["data_s"]), _array(history["effective_samples"]), color=page.ESTIMATE, linewidth=1.0)
    ax.set_ylim(bottom=0)
    ax.margins(x=0)
    return page.svg(figure, f"Of {candidate['particles']} particles. It falls as data weigh them, and is restored by "
                            "resampling and moves.")


def shares_figure(candidate: dict) -> str:
    history = candidate["history"]
    figure, ax = _history_axes(history, "acceptance of moves, exponent of the likelihood", "share")
    time = _array(history["data_s"])
    ax.plot(time, _array(history["acceptance"]), label="acceptance", **page.curve(0))
    ax.plot(time, _array(history["exponent"]), label="exponent", **page.curve(1))
    ax.set_ylim(0, 1.05)
    ax.margins(x=0)
    page.legend(ax)
    return page.svg(figure, "Below an exponent of 1 the data do not yet count in full. Acceptance near 0 means that "
                            "particles no longer move.")


def noise_figure(candidate: dict) -> str:
    history = candidate["history"]
    figure, ax = _history_axes(history, "noise over the robot file's", "ratio")
    ax.axhline(1, color=page.MEASURED, linewidth=0.8)
    ax.plot(_array(history["data_s"]), _array(history["noise_scale"]), color=page.ESTIMATE)
    ax.set_ylim(bottom=0)
    ax.margins(x=0)
    return page.svg(figure, "A step upwards marks data that the model does not explain.")


def _running_rms(values: np.ndarray, width: int = 21) -> np.ndarray:
    square, kernel = np.nan_to_num(values) ** 2, np.ones(min(width, len(values)))
    count = np.convolve(np.isfinite(values), kernel, "same")
    return np.sqrt(np.convolve(square, kernel, "same") / np.maximum(count, 1))


def residual_figure(history: dict, channel: dict) -> str:
    """Normalised one-step residuals: extremes and RMS of what lies between two snapshots."""
    figure, ax = _history_axes(history, f"normalised residuals of {channel['name']}", "standard deviations")
    time, low, high = _array(history["data_s"]), _array(channel["low"]), _array(channel["high"])
    ax.axhspan(-1.96, 1.96, color=page.PRIOR, label="95 %")
    ax.vlines(time, low, high, color=page.BAND, linewidth=1.2, label="least to largest")
    ax.plot(time, low, ".", color=page.ESTIMATE, markersize=2)
    ax.plot(time, high, ".", color=page.ESTIMATE, markersize=2)
    ax.plot(time, _running_rms(_array(channel["rms"])), color=page.TRUTH, linewidth=1.2, label="running RMS")
    reach = min(10.0, max(4.0, 1.1 * np.nanmax(np.abs(np.concatenate([low, high])))))
    ax.set_ylim(-reach, reach)
    ax.margins(x=0)
    page.legend(ax)
    outside = int(np.sum(low < -reach) + np.sum(high > reach))
    return page.svg(figure, f"{outside} beyond the axes." if outside else "")


def adequacy_figure(candidate: dict) -> str:
    history = candidate["history"]
    figure, ax = _history_axes(history, "test of the model", "statistic / threshold")
    ax.axhline(1, color=page.LIMIT, linewidth=1.5, label="alarm")
    time, statistic = _array(history["data_s"]), _array(history["adequacy"])
    if candidate["alarm"]:  # latched from then on
        ax.axvline(candidate["alarm"]["data_s"], color=page.LIMIT, linestyle=(0, (4, 2)))
        statistic = np.where(time <= candidate["alarm"]["data_s"], statistic, np.nan)
    ax.plot(time, statistic, color=page.ESTIMATE)
    ax.set_xlim(0, time[-1])
    ax.set_ylim(0, max(1.15, 1.1 * np.nanmax(_array(history["adequacy"]))))
    page.legend(ax)
    return page.svg(figure, "Residuals against what a missing force would have put into them. Above 1 no value of the "
                            "parameters explains the data; one run of 10,000 steps in a hundred gets there by chance.")


# Likely causes of a feature of the residuals (tiller_feature_t).
MEANING = {"bias": "a constant force, or an offset", "position": "a spring or gravity",
           "velocity": "viscous friction or drag",
           "velocity_sign": "dry friction", "input": "a gain of the drive", "input_change": "a delay or lag of the drive",
           "previous": "something that stays for a while", "size": "more noise than was stated, or growing"}


def adequacy_table(result: dict) -> str:
    body = []
    for candidate in result["candidates"]:
        if "alarm" not in candidate:
            continue
        alarm, left = candidate["alarm"], candidate.get("rollout_sigma")
        verdict = "adequate" if candidate.get("adequate", alarm is None) else "inadequate"
        row = [_short(candidate, result["model"]), verdict, "" if left is None else page.number(left, 3)]
        if alarm is None:
            body.append(row + ["", "", ""])
        else:
            body.append(row + [f"{alarm['channel']}, from {page.number(alarm['data_s'], 3)} s on",
                               alarm["feature"].replace("_", " "), MEANING.get(alarm["feature"], "")])
    if not body:
        return ""
    return ("<h2>Does the model explain the logs?</h2><p>A model is adequate where rollouts of 1 s leave no more than 1.1 "
            "times the noise, as <code>tiller gap</code> measures it. One-step residuals are tested at every step, too: "
            "they must go with nothing that was known before. That test sees what is far smaller than the noise.</p>"
            + page.rows(["model", "verdict", "rollouts leave (noise: 1)", "residual of", "goes with", "which points to"],
                        body))


def history_section(candidate: dict) -> str:
    history = candidate.get("history", {})
    if len(history.get("data_s", [])) < 2 or not _learnt(candidate):
        return ""
    figures = [learning_figure(candidate, i) for i in range(len(_learnt(candidate)))]
    figures += [residual_figure(history, channel) for channel in history.get("residuals", [])
                if any(v is not None for v in channel["rms"])]
    if "alarm" in candidate:
        figures.append(adequacy_figure(candidate))
    figures += [noise_figure(candidate), count_figure(candidate), shares_figure(candidate)]
    return "<h2>While the logs were taken in</h2>" + page.grid(figures)


def horizon_figure(result: dict, which: str, state_index: int) -> str:
    state = result["candidates"][0][which][state_index]
    title = f"error of {state['state']} over the horizon, {'held-out' if which == 'held_out' else 'fitted'} logs"
    figure, ax = page.axes(title, page.quantity_label("RMS error", state.get("unit")), xlabel="horizon (s)")
    for i, candidate in enumerate(result["candidates"]):
        curve = _array(candidate[which][state_index]["rms_by_step"])
        time = result["period_s"] * np.arange(1, len(curve) + 1)
        look = {"color": page.MEASURED} if i == 0 else page.curve(i - 1)
        ax.plot(time, curve, label=_short(candidate, result["model"]), **look)
    ax.set_ylim(bottom=0)
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure, "From every start the logged inputs are replayed through the model. The curve takes the "
                            "starts that last to its end.")


def trace_figure(result: dict, index: int) -> str:
    best, nominal = result["candidates"][-1]["traces"][index], result["candidates"][0]["traces"][index]
    figure, ax = page.axes(f"{best['state']} from {best['start_s']:.2f} s of {Path(best['path']).stem}",
                           page.unit_label(best["state"], best.get("unit")), xlabel="horizon (s)")
    time = best["period_s"] * np.arange(len(best["mean"]))
    if "predictive_low" in best:
        ax.fill_between(time, _array(best["predictive_low"]), _array(best["predictive_high"]), color=page.PREDICTIVE,
                        linewidth=0, label="90 % of readings")
    ax.fill_between(time, _array(best["low"]), _array(best["high"]), color=page.BAND, linewidth=0,
                    label="90 % of parameters")
    ax.plot(time, _array(nominal["mean"]), color=page.MEASURED, linestyle=(0, (4, 2)), label="nominal")
    ax.plot(time, _array(best["mean"]), color=page.ESTIMATE, label="fitted")
    ax.plot(time, _array(best["measured"]), color=page.TRUTH, linewidth=1.2, label="measured")
    ax.margins(x=0.01)
    page.legend(ax)
    return page.svg(figure)


# ---- the page --------------------------------------------------------------------------------------


def param_table(candidate: dict) -> str:
    body = []
    for p in candidate["parameters"]:
        if p["fixed"]:
            body.append([p["name"], "known", page.number(p["mean"]), "", ""])
        else:
            prior, post = p["prior"]["interval_90"], p["interval_90"]
            body.append([p["name"], page.interval(*prior, between=" … "), page.mean(p["mean"], p["sd"]),
                         page.number(p["sd"], 2), page.interval(*post, between=" … ")])
    return page.rows(["parameter", "prior 90 %", "mean", "sd", "posterior 90 %"], body)


def _error_cells(horizon: dict) -> list[str]:
    if not horizon["rollouts"]:
        return ["–", "–"]
    return [f"{page.number(horizon['rms_end'], 3)} ({page.number(horizon['median_abs_end'], 3)})",
            f"{100 * horizon['coverage_90']:.0f} %"]


def error_table(result: dict, which: str, state_index: int) -> str:
    horizons = result["candidates"][0][which][state_index]["horizons"]
    header = ["model"] + [cell for h in horizons
                          for cell in (f"{h['horizon_s']:g} s: RMS (median)", "inside 90 %")] + ["noise"]
    body = []
    for candidate in result["candidates"]:
        cells = [cell for h in candidate[which][state_index]["horizons"] for cell in _error_cells(h)]
        noise = _noise(candidate) if candidate["learns"] else "–"
        body.append([_short(candidate, result["model"])] + cells + [noise])
    return page.rows(header, body)


def errors_section(result: dict, which: str, title: str) -> str:
    parts = [f"<h2>{title}</h2>"]
    for i, state in enumerate(result["candidates"][0][which]):
        rollouts = state["horizons"][0]["rollouts"]
        parts.append(f"<p>{page.html.escape(state['state'])}, {rollouts} rollouts, begun at the states that the "
                     f"model's filter makes of the log up to there. Error at the end of the horizon, the median of the "
                     f"absolute error in brackets; and the share of ends inside the predictive 90 % (parameters, start state and noise).</p>")
        parts.append(error_table(result, which, i))
        parts.append(page.grid([horizon_figure(result, which, i)]))
    return "".join(parts)


def _facts(best: dict) -> list[tuple[str, str]]:
    facts = [("transitions", str(best["transitions"]))]
    if not _is_posterior(best):
        return facts + [("effective samples", f"{best['effective_samples']:.0f}"),
                        ("simulations", str(_method(best)["simulations"]))]
    return facts + [("effective samples", f"{best['effective_samples']:.0f} of {best['particles']}"),
                    ("noise over the robot file's", _noise(best))]


def iterations_section(candidate: dict) -> str:
    """SimOpt's Gaussian from iteration to iteration; nothing where a method has a single one."""
    iterations = _method(candidate)["iterations"]
    if len(iterations) < 2:
        return ""
    figures = []
    count = np.arange(1, len(iterations) + 1)
    for i, param in enumerate(candidate["parameters"]):
        if param["fixed"]:
            continue
        mean, sd = (_array([step[key][i] for step in iterations]) for key in ("mean", "sd"))
        figure, ax = page.axes(f"{param['name']} by iteration", page.unit_label(param["name"], param.get("unit")),
                               xlabel="iteration", height=3.2)
        ax.fill_between(count, mean - 1.645 * sd, mean + 1.645 * sd, color=page.BAND, linewidth=0)
        ax.plot(count, mean, color=page.ESTIMATE, label="mean, 90 % of the Gaussian")
        page.legend(ax)
        figures.append(page.svg(figure))
    figure, ax = page.axes("discrepancy by iteration", "dimensionless", xlabel="iteration", height=3.2)
    ax.plot(count, _array([step["discrepancy"] for step in iterations]), label="weighted mean", **page.curve(0))
    ax.plot(count, _array([step["smallest_discrepancy"] for step in iterations]), label="smallest", **page.curve(1))
    page.legend(ax)
    figures.append(page.svg(figure, "Where it no longer falls, further iterations narrow the Gaussian and learn "
                                    "nothing."))
    return "<h2>From iteration to iteration</h2>" + page.grid(figures)


def _what_was_used(result: dict) -> str:
    """Of long logs; empty where everything was used. Results of earlier versions do not say."""
    return "".join(f" Of the {what} logs, {result[key]['text']}." for key, what in
                   (("used", "fitted"), ("used_held_out", "held-out")) if result.get(key, {}).get("text"))


def build(result: dict) -> str:
    best = result["candidates"][-1]
    logs = ", ".join(Path(log["path"]).name for log in result["logs"])
    held = ", ".join(Path(log["path"]).name for log in result["held_out"]) or "none"
    body = [f"<h1>{page.html.escape(result['robot'])}: parameters from logs</h1>",
            f"<p class=lead>{page.html.escape(best['name'])}. Fitted: {page.html.escape(logs)}. Held out: "
            f"{page.html.escape(held)}.{page.html.escape(_what_was_used(result))}</p>",
            page.facts(_facts(best))]
    if not _is_posterior(best):
        method = _method(best)
        body.append(f"<p>Learnt by {page.html.escape(method['name'])} ({page.html.escape(method['citation'])}). Mind: "
                    f"{page.html.escape(method['caveat'])}. It knows of no noise scale: the predictive bands have the "
                    f"robot file's noise.</p>")
    edges = [param["edge"]["text"] for param in _learnt(best) if param.get("edge")]
    body += [page.warnings(result["warnings"]), "<h2>What was learnt</h2>", page.warnings(edges), param_table(best)]
    if _learnt(best):
        figures = [marginal_figure(best, i) for i in range(len(_learnt(best)))] + [pairs_figure(best)]
        body.append(page.grid([figure for figure in figures if figure]))
    body += [adequacy_table(result), history_section(best), iterations_section(best)]
    if result["held_out"]:
        body.append(errors_section(result, "held_out", "How well it foresees logs that were held out"))
    body.append(errors_section(result, "fitted", "… and the logs that it was fitted to"))
    body += [f"<h2>Some rollouts on {'held-out' if result['held_out'] else 'fitted'} logs</h2>", page.grid([trace_figure(result, i) for i in range(len(best["traces"]))])]
    body.append(f"<footer>From <code>{page.html.escape(result['robot_file'])}</code>, tiller "
                f"{page.html.escape(result['tiller'])}.</footer>")
    return page.page(f"{result['robot']}: parameters from logs", "".join(body))


def write_report(json_path: str | Path, out: str | Path) -> Path:
    """Reads identify.json and writes the page; raises ReportError with a sentence for the user."""
    result = read_json(json_path)
    for key in ("robot", "candidates", "logs", "held_out"):
        if key not in result:
            raise ReportError(f"{json_path}: no key '{key}'; expected the JSON of `tiller identify -o FOLDER`")
    if not result["candidates"]:
        raise ReportError(f"{json_path}: no candidate was fitted")
    write_page(out, build(result))
    return Path(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.identify_report", description="A page from identify.json.")
    parser.add_argument("json", help="what `tiller identify -o FOLDER` left")
    parser.add_argument("-o", "--out", help="page to write (default: the JSON's name with .html)")
    options = parser.parse_args(argv)
    try:
        print(write_report(options.json, options.out or Path(options.json).with_suffix(".html")))
    except ReportError as error:
        print(f"identify report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
