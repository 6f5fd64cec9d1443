"""One page about a fleet, from fleet.json."""

from __future__ import annotations

import html

import numpy as np

from .. import page

MOST_LINES = 300  # of the robots that are as the others; the odd ones are always shown


def _percent(value: float) -> str:
    return f"{page.number(100 * value, 3)} %"


def _range(interval, percent: bool = False) -> str:
    if percent:
        return page.interval(100 * interval[0], 100 * interval[1], 3, unit=" %")
    return page.interval(interval[0], interval[1])


# ---- identify --------------------------------------------------------------------------------------


def _population_table(result: dict) -> str:
    body = []
    for p in result["population"]["parameters"]:
        of = _percent if p["coordinate"] == "log" else page.number
        body.append([page.quantity_label(p["name"], p["unit"]), page.number(p["centre"]["median"]),
                     _range(p["centre"]["interval_90"]), of(p["spread"]["median"]),
                     _range(p["spread"]["interval_90"], of is _percent)])
    return page.rows(["parameter", "centre of the fleet", "90 %", "spread from robot to robot", "90 %"], body)


def _shrinkage_figure(result: dict, k: int) -> str:
    """Robots sorted by value: what their logs say alone, and with the fleet."""
    p = result["population"]["parameters"][k]
    robots = sorted(result["robots"], key=lambda r: r["parameters"][k]["median"])
    x = np.arange(len(robots))
    alone = np.array([r["alone"][k]["interval_90"] for r in robots], dtype=float)
    own = np.array([r["parameters"][k]["interval_90"] for r in robots], dtype=float)
    odd = np.array([r["odd"] for r in robots])
    figure, ax = page.axes(p["name"], page.unit_label(p["name"], p["unit"]), "robots, sorted")
    cut = page.thin(len(robots), 400)
    ax.vlines(x[cut], alone[cut, 0], alone[cut, 1], color=page.BAND, linewidth=3, label="its logs alone, 90 %")
    ax.vlines(x[cut], own[cut, 0], own[cut, 1], color=page.ESTIMATE, linewidth=1.0, label="within the fleet, 90 %")
    if odd.any():
        middle = np.array([r["parameters"][k]["median"] for r in robots])
        ax.plot(x[odd], middle[odd], "v", color=page.LIMIT, markersize=7, linestyle="none", label="odd")
    page.legend(ax)
    return page.svg(figure, "Where its logs say little, the fleet narrows what is known of a robot. "
                            "An odd one stands alone.")


def _plane_figure(result: dict, a: int, b: int) -> str:
    """Two parameters of all robots, the odd ones by name."""
    params = result["population"]["parameters"]
    figure, ax = page.axes("All robots in a plane", page.quantity_label(params[b]["name"], params[b]["unit"]),
                           page.quantity_label(params[a]["name"], params[a]["unit"]), height=4.2)
    for odd, look in ((False, {"marker": "o", "color": page.ESTIMATE, "markersize": 3, "alpha": 0.5}),
                      (True, {"marker": "v", "color": page.LIMIT, "markersize": 8})):
        rows = [r for r in result["robots"] if r["odd"] == odd]
        ax.plot([r["parameters"][a]["median"] for r in rows], [r["parameters"][b]["median"] for r in rows],
                linestyle="none", label="odd" if odd else "of the fleet", **look)
        for r in rows if odd else []:
            ax.annotate(r["robot"], (r["parameters"][a]["median"], r["parameters"][b]["median"]), xytext=(6, 4),
                        textcoords="offset points", fontsize=9)
    page.legend(ax)
    return page.svg(figure)


def _noise_figure(result: dict) -> str:
    noise = np.array([r["noise_scale"] for r in result["robots"]])
    figure, ax = page.density_axes("Noise of each robot", "times what the robot file says")
    ax.hist(noise, bins=40, color=page.BAND)
    for r in result["robots"]:
        if r["odd"] and "noise" in " ".join(r["why"]):
            ax.axvline(r["noise_scale"], color=page.LIMIT, linewidth=1.2)
    return page.svg(figure, "Physics that the model lacks shows as noise. Red: odd by it.")


def _tail(value: float) -> str:
    return "below 1e-15" if value < 1e-15 else page.number(value, 2)


def _identify_rows(result: dict, rows: list[dict]) -> str:
    names = [p["name"] for p in result["population"]["parameters"]]
    body = []
    for r in rows:
        values = [f"{page.number(v['median'])} ({_range(v['interval_90'])})" for v in r["parameters"]]
        body.append([r["robot"], str(r["logs"]), *values, f"{r['noise_scale']:.2f}",
                     _tail(min(r["tails"].values())), "; ".join(r["why"])])
    return page.rows(["robot", "logs", *[f"{n} (90 %)" for n in names], "noise", "chance", ""], body)


def _identify(result: dict) -> list[str]:
    count = len(result["population"]["parameters"])
    figures = [_shrinkage_figure(result, k) for k in range(count)]
    if count > 1:
        figures.append(_plane_figure(result, 0, 1))
    figures.append(_noise_figure(result))
    odd = [r for r in result["robots"] if r["odd"]]
    others = [r for r in result["robots"] if not r["odd"]]
    body = ["<h2>Who is odd</h2>"]
    body.append(_identify_rows(result, sorted(odd, key=lambda r: min(r["tails"].values()))) if odd else
                "<p>No robot.</p>")
    body += [f"<p>“Chance” is how often a sound robot would lie as far out. A robot is named below "
             f"{page.number(result['level'], 2)}: of fleets without an odd robot, "
             f"{page.number(100 * result['false_alarm'], 2)} % have one named.</p>",
             "<h2>The fleet</h2>", _population_table(result),
             "<p>The spread of a parameter with a log-normal prior is that of its logarithm, as a percentage.</p>",
             page.grid(figures), "<h2>Every robot</h2>", _identify_rows(result, others[:MOST_LINES])]
    if len(others) > MOST_LINES:
        body.append(f"<p>{len(others) - MOST_LINES} more are in fleet.json.</p>")
    return body


# ---- gap -------------------------------------------------------------------------------------------


def _effects_figure(result: dict) -> str:
    effects = result["effects"][:12][::-1]
    figure, ax = page.axes("Effects over the fleet", "", "share of the robots (%)", height=1.2 + 0.4 * len(effects))
    share = np.array([e["share"] for e in effects])
    bounds = np.array([e["share_90"] for e in effects])
    ax.barh(np.arange(len(effects)), 100 * share, color=page.BAND)
    ax.hlines(np.arange(len(effects)), 100 * bounds[:, 0], 100 * bounds[:, 1], color=page.ESTIMATE)
    ax.set_yticks(np.arange(len(effects)), [e["effect"] for e in effects])
    ax.set_xlim(0, 100)
    return page.svg(figure, "Lines: 90 % intervals of the share.", wide=True)


def _gap(result: dict) -> list[str]:
    body = ["<h2>What the fleet has</h2>"]
    table = [[e["effect"], f"{e['robots']} ({100 * e['share']:.0f} %)", e["of"],
              "; ".join(f"{p['name']} {page.number(p['centre'])} {p['unit']}, spread {page.number(p['spread'], 2)}"
                        for p in e["parameters"])] for e in result["effects"]]
    if table:
        body += [page.rows(["effect", "robots", "of", "strength"], table), page.grid([_effects_figure(result)])]
    else:
        body += ["<p>No effect is named of any robot.</p>"]
    special = [r for r in result["robots"] if r["odd"] or r["differs"]]
    line = lambda r: [r["robot"], r["verdict"].replace("_", " "), " + ".join(r["effects"]) or "–",
                      page.number(r["gap_sigma"], 3), "; ".join(r["why"] + r["differs"])]
    header = ["robot", "verdict", "effects", "gap (σ)", ""]
    body += ["<h2>Who differs</h2>", page.rows(header, [line(r) for r in special]) if special else "<p>No robot.</p>",
             "<p>Odd robots are named by the size of their gap, at a chance of false alarms that holds over the whole "
             "fleet. A verdict that differs is a hint: an effect is misnamed in 1 to 5 % of the cases.</p>",
             "<h2>Every robot</h2>",
             page.rows(header, [line(r) for r in result["robots"] if r not in special][:MOST_LINES])]
    return body


def build(result: dict) -> str:
    odd, escape = result["odd"], html.escape
    named = ", ".join(odd[:12]) + (f" and {len(odd) - 12} more" if len(odd) > 12 else "")
    body = [f"<h1>{escape(result['robot'])}: a fleet of {len(result['robots'])} robots</h1>",
            page.outcome(f"odd: {named}" if odd else "no odd robot", not odd),
            page.facts([("robots", str(len(result["robots"]))), ("odd", str(len(odd))),
                        ("logs refused", str(len(result["refused"])))]),
            page.warnings(result["notes"])]
    body += _identify(result) if result["what"] == "identify" else _gap(result)
    if result["refused"]:
        body += ["<h2>Refused logs</h2>",
                 page.rows(["robot", "log", "why"], [[r["robot"], r["log"], r["why"][-300:]] for r in result["refused"]])]
    body.append(f"<footer>tiller fleet {result['what']}; tiller {escape(result['tiller'])}.</footer>")
    return page.page(f"{result['robot']}: fleet", "".join(body))
