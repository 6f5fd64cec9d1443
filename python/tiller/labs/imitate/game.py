"""The game of apprenticeship: a demonstrator's feature expectations against those of a planner's policies.

    min over mixtures of policies   max over w in a set   w' (mu_policy - mu_demonstrator)
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linprog

from .problem import Numbers

Best = Callable[[Numbers], Numbers]  # features (d) of a policy that makes w' mu least


@dataclass
class Equilibrium:
    value: float = 0.0       # of the mixture: the largest w' (mu - demonstrated)
    bound: float = -np.inf   # what no mixture is below
    weight: Numbers = field(default_factory=lambda: np.zeros(0))
    policies: list[Numbers] = field(default_factory=list)
    share: Numbers = field(default_factory=lambda: np.zeros(0))

    @property
    def mixture(self) -> Numbers:
        return np.asarray(self.share @ np.array(self.policies))


def multiplicative_weights(demonstrated: Numbers, best: Best, scale: Numbers, rounds: int) -> Equilibrium:
    """Over the simplex (Syed and Schapire, NIPS 2007), features over `scale`; value within sqrt(2 log d / rounds)."""
    d, e = len(demonstrated), Equilibrium()
    level, total = np.zeros(d), np.zeros(d)
    rate = np.sqrt(2 * np.log(d + 1e-9) / rounds)
    for _ in range(rounds):
        w = np.exp(level - level.max())
        w /= w.sum()
        e.policies.append(best(w / scale))
        excess = (e.policies[-1] - demonstrated) / scale
        e.bound = max(e.bound, float(w @ excess))
        total += w
        level += rate * np.clip(excess, -1, 1)
    e.share = np.full(rounds, 1 / rounds)
    e.value = float(((e.mixture - demonstrated) / scale).max())
    e.weight = total / rounds / scale
    return e


def projection(demonstrated: Numbers, best: Best, tolerance: float, rounds: int) -> Equilibrium:
    """Over the Euclidean ball (Abbeel and Ng, ICML 2004). Ends where a round gains less than `tolerance`."""
    e = Equilibrium(bound=0.0, policies=[best(np.ones(len(demonstrated)))], share=np.ones(1))
    nearest = e.policies[0]
    for _ in range(rounds):
        w = nearest - demonstrated
        e.value = float(np.linalg.norm(w))
        if e.value < tolerance:
            break
        e.weight = w / np.linalg.norm(w)
        mu = best(e.weight)
        e.bound = max(e.bound, float(e.weight @ (mu - demonstrated)))
        if e.value - e.bound < tolerance:
            break
        step = mu - nearest
        along = float(np.clip(-float(step @ w) / max(float(step @ step), 1e-300), 0, 1))
        e.policies.append(mu)
        e.share = np.append(e.share * (1 - along), along)
        nearest = nearest + along * step
    e.value = float(np.linalg.norm(nearest - demonstrated))
    return e


def _solve_box(demonstrated: Numbers, e: Equilibrium) -> None:
    """Shares and the box's answer for the policies so far: sum share mu - above + below = demonstrated."""
    d, m = len(demonstrated), len(e.policies)
    rows = np.hstack([np.array(e.policies).T, -np.eye(d), np.eye(d)])
    rows = np.vstack([rows, np.concatenate([np.ones(m), np.zeros(2 * d)])])
    done = linprog(np.concatenate([np.zeros(m), np.full(2 * d, 0.5)]), A_eq=rows, b_eq=np.append(demonstrated, 1.0),
                   method="highs")
    e.share, e.value, e.weight = done.x[:m], float(done.fun), -done.eqlin.marginals[:d]


def total_variation(demonstrated: Numbers, best: Best, tolerance: float = 1e-9, rounds: int = 100) -> Equilibrium:
    """Over the box abs(w) <= 1/2: half the L1 distance, of occupancies the total variation. Each side answers the
    other's best mixture until neither gains more than `tolerance`; mixtures by linear programs."""
    e = Equilibrium(policies=[best(np.zeros(len(demonstrated)))])
    for _ in range(rounds):
        _solve_box(demonstrated, e)
        mu = best(e.weight)
        e.bound = max(e.bound, float(e.weight @ (mu - demonstrated)))
        if e.value - e.bound <= tolerance:
            break
        e.policies.append(mu)
    return e
