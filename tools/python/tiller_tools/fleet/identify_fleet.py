"""`tiller fleet identify`: parameters of each robot, of the fleet, and who does not belong to it."""

from __future__ import annotations

import math

import numpy as np

from ..interval import plain_interval
from . import hierarchy, odd
from .chance import chi_square_tail
from .files import FleetError
from .jobs import Job
from .summaries import Coordinate, Evidence, coordinates_of, disagreement, evidence_of, together

LEAST = 3  # robots of a population


def line(kept: dict) -> str:
    """What came out of one log, in words."""
    if "refusal" in kept:
        return "refused: " + (kept["refusal"].splitlines() or ["without a word"])[-1][:160]
    learnt = [f"{p['name']} {p['mean']:.4g} ± {p['sd']:.2g}" for p in kept["result"]["parameters"] if not p["fixed"]]
    return ", ".join(learnt) + f"; noise {kept['result']['noise_scale']:.2f}"


def _same_coordinates(all_coordinates: dict[str, list[Coordinate]]) -> list[Coordinate]:
    names = list(all_coordinates)
    first = all_coordinates[names[0]]
    for name in names[1:]:
        if all_coordinates[name] != first:
            raise FleetError(f"robots '{names[0]}' and '{name}' do not learn the same parameters with the same priors; "
                             "a fleet's robot files may differ in what is known alone")
    if not first:
        raise FleetError("the robot file learns nothing: every parameter is a number; give one a prior")
    return first


class Robots:
    """What was fitted, robot by robot."""

    def __init__(self, fitted: list[tuple[Job, dict]]):
        self.refused = [{"robot": job.robot, "log": job.log_names, "why": kept["refusal"]}
                        for job, kept in fitted if "refusal" in kept]
        good = [(job, kept["result"]) for job, kept in fitted if "result" in kept]
        if not good:
            raise FleetError("no log could be fitted; the first was refused: " + (self.refused[0]["why"] or "?"))
        self.coordinates = _same_coordinates({job.name: coordinates_of(result) for job, result in good})
        self.parts: dict[str, list[Evidence]] = {}
        self.results: dict[str, list[dict]] = {}
        for job, result in good:
            part = evidence_of(np.array(result["samples"], dtype=float), self.coordinates)
            self.parts.setdefault(job.robot, []).append(part)
            self.results.setdefault(job.robot, []).append(result)
        self.names = sorted(self.parts)
        self.fleet = hierarchy.fleet_of([together(self.parts[name]) for name in self.names], self.coordinates)

    def log_noise(self) -> np.ndarray:
        """(n) logarithm of the noise that each robot's logs show over what its file states, mean over its logs."""
        scales = [[r["noise_scale"] or math.nan for r in self.results[name]] for name in self.names]
        return np.array([float(np.mean(np.log(s))) for s in scales])

    def own_disagreement(self) -> np.ndarray:
        """(n) tail probability of the distance between a robot's own logs; 1 for one log."""
        found = [disagreement(self.parts[name]) for name in self.names]
        return np.array([float(chi_square_tail(s, k)) if k > 0 else 1.0 for s, k in found])

    def trends(self) -> tuple[list[str], np.ndarray]:
        """(names of the quantities, (n x quantities) how far a robot's residuals go with each, in deviations)."""
        tables = {name: [_trends_of(r) for r in self.results[name]] for name in self.names}
        quantities = list(dict.fromkeys(q for logs in tables.values() for table in logs for q in table))
        values = np.full((len(self.names), len(quantities)), math.nan)
        for i, name in enumerate(self.names):
            for j, quantity in enumerate(quantities):
                z = [table[quantity] for table in tables[name] if table.get(quantity) is not None]
                if z:
                    values[i, j] = sum(z) / math.sqrt(len(z))
        return quantities, values

    def strange_residuals(self) -> tuple[np.ndarray, list[str]]:
        """(n) tail probability of residuals that go with something as no other's do, over all that was asked
        (Bonferroni); and (n) with what."""
        quantities, values = self.trends()
        if not quantities:
            return np.ones(len(self.names)), [""] * len(self.names)
        tails = np.column_stack([odd.outliers(column) for column in values.T])
        return np.minimum(1.0, len(quantities) * tails.min(axis=1)), [quantities[k] for k in tails.argmin(axis=1)]


def _trends_of(result: dict) -> dict[str, float | None]:
    """Quantity -> deviations, of one log."""
    out: dict[str, float | None] = {}
    for channel in result.get("residual_trends") or []:
        name = channel["name"]
        out[name], out[f"the change of {name}"] = channel["value"], channel["change"]
        for unit, z in channel["inputs"].items():
            out[unit if len(result["residual_trends"]) == 1 else f"{unit} (in {name})"] = z
    return out


def _posterior(robots: Robots, alpha: float, seed: int):
    """Draws of the population of those who belong to it; tail probabilities of all; who was left out; the level."""
    several = any(len(parts) > 1 for parts in robots.parts.values())
    level = alpha / (robots.fleet.size * (4 if several else 3))
    noise, own = odd.outliers(robots.log_noise()), robots.own_disagreement()
    residuals, _ = robots.strange_residuals()
    draws, place, out = odd.judge(robots.fleet, [noise, own, residuals], level, seed)
    return draws, {"parameters": place, "noise": noise, "residuals": residuals, "logs": own}, out, level


REASONS = {"parameters": "its parameters are not of this fleet", "noise": "its noise is not that of the others",
           "residuals": "its residuals go with {quantity} as no other's do", "logs": "its own logs disagree"}


def _values(coordinates: list[Coordinate], draws: np.ndarray) -> list[dict]:
    """Mean, deviation and intervals of parameters from draws of coordinates (s x d)."""
    out = []
    for k, c in enumerate(coordinates):
        v = c.value(draws[:, k].astype(float))
        low, median, high = np.quantile(v, [0.05, 0.5, 0.95])
        out.append({"mean": float(v.mean()), "sd": float(v.std(ddof=1)), "median": float(median),
                    "interval_90": [float(low), float(high)]})
    return out


def _alone(robots: Robots, name: str) -> list[dict]:
    """Of the robot's first log, as identify says it: with the file's prior, without the fleet."""
    learnt = [p for p in robots.results[name][0]["parameters"] if not p["fixed"]]
    return [{"mean": p["mean"], "sd": p["sd"], "interval_90": p["interval_90"]} for p in learnt]


def _lone_draws(fleet: hierarchy.Fleet, i: int, rng: np.random.Generator) -> np.ndarray:
    """Of a robot that does not belong: its own logs with the file's prior, the fleet left out."""
    precision = fleet.lam[i] + np.diag(np.where(fleet.mean_precision > 0, fleet.mean_precision, 1e-3 / fleet.scale**2))
    covariance = np.linalg.inv(precision)
    mean = covariance @ (fleet.eta[i] + fleet.mean_precision * fleet.mean_centre)
    return mean + rng.standard_normal((2000, len(mean))) @ np.linalg.cholesky(0.5 * (covariance + covariance.T)).T


def _robot_rows(robots: Robots, draws, tails: dict, out: np.ndarray, level: float, seed: int) -> list[dict]:
    theta, place = draws.flat("theta"), np.cumsum(~out) - 1
    mu = draws.flat("mean").mean(axis=0)
    quantities, rows = robots.strange_residuals()[1], []
    for i, name in enumerate(robots.names):
        rng = np.random.Generator(np.random.PCG64([seed, 1000 + i]))
        own = _lone_draws(robots.fleet, i, rng) if out[i] else theta[:, place[i]]
        why = [REASONS[kind].format(quantity=quantities[i]) for kind in tails if tails[kind][i] < level]
        centre = own.mean(axis=0)
        rows.append({"robot": name, "logs": len(robots.parts[name]), "odd": bool(why), "why": why,
                     "tails": {kind: float(tails[kind][i]) for kind in tails},
                     "noise_scale": float(np.exp(robots.log_noise()[i])),
                     "alarms": sum(1 for r in robots.results[name] if r.get("alarm")),
                     "parameters": _values(robots.coordinates, own), "alone": _alone(robots, name),
                     "distance": [float(v) for v in (centre - mu)]})
    return rows


def _population(robots: Robots, draws) -> dict:
    mean, covariance = draws.flat("mean"), draws.flat("covariance")
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    correlation = covariance / (sd[:, :, None] * sd[:, None, :])
    rows = []
    for k, (c, centre) in enumerate(zip(robots.coordinates, _values(robots.coordinates, mean))):
        low, middle, high = np.quantile(sd[:, k], [0.05, 0.5, 0.95])
        c_low, c_high = np.quantile(mean[:, k], [0.05, 0.95])
        rows.append({"name": c.name, "unit": c.unit, "coordinate": "log" if c.is_log else "linear", "centre": centre,
                     "centre_coordinate_90": [float(c_low), float(c_high)],
                     "spread": {"median": float(middle), "interval_90": [float(low), float(high)]}})
    return {"parameters": rows, "correlation": np.median(correlation, axis=0).tolist(),
            "r_hat": hierarchy.worst_r_hat(draws)}


def analyse(fitted: list[tuple[Job, dict]], alpha: float, seed: int) -> dict:
    """The fleet's result, as fleet.json holds it."""
    robots = Robots(fitted)
    if len(robots.names) < LEAST:
        raise FleetError(f"{len(robots.names)} robots are no fleet; give at least {LEAST}, or use tiller identify")
    draws, tails, out, level = _posterior(robots, alpha, seed)
    rows = _robot_rows(robots, draws, tails, out, level, seed)
    first = robots.results[robots.names[0]][0]
    population = _population(robots, draws)
    notes = []
    if population["r_hat"] > 1.05:
        notes.append(f"the sampler of the population has not settled (R-hat {population['r_hat']:.2f}): its intervals are "
                     "rough; more robots or longer logs help")
    low = [name for name in robots.names if min(r["exponent"] or 1 for r in robots.results[name]) < 0.5]
    if low:
        notes.append(f"{len(low)} robots have fits that did not converge ({', '.join(low[:5])}): "
                     "give each more --particles")
    return {"format": "tiller-fleet", "version": 1, "what": "identify", "tiller": first["tiller"],
            "robot": first["robot"], "false_alarm": alpha, "level": level, "robots": rows,
            "odd": [r["robot"] for r in rows if r["odd"]], "refused": robots.refused, "population": population,
            "notes": notes}


def text(result: dict) -> str:
    """What the command prints."""
    lines = [f"{result['robot']}: {len(result['robots'])} robots, {len(result['odd'])} odd, "
             f"{len(result['refused'])} logs refused", "",
             f"  {'parameter':<28} {'fleet':>10} {'90 % interval':>24}   {'spread':>8} {'90 % interval':>20}"]
    for p in result["population"]["parameters"]:
        factor = 100 if p["coordinate"] == "log" else 1
        unit = "%" if factor == 100 else ""
        c, s = p["centre"], p["spread"]
        lines.append(f"  {p['name']:<28} {c['median']:10.4g} {plain_interval(*c['interval_90']):>24}   "
                     f"{factor * s['median']:7.3g}{unit:1} "
                     f"{plain_interval(*(factor * end for end in s['interval_90']), 3):>20}")
    lines.append("")
    for r in result["robots"]:
        if r["odd"]:
            values = ", ".join(f"{p['name']} {v['median']:.4g}" for p, v in
                               zip(result["population"]["parameters"], r["parameters"]))
            lines.append(f"  odd: {r['robot']}: {'; '.join(r['why'])} ({values}; noise {r['noise_scale']:.2f})")
    if not result["odd"]:
        chance = 100 * result["false_alarm"]
        lines.append(f"  no odd robot; one would be named by chance in {chance:.2g} % of such fleets")
    lines += [f"  refused: {r['robot']} ({r['log']}): {r['why'].splitlines()[-1] if r['why'] else '?'}"
              for r in result["refused"]]
    return "\n".join(lines + [f"  note: {note}" for note in result["notes"]]) + "\n"
