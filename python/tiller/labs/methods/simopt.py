"""SimOpt (Chebotar et al., ICRA 2019): a normal over the coordinates, refitted to candidates of it again and again,
each time within a bound of the divergence."""
from __future__ import annotations

import numpy as np

from ..mixture import Mixture
from ..problem import Array, InferenceError, Problem
from ..result import Inferred
from .discrepancy import Discrepancy, Residual, SlicedWasserstein
from .logs import Logs
from .reps import bounded_weights
from .settings import Settings

DRAWS = 1024  # of the last normal
LEAST_SHARE = 1e-6  # of the prior's deviation: a normal that has shrunk to a point can still be drawn from


def normal_of_prior(problem: Problem) -> Mixture:
    """Means and variances of the marginals; of a joint prior the moments of its mixture, uncut, which is the normal
    itself where it is one."""
    if problem.mixture is None:
        laws = [p.law() for p in problem.learnt]
        mean, covariance = np.array([law.mean() for law in laws]), np.diag([law.var() for law in laws])
    else:
        share = problem.mixture.weight / problem.mixture.weight.sum()
        mean = share @ problem.mixture.mean
        off = problem.mixture.mean - mean
        covariance = np.einsum("k,kij->ij", share, problem.mixture.covariance) + off.T @ (share[:, None] * off)
    return Mixture(np.ones(1), mean[None], covariance[None]).cut(problem.low, problem.high)


def refitted(normal: Mixture, v: Array, weight: Array, least_sd: Array) -> Mixture:
    """The weighted moments of v (n, d), the maximum-likelihood refit."""
    mean = weight @ v
    off = v - mean
    covariance = off.T @ (weight[:, None] * off)
    covariance = 0.5 * (covariance + covariance.T) + np.diag(least_sd**2)
    return Mixture(np.ones(1), mean[None], covariance[None], normal.low, normal.high)


def discrepancy_of(logs: Logs, settings: Settings, one_step: bool) -> Discrepancy:
    """Squared residuals of single periods as they are, or the paper's norms, filter and weights along rollouts."""
    is_wasserstein = settings.discrepancy == "wasserstein"
    scale = (is_wasserstein or not one_step) if settings.scale is None else settings.scale
    if is_wasserstein:
        return SlicedWasserstein(logs, scale)
    weight_l1 = (0.0 if one_step else 1.0) if np.isnan(settings.weight_l1) else settings.weight_l1
    weight_l2 = 1.0 if np.isnan(settings.weight_l2) else settings.weight_l2
    if not weight_l1 > 0 and not weight_l2 > 0:
        raise InferenceError("--l1 0, --l2 0: nothing is compared; give one of the two a weight above 0")
    return Residual(logs, weight_l1, weight_l2, scale, 0.0 if one_step else settings.smoothing_steps)


def _fit(problem: Problem, logs: Logs, settings: Settings, one_step: bool) -> Inferred:
    result, normal = settings.result(problem), normal_of_prior(problem)
    discrepancy, rng = discrepancy_of(logs, settings, one_step), np.random.default_rng([problem.seed, 1])
    least_sd = LEAST_SHARE * np.sqrt(np.diag(normal.covariance[0]))
    for _ in range(settings.iterations):
        v = normal.draw(rng, settings.simulations // settings.iterations)
        cost = logs.evaluated(problem.to_params(v), discrepancy)
        settings.count(result, cost)
        weights = bounded_weights(cost, settings.kl)
        normal = refitted(normal, v, weights.weight, least_sd)
        settings.add_round(result, v, weights, cost)
    result.v, result.weight = normal.draw(rng, DRAWS), np.full(DRAWS, 1 / DRAWS)
    result.normal = normal
    return result


def one_step(problem: Problem, logs: Logs, settings: Settings) -> Inferred:
    return _fit(problem, logs, settings, one_step=True)


def trajectory(problem: Problem, logs: Logs, settings: Settings) -> Inferred:
    return _fit(problem, logs, settings, one_step=False)
