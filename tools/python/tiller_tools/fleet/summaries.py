"""What the logs of one robot say of its parameters, without the prior that they were fitted with.

A posterior is turned into a Gaussian in the coordinates of its priors (the logarithm for a log-normal one), and the
prior is divided out. What is left is a likelihood in information form: precision `lam` (d x d) and `eta` = lam mean.
A direction of which the logs say nothing has precision zero, which no covariance could state. docs/theory/fleet.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .files import FleetError


@dataclass(frozen=True)
class Coordinate:
    """One learnt parameter and the prior that each fit had."""

    name: str
    unit: str
    is_log: bool
    prior_mean: float  # of the coordinate
    prior_sd: float
    gaussian: bool  # the prior is normal in the coordinate; else uniform, a constant where the logs decide

    def value(self, coordinate):
        return np.exp(coordinate) if self.is_log else np.asarray(coordinate)

    def of(self, value):
        return np.log(value) if self.is_log else np.asarray(value)


@dataclass
class Evidence:
    """What the logs of one robot say: arrays of d coordinates."""

    lam: np.ndarray  # (d x d), positive semi-definite
    eta: np.ndarray  # (d)


def coordinate_of(parameter: dict) -> Coordinate:
    """From a parameter of identify's JSON."""
    prior, stated = parameter["prior"], parameter["prior"]["stated"]
    kind, unit = stated["kind"], parameter.get("unit") or ""
    if kind == "log_normal":
        return Coordinate(parameter["name"], unit, True, float(np.log(stated["a"])), stated["b"], True)
    if kind == "normal":
        return Coordinate(parameter["name"], unit, False, stated["a"], stated["b"], True)
    return Coordinate(parameter["name"], unit, False, prior["mean"], prior["sd"], False)


def coordinates_of(result: dict) -> list[Coordinate]:
    return [coordinate_of(p) for p in result["parameters"] if not p["fixed"]]


def evidence_of(samples: np.ndarray, coordinates: list[Coordinate]) -> Evidence:
    """From equally weighted draws of a posterior (n x d), in parameters."""
    draws = np.column_stack([c.of(samples[:, k]) for k, c in enumerate(coordinates)])
    mean, covariance = draws.mean(axis=0), np.atleast_2d(np.cov(draws, rowvar=False))
    if not np.all(np.isfinite(covariance)) or np.any(np.diag(covariance) <= 0):
        raise FleetError("a learnt parameter does not vary over its posterior; give each fit more --particles")
    return divide_prior(mean, covariance, coordinates)


def divide_prior(mean: np.ndarray, covariance: np.ndarray, coordinates: list[Coordinate]) -> Evidence:
    """A posterior's precision minus its prior's; what is negative there, by chance, becomes no information."""
    sd = np.array([c.prior_sd for c in coordinates])
    scaled = np.linalg.inv(covariance / np.outer(sd, sd))  # in units of the prior's deviations
    own = np.diag([1.0 if c.gaussian else 0.0 for c in coordinates])
    centre = np.array([c.prior_mean for c in coordinates]) / sd
    strength, directions = np.linalg.eigh(scaled - own)
    kept = directions[:, strength > 1e-3]
    lam = kept @ np.diag(strength[strength > 1e-3]) @ kept.T
    eta = kept @ (kept.T @ (scaled @ (mean / sd) - own @ centre))
    return Evidence(lam / np.outer(sd, sd), eta / sd)


def together(parts: list[Evidence]) -> Evidence:
    """Several logs of one robot: precisions add."""
    return Evidence(sum(p.lam for p in parts), sum(p.eta for p in parts))


def disagreement(parts: list[Evidence]) -> tuple[float, int]:
    """How far the logs of one robot lie apart: a chi-square statistic and its degrees of freedom."""
    if len(parts) < 2:
        return 0.0, 0
    whole = together(parts)
    ranks = [int(np.linalg.matrix_rank(p.lam)) for p in parts]
    statistic = sum(p.eta @ np.linalg.pinv(p.lam) @ p.eta for p in parts)
    statistic -= whole.eta @ np.linalg.pinv(whole.lam) @ whole.eta
    return max(0.0, float(statistic)), sum(ranks) - int(np.linalg.matrix_rank(whole.lam))
