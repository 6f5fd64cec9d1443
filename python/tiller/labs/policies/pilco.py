"""PILCO: gradients of the expected cost on the process (Deisenroth and Rasmussen, ICML 2011)."""
from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from .feedback import Feedback, make_feedback
from .forecast import long_term_cost
from .minimise import Numbers, minimise
from .moments import Bumps, Normal
from .search import SearchOptions, SearchResult, SearchStep, Try, fresh_policy, search_policy
from .task import Task

RESTART_ABOVE = 0.7  # of the horizon's cost
DRAWN = 10  # fresh policies that are only judged for each one that is searched from


class Improver:
    """Makes a policy better on the dynamics learnt so far. A search from the policy before can stay in the valley that
    it is in; as long as most of the cost is expected, fresh policies are searched beside it."""

    def __init__(self, task: Task, o: SearchOptions) -> None:
        self._task, self._o = task, o
        unravel = ravel_pytree(fresh_policy(task, o, 0))[1]
        self._unravel: Callable[[Numbers], Feedback] = unravel
        cost = lambda p, process: long_term_cost(task, process, unravel(p))
        self._cost, self._with_slope = jax.jit(cost), jax.jit(jax.value_and_grad(cost))

    def _search(self, process: Bumps, p: Numbers, evaluations: int, decrease: float) -> tuple[Numbers, float]:
        def one(p: Numbers) -> tuple[float, Numbers]:
            value, slope = self._with_slope(p, process)
            return float(value), np.asarray(slope)
        return minimise(one, p, evaluations, decrease)

    def __call__(self, process: Bumps, policy: Feedback, trial: int) -> Feedback:
        o, p = self._o, np.asarray(ravel_pytree(policy)[0])
        best, least = self._search(process, p, o.evaluations, 1e-4)
        if not least < RESTART_ABOVE * self._task.horizon:
            for r in range(o.restarts):
                found, cost = self._search(process, self._fresh(process, trial, r), max(1, o.evaluations // 2), 1e-3)
                if cost < least:
                    best, least = found, cost
        return self._unravel(best)

    def _fresh(self, process: Bumps, trial: int, restart: int) -> Numbers:
        """The best of some policies whose points lie where the process has data, with targets from a hundredth to all
        of the range: what swings and what holds are both among them."""
        task, o = self._task, self._o
        seen = np.asarray(process.x)[np.asarray(process.beta).any(0), :len(task.seen)]
        where = Normal(seen.mean(0), np.atleast_2d(np.cov(seen.T)))
        drawn = [np.asarray(ravel_pytree(make_feedback(task, o.kind, o.bumps, where, 10 ** (-2 * d / DRAWN),
                                                       [o.seed, 91, trial, restart, d]))[0]) for d in range(DRAWN)]
        costs = np.array([float(self._cost(p, process)) for p in drawn])
        return drawn[int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))]


def pilco(task: Task, run: Try, o: SearchOptions, after: Callable[[SearchStep, int], None],
          result: SearchResult) -> None:
    search_policy(task, run, o, Improver(task, o), after, result)
