"""A start's laws: what they were seen to do, and laws of less cost near what came before."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .guide import Goal
from .laws import Law, Quadratic, expected_cost, kl_lqr, passage
from .local import Data, LinearStep, fit_mixture, fit_step, prior_of_mixture, prior_of_model
from .minimise import Numbers
from .plant import Trial
from .task import Task

WORSE = 1.1  # times the best laws' cost: more than the chance of five runs

Expand = Callable[[Numbers], tuple[Any, Any]]  # states and commands (n, nx + nu) -> next states and slopes
Answer = Callable[[Numbers], Numbers]  # states (n, nx) -> the network's commands (n, nu)


class Local:
    """A condition's laws and what they were last seen to do."""

    def __init__(self, first: Numbers, epsilon: float) -> None:
        self.first, self.epsilon = first, epsilon
        self.trials: list[Trial] = []
        self.cost = self.planned = np.inf
        self.laws: list[Law] = []
        self.models: list[LinearStep] = []
        self.best: tuple[float, list[Law], list[LinearStep]] = (np.inf, [], [])  # by what the plant did
        self.tried = False  # the trials are of laws near these

    def goes_back(self) -> bool:
        """To the best laws so far, where the plant does not do under these what the models promised."""
        worse = self.cost > WORSE * self.best[0]
        if worse:
            (self.cost, self.laws, self.models), self.tried = self.best, False
        return bool(worse)

    def transitions(self, k: int) -> Numbers:
        return np.array([np.concatenate([t.measured[k], t.command[k], t.measured[k + 1]]) for t in self.trials])

    def start(self) -> tuple[Numbers, Numbers]:
        first = self.measured(0)
        return first.mean(0), np.cov(first.T).reshape(first.shape[1], -1) + 1e-4 * np.eye(first.shape[1])

    def measured(self, k: int) -> Numbers:
        return np.array([t.measured[k] for t in self.trials])


class Improver:
    def __init__(self, task: Task, goal: Goal, measured: Numbers, strength: float, seed: int) -> None:
        self._task, self._goal, self._measured, self._strength, self._seed = task, goal, measured, strength, seed
        self._costs = [self._quadratic(k == task.horizon) for k in range(task.horizon + 1)]

    def _quadratic(self, last: bool) -> Quadratic:
        goal, nu = self._goal, 0 if last else self._task.nu
        weight = goal.terminal if last else goal.state
        return Quadratic(np.diag(np.concatenate([weight, goal.control[:nu]])),
                         np.concatenate([-weight * goal.target, np.zeros(nu)]))

    def _fit(self, local: Local, expand: Expand) -> list[LinearStep]:
        task, models = self._task, []
        data = [Data.of(local.transitions(k)) for k in range(task.horizon)]
        nz = task.nx + task.nu
        after, slopes = map(np.asarray, expand(np.array([d.mean[:nz] for d in data])))
        for d, next_state, slope in zip(data, after, slopes, strict=True):
            spread = np.diag(np.diag(d.covariance)[:nz] + 1e-6)
            prior = prior_of_model(d.mean[:nz], next_state, slope, spread, self._measured,
                                   1e-4 * np.diag(spread)[:task.nx], self._strength)
            models.append(fit_step(d, prior, task.nx, 1e-9))
        return models

    def policy_about(self, local: Local, answer: Answer, noise: Numbers) -> list[Law]:
        """The network near the samples: the regression of its commands on their states, with a mixture over all periods
        as its prior (Montgomery and Levine 2016, section 4.1). Its slope at a point is no gain."""
        task = self._task
        rows = [np.hstack([x, answer(x)]) for x in map(local.measured, range(task.horizon))]
        mixture = fit_mixture(np.concatenate(rows), 2 * task.horizon // 5 + 1, 10, self._seed)
        laws = []
        for r in rows:
            prior = prior_of_mixture(mixture, r, float(task.nx + 2), 1.0)
            law = fit_step(Data.of(r), prior, task.nu, 1e-8)
            # no gain makes more of the samples' spread than the whole range
            most = (task.high - task.low) / np.maximum(1e-12, np.abs(law.slope) @ r[:, :task.nx].std(0))
            gain = law.slope * np.minimum(1, most)[:, None]
            mean = r.mean(0)
            laws.append(Law(gain, mean[task.nx:] - gain @ mean[:task.nx], noise))
        return laws

    def _limited(self, before: list[Law], local: Local) -> list[Quadratic]:
        """The costs, and a price of what lies beyond the limits, where the law before goes there."""
        task, costs = self._task, list(self._costs)
        for k, law in enumerate(before):
            u = law.slope @ local.measured(k).mean(0) + law.offset
            beyond = (u < task.low) | (u > task.high)
            if beyond.any():
                price = np.concatenate([np.zeros(task.nx), np.where(beyond, 100 * self._goal.control, 0.0)])
                edge = np.concatenate([np.zeros(task.nx), np.clip(u, task.low, task.high)])
                costs[k] = Quadratic(costs[k].hessian + np.diag(price), costs[k].slope - price * edge)
        return costs

    def __call__(self, local: Local, expand: Expand, network: Callable[[], list[Law]] | None) -> tuple[float, bool]:
        """Laws of less cost near the network's; where those would cost more than the laws before, near these; where
        none are found, these stay. Their divergence from what they are near, nats a period, and whether that is not
        the network."""
        if local.goes_back():
            return 0.0, False
        task, local.models = self._task, self._fit(local, expand)
        if local.cost <= local.best[0]:
            local.best = local.cost, local.laws, local.models
        start = local.start()
        # with what the quadratic costs leave out, so that a share of it means something
        whole = 0.5 * self._goal.target**2 @ (task.horizon * self._goal.state + self._goal.terminal)
        most = 1.1 * (whole + expected_cost(self._costs, passage(local.models, local.laws, *start)))
        near = [network()] if network else []
        for before in [*near, local.laws]:
            found = kl_lqr(local.models, self._limited(before, local), before, *start, local.epsilon * task.horizon)
            if found is not None and whole + expected_cost(
                    self._costs, passage(local.models, found.laws, *start)) < most:
                apart = bool(near) and before is local.laws
                local.laws = found.laws
                return found.divergence / task.horizon, apart
        return 0.0, bool(near)
