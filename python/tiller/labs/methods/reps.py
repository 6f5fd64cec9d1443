"""Weights of draws from the prior by relative entropy (Peters, Muelling, Altun, AAAI 2010)."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ..problem import Array, InferenceError, Problem
from ..result import Inferred
from .logs import Logs
from .settings import Settings


class Weights(NamedTuple):
    weight: Array  # (n) sums to one; 0 where the cost is not finite
    temperature: float  # eta; 0: the bound is slack, and the cheapest share all the weight
    kl: float  # KL(weights || equal ones)


def _tilted(cost: Array, eta: float) -> tuple[Array, float]:
    """Weights ~ exp(-cost / eta) of finite costs whose least is 0, and their divergence from equal ones."""
    exponent = -cost / eta if eta > 0 else np.where(cost > 0, -np.inf, 0.0)
    weight = np.exp(exponent)
    total = weight.sum()
    weight /= total
    return weight, float(weight @ np.where(weight > 0, exponent, 0.0) - np.log(total / len(cost)))


def _root(cost: Array, bound: float) -> float:
    """eta at which the divergence is `bound`: the dual's minimum, since g'(eta) = bound - KL(eta) and g is convex. KL
    <= (range / eta)^2 / 8 (Hoeffding's lemma) gives an eta that is large enough."""
    high = cost.max() / np.sqrt(8 * bound)
    low = 0.5 * high
    while _tilted(cost, low)[1] < bound and low > np.finfo(float).tiny:
        low *= 0.5
    if low <= np.finfo(float).tiny:  # ties up to rounding
        return 0.0
    root = brentq(lambda log_eta: _tilted(cost, np.exp(log_eta))[1] - bound, np.log(low), np.log(high), xtol=1e-13)
    return float(np.exp(root))


def bounded_weights(cost: Array, bound: float) -> Weights:
    """The weights w (n) of least sum w_i c_i under KL(w || equal) = sum w_i log(n w_i) <= bound. A cost that is not
    finite does not count in n. Raises InferenceError where none is finite. Cost: some 50 n."""
    good = np.isfinite(cost)
    if not good.any():
        raise InferenceError("no simulation stayed finite; narrow the priors, or raise substeps")
    own = cost[good] - cost[good].min()
    slack = bound >= np.log(len(own) / np.count_nonzero(own == 0))
    eta = 0.0 if slack else _root(own, bound)
    weight = np.zeros(len(cost))
    weight[good], kl = _tilted(own, eta)
    return Weights(weight, eta, kl)


def tempered_weights(reward: Array, eta: float, base: Array | None = None) -> Weights:
    """w_i ~ base_i exp(reward_i / eta) of draws that stand for shares `base` (None: equal ones) of the prior. With a
    log likelihood as the reward this is Bayes' rule at eta = 1; else the likelihood to the power 1 / eta."""
    share = np.where(np.isfinite(reward), 1.0 if base is None else base, 0.0)
    if not share.any():
        raise InferenceError("no simulation stayed finite; narrow the priors, or raise substeps")
    good = share > 0
    weight = np.zeros(len(reward))
    with np.errstate(over="ignore"):
        weight[good] = share[good] * np.exp((reward[good] - reward[good].max()) / eta)
    weight /= weight.sum()
    held = weight > 0
    return Weights(weight, eta, float(weight[held] @ np.log(weight[held] * share.sum() / share[held])))


def log_likelihood(logs: Logs, params: Array) -> Array:
    """Of candidates (n, np): sum over rows and states of -1/2 (e^2 / V + log(2 pi V)), V by Logs.variance(); -infinity
    where a rollout was not finite. The readings' noise counts as independent from one period to the next."""
    precision = np.where(logs.known, 1 / logs.variance(), 0.0)
    constant = 0.5 * np.log(precision[precision > 0] / (2 * np.pi)).sum()

    def value(states: Array) -> Array:
        error = np.where(logs.known[..., None], logs.errors(states), 0.0)
        return np.asarray(constant - 0.5 * np.einsum("tx,txn,txn->n", precision, error, error))

    found = logs.evaluated(params, value)
    return np.where(np.isfinite(found), found, -np.inf)


def fit(problem: Problem, logs: Logs, settings: Settings) -> Inferred:
    result = settings.result(problem)
    v = problem.draw(np.random.default_rng([problem.seed, 1]), settings.simulations)
    reward = log_likelihood(logs, problem.to_params(v))
    settings.count(result, reward)
    weights = (tempered_weights(reward, settings.eta) if np.isfinite(settings.eta)
               else bounded_weights(-reward, settings.kl))
    result.v, result.weight = v, weights.weight
    settings.add_round(result, v, weights, -reward)
    return result
