"""Guided policy search by mirror descent: local laws that teach a network."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from .guide import Goal, best_motions
from .laws import Law, Quadratic, expected_cost, kl_lqr, passage
from .local import Data, LinearStep, fit_mixture, fit_step, prior_of_mixture, prior_of_model
from .minimise import Numbers
from .physics import Physics
from .plant import RunTrial, Trial
from .student import Student
from .task import Task

ROOM = 0.8  # share of the limits' range that first motions use
WORSE = 1.1  # times the best laws' cost: more than the chance of five runs
LOST = 1.2  # times what a motion was to cost: the plant does not follow it
MOST_ROWS = 400  # transitions that the model is fitted to


class Condition(NamedTuple):
    """One start from which the plant can be run again and again."""
    start: Numbers  # (nx)
    run: RunTrial  # with its own small spread of the start


@dataclass
class GuidedOptions:
    iterations: int = 8
    samples: int = 5  # runs of each condition an iteration
    epsilon: float = 0.5  # largest divergence from the policy, nats a period
    strength: float = 5.0  # of the physics' prior, in samples
    first_noise: float = 0.05  # deviation of the first commands, in shares of the limits' range
    hidden: list[int] = field(default_factory=lambda: [24, 24])
    steps: int = 1500  # of Adam, an iteration
    drawn: int = 15  # states a period, beside the samples, that the laws are taught at
    seed: int = 1


@dataclass
class GuidedStep:
    """Mean costs of the samples by their local laws and of a run a condition by the network alone."""
    local_cost: float = 0.0
    policy_cost: float = 0.0
    divergence: float = 0.0  # of the new laws from the policy, nats a period, mean
    apart: int = 0  # conditions whose laws are near those before, since laws near the network would cost more


@dataclass
class GuidedResult:
    steps: list[GuidedStep] = field(default_factory=list)
    network: dict[str, Any] | None = None  # of the best round so far
    best: int = -1


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


Refit = Callable[[Numbers], Physics]  # the model fitted to transitions (N, 2 nx + nu)


class Guided:
    def __init__(self, task: Task, goal: Goal, conditions: list[Condition], noise_sd: Numbers, o: GuidedOptions,
                 refit: Refit | None = None) -> None:
        assert task.physics is not None and conditions
        self._task, self._goal, self._conditions, self._o = task, goal, conditions, o
        self._measured = noise_sd**2
        self._refit = refit
        self._rows: list[Any] = []
        self._physics, self._expand = task.physics, jax.jit(jax.vmap(task.physics))
        self._student, self._noise, self._taught = Student(task, o.hidden, o.seed), np.eye(task.nu), False
        self._costs = [self._quadratic(k == task.horizon) for k in range(task.horizon + 1)]

    def run(self, after: Callable[[GuidedStep, int], None], result: GuidedResult) -> None:
        """Fills `result` as it goes; its network is that of the round whose runs cost least."""
        locals_ = [Local(c.start, self._o.epsilon) for c in self._conditions]
        self._plan(locals_)
        for i in range(self._o.iterations):
            step = GuidedStep()
            for c, local in enumerate(locals_):
                self._sample(c, local, i, step)
            if self._refit is not None:
                self._learn_physics(locals_)
            early = 2 * i < self._o.iterations
            lost = [local for local in locals_ if early and min(local.cost, local.best[0]) > LOST * local.planned]
            for local in locals_:
                if not any(local is other for other in lost):
                    self._improve(local, step)
            self._plan(lost)
            self._teach(locals_)
            self._judge(i, step)
            if result.best < 0 or step.policy_cost < result.steps[result.best].policy_cost:
                result.network, result.best = self._student.network(), i
            result.steps.append(step)
            after(step, i)

    def _quadratic(self, last: bool) -> Quadratic:
        goal, nu = self._goal, 0 if last else self._task.nu
        weight = goal.terminal if last else goal.state
        return Quadratic(np.diag(np.concatenate([weight, goal.control[:nu]])),
                         np.concatenate([-weight * goal.target, np.zeros(nu)]))

    def _plan(self, locals_: list[Local]) -> None:
        """Laws about the best motions of the model as it is known (Levine and Koltun 2013 begin with such)."""
        task, o = self._task, self._o
        if not locals_:
            return
        starts, sd = np.array([local.first for local in locals_]), o.first_noise * (task.high - task.low)
        room = 0.5 * (1 - ROOM) * (task.high - task.low)  # for the gains: a command at a limit has no feedback
        tight = self._goal._replace(low=task.low + room, high=task.high - room)
        motions = best_motions(self._physics, tight, starts, task.horizon, o.seed)
        for local, x, u, gain in zip(locals_, *motions, strict=True):
            local.laws = [Law(gain[k], u[k] - gain[k] @ x[k], np.diag(sd**2)) for k in range(task.horizon)]
            z = np.concatenate([x[:-1], u], 1)
            after, slope = map(np.asarray, self._expand(z))
            local.models = [LinearStep(s, n - s @ at, np.diag(self._measured + 1e-8))
                            for at, n, s in zip(z, after, slope, strict=True)]
            local.best = (np.inf, [], [])
            local.planned, local.cost, local.tried = float(self._goal.of(x, u)), np.inf, False

    def _sample(self, c: int, local: Local, iteration: int, step: GuidedStep) -> None:
        o, task, share = self._o, self._task, 1 / (self._o.samples * len(self._conditions))
        local.trials = []
        for s in range(o.samples):
            rng = np.random.default_rng([o.seed, 98, c, iteration, s])
            def controller(x: Numbers, k: int, rng: np.random.Generator = rng) -> Numbers:
                law = local.laws[k]
                z = np.linalg.cholesky(law.noise) @ rng.standard_normal(task.nu)
                return np.clip(law.slope @ x + law.offset + z, task.low, task.high)
            local.trials.append(self._conditions[c].run(controller, iteration * o.samples + s))
        cost = float(np.mean([self._goal.of(t.truth, t.command) for t in local.trials]))
        # a step that cost more was too long: half of it; else half as long again, up to what is asked for
        worse = cost > local.cost * (1 + 1e-3)
        local.epsilon = max(o.epsilon / 16, local.epsilon / 2) if worse else min(o.epsilon, 1.5 * local.epsilon)
        local.cost, local.tried = cost, True
        step.local_cost += cost * o.samples * share

    def _learn_physics(self, locals_: list[Local]) -> None:
        """What all conditions share, the model's parameters, by all transitions so far."""
        assert self._refit is not None
        self._rows += [local.transitions(k) for local in locals_ for k in range(self._task.horizon)]
        rows = np.concatenate(self._rows)
        if len(rows) > MOST_ROWS:
            rows = rows[np.random.default_rng([self._o.seed, len(rows)]).choice(len(rows), MOST_ROWS, replace=False)]
        self._physics = self._refit(rows)
        self._expand = jax.jit(jax.vmap(self._physics))

    def _fit(self, local: Local) -> list[LinearStep]:
        task, models = self._task, []
        data = [Data.of(local.transitions(k)) for k in range(task.horizon)]
        nz = task.nx + task.nu
        after, slopes = map(np.asarray, self._expand(np.array([d.mean[:nz] for d in data])))
        for d, next_state, slope in zip(data, after, slopes, strict=True):
            spread = np.diag(np.diag(d.covariance)[:nz] + 1e-6)
            prior = prior_of_model(d.mean[:nz], next_state, slope, spread, self._measured,
                                   1e-4 * np.diag(spread)[:task.nx], self._o.strength)
            models.append(fit_step(d, prior, task.nx, 1e-9))
        return models

    def _policy_about(self, local: Local) -> list[Law]:
        """The network near the samples: the regression of its commands on their states, with a mixture over all periods
        as its prior (Montgomery and Levine 2016, section 4.1). Its slope at a point is no gain."""
        task = self._task
        rows = [np.hstack([x, self._student.raw(x)]) for x in map(local.measured, range(task.horizon))]
        mixture = fit_mixture(np.concatenate(rows), 2 * task.horizon // 5 + 1, 10, self._o.seed)
        laws = []
        for r in rows:
            prior = prior_of_mixture(mixture, r, float(task.nx + 2), 1.0)
            law = fit_step(Data.of(r), prior, task.nu, 1e-8)
            # no gain makes more of the samples' spread than the whole range
            most = (task.high - task.low) / np.maximum(1e-12, np.abs(law.slope) @ r[:, :task.nx].std(0))
            gain = law.slope * np.minimum(1, most)[:, None]
            mean = r.mean(0)
            laws.append(Law(gain, mean[task.nx:] - gain @ mean[:task.nx], self._noise))
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

    def _improve(self, local: Local, step: GuidedStep) -> None:
        """Laws of less cost near the network; where those would cost more than the laws before, near these; where
        none are found, these stay."""
        if local.goes_back():
            return
        task, local.models = self._task, self._fit(local)
        if local.cost <= local.best[0]:
            local.best = local.cost, local.laws, local.models
        start = local.start()
        # with what the quadratic costs leave out, so that a share of it means something
        whole = 0.5 * self._goal.target**2 @ (task.horizon * self._goal.state + self._goal.terminal)
        most = 1.1 * (whole + expected_cost(self._costs, passage(local.models, local.laws, *start)))
        for before in ([self._policy_about(local)] if self._taught else []) + [local.laws]:
            found = kl_lqr(local.models, self._limited(before, local), before, *start, local.epsilon * task.horizon)
            if found is not None and whole + expected_cost(
                    self._costs, passage(local.models, found.laws, *start)) < most:
                local.laws = found.laws
                step.divergence += found.divergence / task.horizon / len(self._conditions)
                break
            step.apart += self._taught and before is not local.laws

    def _teach(self, locals_: list[Local]) -> None:
        """min_pi sum_ik E_x KL(p_ik(u | x) || pi(u | x)): for normal laws a regression weighted by their precisions,
        and the inverse of the precisions' mean for the policy's covariance."""
        x, wanted, precision = [], [], []
        rng = np.random.default_rng([self._o.seed, 99])
        for local in locals_:
            way = passage(local.models, local.laws, *local.start())
            for k, law in enumerate(local.laws):
                nx = self._task.nx
                drawn = rng.multivariate_normal(way.mean[k][:nx], way.covariance[k][:nx, :nx], self._o.drawn,
                                                check_valid="ignore", method="eigh")
                rows = np.concatenate([local.measured(k), drawn]) if local.tried else drawn
                x.append(rows)
                wanted.append(rows @ law.slope.T + law.offset)
                precision.append(np.tile(np.linalg.inv(law.noise), (len(rows), 1, 1)))
        sharp = np.concatenate(precision)
        self._noise, self._taught = np.linalg.inv(sharp.mean(0)), True
        self._student.fit(np.concatenate(x), np.concatenate(wanted), sharp, self._o.steps)

    def _judge(self, iteration: int, step: GuidedStep) -> None:
        trials = [c.run(self._student.command, 900000 + iteration) for c in self._conditions]
        step.policy_cost = float(np.mean([self._goal.of(t.truth, t.command) for t in trials]))


def guided_search(task: Task, goal: Goal, conditions: list[Condition], noise_sd: Numbers, o: GuidedOptions,
                  after: Callable[[GuidedStep, int], None], result: GuidedResult, refit: Refit | None = None) -> None:
    """An iteration runs each condition a few times under its laws, fits a linear model to each period with the
    physics' derivative as prior (at parameters that `refit` fits to all runs), finds laws of less
    cost within a divergence of the network, linearised by regression
    where the samples are, and fits the network to all laws (Montgomery and Levine, NIPS 2016)."""
    Guided(task, goal, conditions, noise_sd, o, refit).run(after, result)
