"""`tiller fleet gap`: which missing effects the whole fleet has, how strong they are, and whose verdict differs."""

from __future__ import annotations

import math

import numpy as np

from ..interval import plain_interval
from . import hierarchy, odd
from .files import FleetError
from .hierarchy import Fleet
from .jobs import Job

NAMING = ("named", "leading", "partly_explained")  # verdicts that stand behind one explanation
COMMON = 0.5  # share of the robots from which an effect is the fleet's
RARE = 0.1  # share below which it is a robot's own
LEAST_STRENGTHS = 5  # robots whose strengths make a population


def line(kept: dict) -> str:
    if why := _why_refused(kept):
        return "refused: " + why[:160]
    names = " + ".join(_effects(kept["result"]))
    return kept["result"]["verdict"].replace("_", " ") + (f": {names}" if names else "")


def _why_refused(kept: dict) -> str:
    """A sentence where the log gave no verdict: the command refused it, or the data do not suffice."""
    if "refusal" in kept:
        return (kept["refusal"].splitlines() or ["without a word"])[-1]
    return "; ".join(kept["result"]["reasons"]) if kept["result"]["verdict"] == "unfit" else ""


def _effects(result: dict) -> list[str]:
    """"kind (port)" of the explanation that a verdict stands behind."""
    if result["verdict"] not in NAMING or not result["ranking"]:
        return []
    return sorted(f"{e['kind']} ({e['port']})" if e["port"] else e["kind"] for e in result["ranking"][0]["effects"])


def _equals(result: dict) -> list[str]:
    """Effects of explanations that did equally well."""
    if result["verdict"] != "ambiguous":
        return []
    equal = [r for r in result["ranking"] if r.get("equivalent")]
    return sorted({f"{e['kind']} ({e['port']})" for r in equal for e in r["effects"]})


def _share_interval(k: int, n: int) -> list[float]:
    """90 % interval of a share by Jeffreys' prior, Beta(k + 1/2, n - k + 1/2), from its draws."""
    rng = np.random.Generator(np.random.PCG64([k, n]))
    low, high = np.quantile(rng.beta(k + 0.5, n - k + 0.5, 20000), [0.05, 0.95])
    return [0.0 if k == 0 else float(low), 1.0 if k == n else float(high)]


def _strength(values: list[tuple[float, float]], seed: int) -> dict | None:
    """Population of one parameter from means and deviations of the robots that have the effect."""
    good = [(m, s) for m, s in values if m is not None and s is not None and s > 0 and math.isfinite(m)]
    if len(good) < LEAST_STRENGTHS:
        return None
    mean, sd = np.array(good).T
    scale = np.array([max(float(np.std(mean)), float(np.median(sd))) * 3])
    fleet = Fleet((1 / sd**2)[:, None, None], (mean / sd**2)[:, None], np.zeros(1), np.zeros(1), scale)
    draws = hierarchy.sample(fleet, seed)
    centre, spread = draws.flat("mean")[:, 0], np.sqrt(draws.flat("covariance")[:, 0, 0])
    return {"robots": len(good), "centre": float(np.median(centre)),
            "centre_90": [float(v) for v in np.quantile(centre, [0.05, 0.95])], "spread": float(np.median(spread)),
            "spread_90": [float(v) for v in np.quantile(spread, [0.05, 0.95])]}


def _parameters_of(results: dict[str, dict], effect: str, seed: int) -> list[dict]:
    """Strengths of an effect over the robots whose verdict stands behind it."""
    values: dict[tuple[str, str], list] = {}
    for result in results.values():
        if effect not in _effects(result):
            continue
        port = effect.split(" (")[1][:-1] if " (" in effect else ""
        for p in result["ranking"][0]["parameters"]:
            if p["of"] == "effect" and (not port or p["name"].startswith(port + ".")):
                values.setdefault((p["name"], p["unit"]), []).append((p["mean"], p["sd"]))
    found = [(key, _strength(v, seed)) for key, v in sorted(values.items())]
    return [{"name": name, "unit": unit, **s} for (name, unit), s in found if s]


def _differences(own: set, common: set, rare: set) -> list[str]:
    out = [f"has {e}, which few others have" for e in sorted(own & rare)]
    return out + [f"lacks {e}, which the fleet has" for e in sorted(common - own)]


def analyse(fitted: list[tuple[Job, dict]], alpha: float, seed: int) -> dict:
    results = {job.robot: kept["result"] for job, kept in fitted if not _why_refused(kept)}
    refused = [{"robot": job.robot, "log": job.log_names, "why": _why_refused(kept)}
               for job, kept in fitted if _why_refused(kept)]
    if len(results) < 3:
        raise FleetError(f"{len(results)} robots could be looked at, which is no fleet; "
                         + (refused[0]["why"] if refused else "give at least 3"))
    effects = sorted({e for r in results.values() for e in _effects(r)})
    counts = {e: sum(e in _effects(r) for r in results.values()) for e in effects}
    n = len(results)
    common = {e for e in effects if counts[e] / n >= COMMON}
    rare = {e for e in effects if counts[e] / n < RARE}
    names = sorted(results)
    sigma = np.array([math.log(max(results[x]["gate"]["nominal_sigma"] or math.nan, 1e-3)) for x in names])
    tails, level = odd.outliers(sigma), alpha / len(names)
    rows = []
    for i, name in enumerate(names):
        own = set(_effects(results[name]))
        differs = _differences(own, common, rare)
        side = "larger" if sigma[i] > np.median(sigma) else "smaller"
        why = [f"its gap is {side} than that of the others"] if tails[i] < level else []
        rows.append({"robot": name, "verdict": results[name]["verdict"], "effects": sorted(own),
                     "equals": _equals(results[name]), "sentence": results[name]["sentence"],
                     "gap_sigma": results[name]["gate"]["nominal_sigma"], "tail": float(tails[i]), "odd": bool(why),
                     "why": why, "differs": differs})
    table = [{"effect": e, "robots": counts[e], "share": counts[e] / n, "share_90": _share_interval(counts[e], n),
              "of": "the fleet" if e in common else "single robots" if e in rare else "a part of the fleet",
              "parameters": _parameters_of(results, e, seed)} for e in sorted(effects, key=lambda e: -counts[e])]
    first = results[names[0]]
    return {"format": "tiller-fleet", "version": 1, "what": "gap", "tiller": first["tiller"],
            "robot": first["robot"]["name"], "false_alarm": alpha, "level": level, "effects": table, "robots": rows,
            "odd": [r["robot"] for r in rows if r["odd"]], "differing": [r["robot"] for r in rows if r["differs"]],
            "refused": refused, "notes": []}


def text(result: dict) -> str:
    lines = [f"{result['robot']}: {len(result['robots'])} robots, {len(result['odd'])} odd, "
             f"{len(result['differing'])} with a verdict of their own", ""]
    for e in result["effects"]:
        lines.append(f"  {e['effect']:<40} {e['robots']:5d} robots, {100 * e['share']:3.0f} % "
                     f"({100 * e['share_90'][0]:.0f} .. {100 * e['share_90'][1]:.0f} %): {e['of']}")
        for p in e["parameters"]:
            low, high = p["centre_90"]
            lines.append(f"    {p['name']:<38} {p['centre']:.4g} {p['unit']} ({plain_interval(low, high)}), "
                         f"from robot to robot {p['spread']:.2g}")
    if not result["effects"]:
        lines.append("  no effect is named of any robot")
    lines.append("")
    for r in result["robots"]:
        if r["odd"] or r["differs"]:
            lines.append(f"  {'odd' if r['odd'] else 'differs'}: {r['robot']}: {'; '.join(r['why'] + r['differs'])}")
    lines += [f"  refused: {r['robot']} ({r['log']}): {r['why'][:160]}" for r in result["refused"]]
    return "\n".join(lines) + "\n"
