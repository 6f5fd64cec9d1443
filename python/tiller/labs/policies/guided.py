"""Guided policy search by mirror descent: local laws that teach a network."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from .guide import Goal, Guide, Motions, unlimited
from .laws import Law, passage
from .local import LinearStep
from .local_laws import Improver, Local
from .minimise import Numbers
from .physics import Family
from .plant import RunTrial, Trial
from .student import Student
from .task import Task
from .teacher import Taught, Teacher

ROOM = 0.8  # share of the limits' range that first motions use
LOST = 1.2  # times what a motion was to cost: the plant does not follow it
MOST_ROWS = 400  # transitions that the model is fitted to
LESSONS = 2  # rounds whose lessons are taught


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
    steps: int = 3000  # of Adam, a lesson
    drawn: int = 15  # states a period, beside the samples, that the laws are taught at
    lessons: int = 2  # along the network's own passage, an iteration
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


class Guided:
    def __init__(self, task: Task, goal: Goal, conditions: list[Condition], noise_sd: Numbers, o: GuidedOptions,
                 family: Family) -> None:
        assert conditions
        self._task, self._goal, self._conditions, self._o = task, goal, conditions, o
        self._measured, self._family, self._params = noise_sd**2, family, family.first
        self._expand = jax.jit(lambda z, params: jax.vmap(family.physics(params))(z))
        self._guide = Guide(family.physics)
        self._student, self._noise, self._taught = Student(task, o.hidden, o.seed), np.eye(task.nu), False
        self._teacher = Teacher(task, goal, family, self._guide, noise_sd)
        self._improver = Improver(task, goal, self._measured, o.strength, o.seed)
        self._rows: list[Numbers] = []
        self._lessons: list[Taught] = []
        self._own: list[Trial] = []  # the network's last runs

    def run(self, after: Callable[[GuidedStep, int], None], result: GuidedResult) -> None:
        """Fills `result` as it goes; its network is that of the round whose runs cost least."""
        locals_ = [Local(c.start, self._o.epsilon) for c in self._conditions]
        self._plan(locals_)
        for i in range(self._o.iterations):
            step = GuidedStep()
            for c, local in enumerate(locals_):
                self._sample(c, local, i, step)
            self._learn_physics(locals_)
            early = 2 * i < self._o.iterations
            lost = [local for local in locals_ if early and min(local.cost, local.best[0]) > LOST * local.planned]
            for local in locals_:
                if not any(local is other for other in lost):
                    self._improve(local, step)
            self._plan(lost)
            self._teach(locals_, i)
            self._judge(i, step)
            if result.best < 0 or step.policy_cost < result.steps[result.best].policy_cost:
                result.network, result.best = self._student.network(), i
            result.steps.append(step)
            after(step, i)

    def _expanded(self, z: Numbers) -> tuple[Numbers, Numbers]:
        after, slope = self._expand(z, self._params)
        return np.asarray(after), np.asarray(slope)

    def _plan(self, locals_: list[Local]) -> None:
        """Laws about the best motions of the model as it is known (Levine and Koltun 2013 begin with such)."""
        task, o = self._task, self._o
        if not locals_:
            return
        starts, sd = np.array([local.first for local in locals_]), o.first_noise * (task.high - task.low)
        room = 0.5 * (1 - ROOM) * (task.high - task.low)  # for the gains: a command at a limit has no feedback
        tight = self._goal._replace(low=task.low + room, high=task.high - room)
        motions = self._guide.best(self._params, tight, starts, task.horizon, o.seed)
        gains = self._guide.gains(self._params, unlimited(self._goal), motions)
        for local, x, u, gain, cost in zip(locals_, motions.x, motions.u, gains, motions.cost, strict=True):
            local.laws = [Law(gain[k], u[k] - gain[k] @ x[k], np.diag(sd**2)) for k in range(task.horizon)]
            z = np.concatenate([x[:-1], u], 1)
            local.models = [LinearStep(s, n - s @ at, np.diag(self._measured + 1e-8))
                            for at, n, s in zip(z, *self._expanded(z), strict=True)]
            local.best = (np.inf, [], [])
            local.planned, local.cost, local.tried = float(cost), np.inf, False

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
        self._rows += [local.transitions(k) for local in locals_ for k in range(self._task.horizon)]
        rows = np.concatenate(self._rows)
        if len(rows) > MOST_ROWS:
            rows = rows[np.random.default_rng([self._o.seed, len(rows)]).choice(len(rows), MOST_ROWS, replace=False)]
        self._params = self._family.fit(rows)

    def _policy_about(self, local: Local) -> list[Law]:
        return self._improver.policy_about(local, self._student.raw, self._noise)

    def _improve(self, local: Local, step: GuidedStep) -> None:
        network = (lambda: self._policy_about(local)) if self._taught else None
        divergence, apart = self._improver(local, self._expanded, network)
        step.divergence += divergence / len(self._conditions)
        step.apart += apart

    def _teach(self, locals_: list[Local], iteration: int) -> None:
        """min_pi sum_ik E_x KL(p_ik(u | x) || pi(u | x)): for normal laws a regression weighted by their precisions,
        and the inverse of the precisions' mean for the policy's covariance. Then what the teacher wants along the
        network's own passage, on the plant and on the model."""
        x, wanted, precision, known = [], [], [], []
        rng = np.random.default_rng([self._o.seed, 99, iteration])
        nx = self._task.nx
        for local in locals_:
            way = passage(local.models, local.laws, *local.start())
            known.append((np.array([m[:nx] for m in way.mean]), np.array([m[nx:] for m in way.mean[:-1]])))
            for k, law in enumerate(local.laws):
                drawn = rng.multivariate_normal(way.mean[k][:nx], way.covariance[k][:nx, :nx], self._o.drawn,
                                                check_valid="ignore", method="eigh")
                rows = np.concatenate([local.measured(k), drawn]) if local.tried else drawn
                x.append(rows)
                wanted.append(rows @ law.slope.T + law.offset)
                precision.append(np.tile(np.linalg.inv(law.noise), (len(rows), 1, 1)))
        laws, sharp = Taught(np.concatenate(x), np.concatenate(wanted)), np.concatenate(precision)
        self._noise, self._taught = np.linalg.inv(sharp.mean(0)), True
        motions = Motions(np.array([m[0] for m in known]), np.array([m[1] for m in known]), np.zeros(len(known)))
        self._lessons = self._lessons[-self._o.lessons * (LESSONS - 1):] if self._o.lessons else []
        usual = np.median(sharp, 0)
        for lesson in range(self._o.lessons + 1):
            if lesson:
                own, commands = self._teacher.passages(self._student, self._params, rng)
                if lesson == 1 and self._own:
                    own = np.concatenate([own, [t.measured for t in self._own]])
                    commands = np.concatenate([commands, [t.command for t in self._own]])
                self._lessons.append(self._teacher.lesson(own, commands, motions, self._params, rng))
            all_ = Taught.joined([laws, *self._lessons])
            more = np.tile(usual, (len(all_.x) - len(laws.x), 1, 1))
            self._student.fit(all_.x, all_.u, np.concatenate([sharp, more]), self._o.steps)

    def _judge(self, iteration: int, step: GuidedStep) -> None:
        self._own = [c.run(self._student.command, 900000 + iteration) for c in self._conditions]
        step.policy_cost = float(np.mean([self._goal.of(t.truth, t.command) for t in self._own]))


def guided_search(task: Task, goal: Goal, conditions: list[Condition], noise_sd: Numbers, o: GuidedOptions,
                  after: Callable[[GuidedStep, int], None], result: GuidedResult, family: Family) -> None:
    """An iteration runs each condition a few times under its laws, fits a linear model to each period with the
    physics' derivative as prior (at parameters that fit all runs), finds laws of less cost within a divergence of the
    network, linearised by regression where the samples are, and fits the network to all laws (Montgomery and Levine,
    NIPS 2016) and to what a planner wants along the network's own passage."""
    Guided(task, goal, conditions, noise_sd, o, family).run(after, result)
