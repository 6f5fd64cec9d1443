"""Who does not belong to the fleet, with a chance of false alarms that is kept over all robots.

Three questions of each robot: do its parameters come from the population, is its noise that of the others, do its own
logs agree? Each answer is a tail probability under "nothing is odd". A robot is named where one of them is below
alpha over the number of questions asked (Bonferroni): with chance 1 - alpha no sound robot of the whole fleet is named.
A share of false names (Benjamini and Hochberg) would be the other choice; a name here sends someone to a robot, and
with few odd ones among many a share promises nothing about any of them.
"""

from __future__ import annotations

import numpy as np

from . import hierarchy
from .chance import chi_square_tail, normal_tail
from .hierarchy import Fleet

ONE_BY_ONE = 100  # robots up to which each is tested by a fit without it: there, it would hide itself


def distances(fleet: Fleet, mu: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Squared distance of each robot from the population, in units of what both leave: chi-square of rank(lam)."""
    v, w = hierarchy.marginal(fleet, covariance)
    # (y - mu)' v (y - mu) with v y = w, written without y, which does not exist where lam is singular
    seen = np.linalg.pinv(v, hermitian=True)
    apart = w - np.einsum("nij,j->ni", v, mu)
    return np.maximum(np.einsum("ni,nij,nj->n", apart, seen, apart), 0.0)


def ranks(fleet: Fleet) -> np.ndarray:
    """(n) directions of which each robot's logs say something."""
    return np.linalg.matrix_rank(fleet.lam, hermitian=True)


def _tails(distance: np.ndarray, rank: np.ndarray) -> np.ndarray:
    out = np.ones(len(distance))
    for degrees in np.unique(rank[rank > 0]):
        at = rank == degrees
        out[at] = chi_square_tail(distance[at], int(degrees))
    return out


def _tails_given(fleet: Fleet, rank: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Tail probability of each robot under the most likely population of the robots in `keep`, of itself without it."""
    mu, covariance = hierarchy.expectation_maximisation(fleet.part(keep))
    tails = _tails(distances(fleet, mu, covariance), rank)
    if keep.sum() > ONE_BY_ONE:
        return tails
    for i in np.flatnonzero(keep):
        others = keep.copy()
        others[i] = False
        if others.sum() < 2:
            continue
        own = hierarchy.expectation_maximisation(fleet.part(others), 50, covariance)
        tails[i] = _tails(distances(fleet.part(np.array([i])), *own), rank[i:i + 1])[0]
    return tails


def suspects(fleet: Fleet, level: float) -> np.ndarray:
    """Robots below `level` under the most likely population of those that are not: found again and again, because one
    that is far off widens the population and hides the next."""
    rank, keep = ranks(fleet), np.ones(fleet.size, dtype=bool)
    for _ in range(20):
        tails = _tails_given(fleet, rank, keep)
        new = tails >= level
        if new.sum() < max(3, fleet.size // 2) or np.array_equal(new, keep):
            break
        keep = new
    return ~keep


def predictive_tails(fleet: Fleet, which: np.ndarray, draws: hierarchy.Draws) -> np.ndarray:
    """Tail probabilities of robots that the draws know nothing of: averaged over what the population may be."""
    part, rank = fleet.part(which), ranks(fleet.part(which))
    mean, covariance = draws.flat("mean"), draws.flat("covariance")
    total = np.zeros(part.size)
    step = max(1, len(mean) // 400)
    for mu, t in zip(mean[::step], covariance[::step]):
        total += _tails(distances(part, mu, t), rank)
    return total / len(mean[::step])


def judge(fleet: Fleet, others: list[np.ndarray], level: float, seed: int, **sampling):
    """(draws of the population, tail probabilities (n) of the robots' parameters, who was left out of the population).

    `others` are the tails of the other questions: who is odd by them is left out too. A suspect that the population of
    the others could have made after all goes back, and the population is drawn anew.
    """
    strange = np.any([tails < level for tails in others], axis=0) if others else np.zeros(fleet.size, dtype=bool)
    out, rank = suspects(fleet, level) | strange, ranks(fleet)
    for _ in range(3):
        draws = hierarchy.sample(fleet.part(~out), seed, **sampling)
        tails = predictive_tails(fleet, np.arange(fleet.size), draws)
        tails[rank == 0] = 1.0
        back = out & (tails >= level) & ~strange
        if not back.any():
            break
        out &= ~back
    return draws, tails, out


def outliers(values: np.ndarray) -> np.ndarray:
    """Tail probabilities of numbers that are alike but for a few: distance from the median in robust deviations."""
    known = np.isfinite(values)
    tails = np.ones(len(values))
    if known.sum() < 8:
        return tails
    middle = np.median(values[known])
    deviation = np.median(np.abs(values[known] - middle)) / 0.6744897501960817
    if deviation > 0:
        tails[known] = [normal_tail((v - middle) / deviation) for v in values[known]]
    return tails
