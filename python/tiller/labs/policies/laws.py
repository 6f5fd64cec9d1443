"""Linear laws of least cost within a divergence of laws before them."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .local import LinearStep
from .minimise import Numbers

Law = LinearStep  # u = slope x + offset + noise, for one period


class Quadratic(NamedTuple):
    """1/2 z' hessian z + slope' z of a period, z = [x; u]; of the last state, without u."""
    hessian: Numbers
    slope: Numbers


class Passage(NamedTuple):
    """Mean and covariance of [x; u] in each period, and of the last x."""
    mean: list[Numbers]
    covariance: list[Numbers]


def passage(models: list[LinearStep], laws: list[Law], mean: Numbers, covariance: Numbers) -> Passage:
    """What the laws make of the models from a normal start."""
    out = Passage([], [])
    for model, law in zip(models, laws, strict=True):
        across = covariance @ law.slope.T
        z = np.concatenate([mean, law.slope @ mean + law.offset])
        s = np.block([[covariance, across], [across.T, law.slope @ across + law.noise]])
        out.mean.append(z)
        out.covariance.append(s)
        mean = model.slope @ z + model.offset
        covariance = model.slope @ s @ model.slope.T + model.noise
    out.mean.append(mean)
    out.covariance.append(covariance)
    return out


def expected_cost(costs: list[Quadratic], way: Passage) -> float:
    """Up to the costs' constants."""
    return float(sum(0.5 * m @ c.hessian @ m + c.slope @ m + 0.5 * (c.hessian * s).sum()
                     for c, m, s in zip(costs, *way, strict=True)))


def divergence(now: list[Law], before: list[Law], way: Passage) -> float:
    """Sum over the periods of E_x KL(now(u | x) || before(u | x)), `way` being that of `now`."""
    total = 0.0
    for a, b, mean, covariance in zip(now, before, way.mean, way.covariance, strict=False):
        nx, gain = a.slope.shape[1], a.slope - b.slope
        away = gain @ mean[:nx] + a.offset - b.offset
        second = np.outer(away, away) + gain @ covariance[:nx, :nx] @ gain.T
        total += 0.5 * (np.trace(np.linalg.solve(b.noise, a.noise + second)) - len(away)
                        + np.linalg.slogdet(b.noise)[1] - np.linalg.slogdet(a.noise)[1])
    return float(total)


def soft_lqr(models: list[LinearStep], costs: list[Quadratic], before: list[Law], eta: float) -> list[Law] | None:
    """The laws of least E[cost] / eta - entropy + E[-log before(u | x)]: an LQR whose noise is the inverse of its
    curvature in u (maximum entropy: Levine and Abbeel 2014, section 3). `costs` has a row more than `models`. None
    where a curvature is not positive definite: raise eta."""
    value, slope, laws = costs[-1].hessian / eta, costs[-1].slope / eta, []
    for model, cost, old in zip(reversed(models), reversed(costs[:-1]), reversed(before), strict=True):
        nx, nu = len(model.offset), len(old.offset)
        rows = np.hstack([-old.slope, np.eye(nu)])
        precise = np.linalg.solve(old.noise, rows)
        q = cost.hessian / eta + rows.T @ precise + model.slope.T @ value @ model.slope
        g = cost.slope / eta - precise.T @ old.offset + model.slope.T @ (value @ model.offset + slope)
        bend = q[nx:, nx:]
        if not np.isfinite(q).all() or np.linalg.eigvalsh(bend)[0] <= 0:
            return None
        inverse = np.linalg.inv(bend)
        law = Law(-inverse @ q[nx:, :nx], -inverse @ g[nx:], 0.5 * (inverse + inverse.T))
        laws.append(law)
        value = q[:nx, :nx] + q[:nx, nx:] @ law.slope
        value, slope = 0.5 * (value + value.T), g[:nx] + q[:nx, nx:] @ law.offset
    return laws[::-1]


class Found(NamedTuple):
    laws: list[Law]
    eta: float  # dual variable
    divergence: float
    cost: float


def kl_lqr(models: list[LinearStep], costs: list[Quadratic], before: list[Law], mean: Numbers, covariance: Numbers,
           epsilon: float) -> Found | None:
    """The laws of least expected cost within a divergence of `epsilon`, over all periods, from `before`: eta by
    bracketing, as the divergence falls with it. None where no eta up to 1e12 serves."""
    low, high, found = 1e-6, 1e12, None
    while high / low > 1.02:
        eta = np.sqrt(low * high)
        laws = soft_lqr(models, costs, before, eta)
        way = passage(models, laws, mean, covariance) if laws else None
        kl = divergence(laws, before, way) if laws and way else np.inf
        if not kl <= epsilon:
            low = eta
            continue
        high = eta
        assert laws and way
        found = Found(laws, float(eta), kl, expected_cost(costs, way))
    return found
