"""Approximate Bayesian computation on a black box: rejection (Pritchard et al. 1999), its correction by local-linear
regression (Beaumont, Zhang, Balding 2002), and a population whose tolerance falls (Toni et al. 2009; Beaumont et al.
2009)."""
from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from .options import Options
from .problem import Array, InferenceError, Problem, Simulations
from .result import Inferred, normalised
from .summary import make_summary

HELD_OUT = 100  # draws near the logs that stand in for them


class Distances:
    """Summaries of draws less the logs', in units of the noise or of the draws' median absolute deviations."""

    def __init__(self, name: str, problem: Problem, v: Array, y: Array) -> None:
        self.summary = make_summary(name, problem)
        learnt = self.summary.learn(v, y)
        self.observed = self.summary.of(problem.measured[None])[0]
        scale = np.median(np.abs(learnt - np.median(learnt, axis=0)), axis=0)
        self.scale = np.where(scale > 0, scale, 1.0) if not self.summary.is_scaled else np.ones(len(self.observed))
        self.off = (learnt - self.observed) / self.scale

    def of(self, y: Array) -> Array:
        return length((self.summary.of(y) - self.observed) / self.scale)


def length(off: Array) -> Array:
    """Root mean square."""
    return np.sqrt((off**2).mean(axis=-1))


def adjusted(problem: Problem, v: Array, off: Array, weight: Array) -> Array:
    """v less what a linear regression on `off` says of it; within the bounds, because on a line that has none."""
    low, high = problem.low, problem.high
    below, above = np.isfinite(low), np.isfinite(high)
    with np.errstate(divide="ignore", invalid="ignore"):
        up, down = np.log(np.maximum(v - low, 1e-300)), np.log(np.maximum(high - v, 1e-300))
        line = np.where(below & above, up - down, np.where(below, up, np.where(above, -down, v)))
    design, root = np.column_stack([np.ones(len(v)), off]), np.sqrt(weight)[:, None]
    line = line - off @ np.linalg.lstsq(root * design, root * line, rcond=None)[0][1:]
    with np.errstate(over="ignore", invalid="ignore"):
        between = low + (high - low) / (1 + np.exp(-line))
        return np.where(below & above, between, np.where(below, low + np.exp(line),
                                                         np.where(above, high - np.exp(-line), line)))


def epanechnikov(distance: Array) -> Array:
    return np.asarray(1.0 - (distance / (1.0001 * distance.max())) ** 2)


def _ranks(problem: Problem, v: Array, off: Array, nearest: np.ndarray, regress: bool) -> Array:
    """Each of the draws nearest to the logs in their place: its rank in the posterior that the others give (Prangle,
    Blum, Popovic, Sisson, Aust. N. Z. J. Stat. 2014). Ranks are uniform where the tolerance does no harm."""
    ranks = []
    for k in nearest[:HELD_OUT]:
        distance = length(off - off[k])
        distance[k] = np.inf
        near = np.argsort(distance, kind="stable")[:len(nearest)]
        weight = epanechnikov(distance[near]) if regress else np.ones(len(near))
        rows = adjusted(problem, v[near], off[near] - off[k], weight) if regress else v[near]
        ranks.append(normalised(weight) @ (rows < v[k]))
    return np.array(ranks)


def _nearest(o: Options, distance: Array, least: int) -> np.ndarray:
    """Which are kept, nearest first."""
    order = np.argsort(distance, kind="stable")
    by_share = bool(np.isnan(o.epsilon))
    kept = min(round(o.accept * o.simulations), len(order)) if by_share else int((distance <= o.epsilon).sum())
    if kept >= least:
        return order[:kept]
    near, hundredth = distance[order[0]], distance[order[len(order) // 100]]
    remedy = "raise --simulations or --accept" if by_share else (
        f"the nearest lies at {near:.3g}, one in a hundred within {hundredth:.3g}: raise --epsilon or --simulations")
    raise InferenceError(f"{kept} draws would be kept, and {least} are needed; {remedy}")


def rejection(problem: Problem, o: Options, simulations: Simulations, regress: bool = False) -> Inferred:
    """The draws from the prior that come nearest: a share `accept` of them, or those within `epsilon`."""
    result = Inferred(problem, o)
    v, y = simulations.run(problem.draw(np.random.default_rng([problem.seed, 1]), o.simulations))
    distances = Distances(o.summary, problem, v, y)
    distance = length(distances.off)
    nearest = _nearest(o, distance, problem.dimension + 3)
    result.v, result.weight = v[nearest], np.ones(len(nearest))
    if regress:
        result.weight = epanechnikov(distance[nearest])
        result.v = adjusted(problem, result.v, distances.off[nearest], result.weight)
    result.add_round(result.v, result.weight, float(distance[nearest[-1]]), float(distance[nearest[0]]))
    result.weight = normalised(result.weight)
    result.ranks = _ranks(problem, v, distances.off, nearest, regress)
    return result


def regression(problem: Problem, o: Options, simulations: Simulations) -> Inferred:
    return rejection(problem, o, simulations, regress=True)


class _Kernel:
    """What moves a population: a normal of twice its covariance."""

    def __init__(self, v: Array, weight: Array) -> None:
        self.v, self.weight = v, normalised(weight)
        covariance = 2 * np.atleast_2d(np.cov(v.T, aweights=self.weight, ddof=0))
        self.root = np.linalg.cholesky(covariance + 1e-9 * np.diag(np.diag(covariance)))

    def draw(self, problem: Problem, rng: np.random.Generator, count: int) -> Array:
        """Within the prior."""
        v = np.empty((0, self.v.shape[1]))
        while len(v) < count:
            centre = self.v[rng.choice(len(self.v), count, p=self.weight)]
            tried = centre + rng.normal(size=centre.shape) @ self.root.T
            v = np.concatenate([v, tried[np.isfinite(problem.log_prior(tried))]])
        return v[:count]

    def log_density(self, v: Array) -> Array:
        """Up to a constant."""
        z = np.linalg.solve(self.root, (v[:, None] - self.v).reshape(-1, v.shape[1]).T).T
        squares = (z**2).sum(axis=1).reshape(len(v), -1)
        return np.asarray(logsumexp(-0.5 * squares, b=self.weight, axis=1))


def smc(problem: Problem, o: Options, simulations: Simulations) -> Inferred:
    """The tolerance of a round is the median of the population's distances; weights are prior over what it was drawn
    from. The summary is learnt anew from each round's simulations. A round that the simulations do not suffice for is
    left out."""
    result, rng, n = Inferred(problem, o), np.random.default_rng([problem.seed, 1]), o.particles
    v, y = simulations.run(problem.draw(rng, min(4 * n, o.simulations // 2)))
    distances = Distances(o.summary, problem, v, y)
    kept = np.argsort(length(distances.off), kind="stable")[:n]
    if len(kept) < problem.dimension + 3:
        raise InferenceError(f"{len(kept)} simulations did not fail, too few for {problem.dimension} parameters; raise "
                             "--simulations")
    v, off, weight, n = v[kept], distances.off[kept], np.ones(len(kept)), len(kept)
    epsilon = length(off).max()
    while True:
        result.add_round(v, weight, float(epsilon), float(length(off).min()))
        epsilon, kernel = np.median(length(off)), _Kernel(v, weight)
        all_v, all_y, within = [], [], np.empty(0, bool)
        while within.sum() < n and (count := min(n, o.simulations - simulations.total)) > 0:
            more_v, more_y = simulations.run(kernel.draw(problem, rng, count))
            all_v.append(more_v)
            all_y.append(more_y)
            within = np.concatenate([within, distances.of(more_y) <= epsilon])
        if within.sum() < n:
            break
        kept, drawn = np.flatnonzero(within)[:n], np.concatenate(all_v)
        distances = Distances(o.summary, problem, drawn, np.concatenate(all_y))
        v, off = drawn[kept], distances.off[kept]
        log_weight = problem.log_prior(v) - kernel.log_density(v)
        weight = normalised(np.exp(log_weight - log_weight.max()))
    weight = weight * epanechnikov(length(off))
    result.v, result.weight = adjusted(problem, v, off, weight), normalised(weight)
    return result
