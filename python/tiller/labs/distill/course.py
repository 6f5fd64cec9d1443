"""DAgger on the robot's model over draws of its hidden parameters (Ross, Gordon, Bagnell, AISTATS 2011)."""
from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ... import _core
from ..._errors import Error
from . import episode, network
from .belief import prior_moments
from .episode import Driver, Episode, Samples, Task
from .network import EPOCHS, Errors, Student
from .options import Options
from .teacher import held_out, with_policy, with_teacher

VALIDATION = 1 << 20  # number of the first validation episode
SHARE_FALLS = 0.5  # of the teacher at the wheel, from round to round
LAST_EPOCHS = 3  # the last round's fit may take so many times as long
STATE, GOAL, BELIEF = 1, 2, 4 + 8  # tiller_policy_input_t


@dataclass
class Round:
    samples: int  # all so far
    errors: Errors
    cost_ratio: float  # the policy's mean cost over the teacher's, in the validation episodes


@dataclass
class HeldOut:
    seed: int
    teacher_cost: float  # mean stage cost a tick
    policy_cost: float
    teacher_safe: bool
    policy_safe: bool


@dataclass
class Distilled:
    policy: dict[str, Any] = field(default_factory=dict)
    rounds: list[Round] = field(default_factory=list)
    best: int = 0
    tests: list[HeldOut] = field(default_factory=list)

    @property
    def held_out_ratio(self) -> float:
        return sum(t.policy_cost for t in self.tests) / sum(t.teacher_cost for t in self.tests)


def default_reads(robot: _core.Robot) -> int:
    free = any(prior["kind"] != "fixed" for prior in robot.priors.values())
    return STATE + GOAL * bool(_core.training_facts(robot)["has_reference"]) + BELIEF * free


class Course:
    def __init__(self, robot: _core.Robot, options: Options, tell: Callable[[str], None]) -> None:
        self.o, self._tell = options, tell
        self.teacher = with_teacher(robot, options.teacher, as_it_is=options.as_it_is)
        reads = options.reads or default_reads(robot)
        self._task = Task.of(self.teacher, prior_moments(robot), reads, options.seconds, options.seed)
        self._student = Student(*network.names(robot, reads), options.hidden, options.seed)
        self.policy: _core.Robot | None = None
        self._samples = Samples()

    def _all(self, first: int, count: int, *, teacher: bool, policy: bool, share: float = 1.0,
             pushed: bool = False) -> list[Episode]:
        def one(number: int) -> Episode:
            return episode.run(self._task, number, Driver(self.teacher) if teacher else None,
                               Driver(self.policy) if policy and self.policy else None, share, pushed)
        with ThreadPoolExecutor(self.o.threads) as pool:
            try:
                return list(pool.map(one, range(first, first + count)))
            except KeyboardInterrupt:
                pool.shutdown(cancel_futures=True)
                raise

    def _cost(self, *, teacher: bool) -> float:
        return float(np.mean([e.cost for e in self._all(VALIDATION, self.o.validation, teacher=teacher,
                                                        policy=not teacher)]))

    def _round(self, k: int, par: float) -> Round:
        for one in self._all(k * self.o.episodes, self.o.episodes, teacher=True, policy=k > 0, share=SHARE_FALLS**k,
                             pushed=True):
            self._samples.extend(one.samples)
        if not self._samples.read:
            raise Error("the teacher had no finite plan in any episode; tiller run shows why",
                        status="plan_not_finite")
        epochs = EPOCHS * (LAST_EPOCHS if k + 1 == self.o.iterations else 1)
        errors = self._student.fit(self._samples, self.o.seed + k, epochs, self.o.power)
        self.policy = with_policy(self.teacher, self._student.document(self._task.reads))
        return Round(len(self._samples.read), errors, self._cost(teacher=False) / par)

    def run(self, result: Distilled) -> None:
        """Fills `result` round by round, so that an interruption leaves the best so far."""
        par = self._cost(teacher=True)
        for k in range(self.o.iterations):
            now = self._round(k, par)
            result.rounds.append(now)
            self._tell(f"round {k + 1} of {self.o.iterations}: {now.samples} samples, error "
                       f"{now.errors.held_out:.3f} of half the range, cost over the teacher's {now.cost_ratio:.3f}")
            if k == 0 or now.cost_ratio < result.rounds[result.best].cost_ratio:
                result.best, result.policy = k, self._student.document(self._task.reads)
        self._test(result)

    def _test(self, result: Distilled) -> None:
        policy = with_policy(self.teacher, result.policy)
        for i in range(self.o.test):
            seed = VALIDATION + self.o.seed * 1000 + i
            one = compare(self.teacher, policy, self.o.seconds, seed)
            result.tests.append(one)
            self._tell(f"held-out draw {i + 1} of {self.o.test}: cost over the teacher's "
                       f"{one.policy_cost / one.teacher_cost:.3f}")


def compare(teacher: _core.Robot, policy: _core.Robot, seconds: float, seed: int) -> HeldOut:
    """Whole controllers on the plant of the same draw."""
    a, b = (held_out(who, teacher, seconds, seed) for who in (teacher, policy))
    return HeldOut(seed, -a.score, -b.score, a.safe, b.safe)
