"""One episode on the robot's model: whoever drives, the teacher says at each tick what it would do (DAgger)."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ... import _core
from .belief import Array, BeliefCourse, Moments

TURN_S = 0.5  # for which teacher or policy drives
PUSH_S = 0.1  # for which a random command acts
PUSHES_PER_S = 0.5
NOISE = 2.0  # of process noise over the robot file's: rare states become less rare
NEARBY, NEARBY_SD = 2, 4.0  # samples around each one, so many deviations of a period's noise and the start's off


@dataclass
class Samples:
    """What a policy reads (n, inputs), the teacher's command (n, nu) as a share of its range, -1 to 1, the number of
    the episode, and the cost of the ticks that followed, a tick."""
    read: list[Array] = field(default_factory=list)
    share: list[Array] = field(default_factory=list)
    episode: list[int] = field(default_factory=list)
    to_go: list[float] = field(default_factory=list)

    def extend(self, more: Samples) -> None:
        for name in ("read", "share", "episode", "to_go"):
            getattr(self, name).extend(getattr(more, name))


@dataclass
class Episode:
    samples: Samples
    cost: float  # mean stage cost of the ticks; those after a loss cost what the last one did
    lost: bool  # the state was no longer finite, or left what its sensors can read


@dataclass(frozen=True)
class Task:
    robot: _core.Robot
    prior: Moments
    reads: int
    seconds: float
    seed: int
    facts: dict[str, Any]

    @classmethod
    def of(cls, robot: _core.Robot, prior: Moments, reads: int, seconds: float, seed: int) -> Task:
        return cls(robot, prior, reads, seconds, seed, _core.training_facts(robot))


class Driver:
    """Teacher or policy: a planner of the runtime under the episode's beliefs."""

    def __init__(self, robot: _core.Robot) -> None:
        self._planner = _core.PlannerAlone(robot)

    def ask(self, motion: _core.Motion, belief: BeliefCourse, now: Moments, last: Array,
            step: int) -> tuple[Array, Array | None] | None:
        return self._planner.plan(motion.state, motion.effect_state,
                                  belief.hypotheses(now, self._planner.hypotheses), now.mean, now.sd, last, step)


class _Turns:
    """Who drives, and pushes."""

    def __init__(self, task: Task, share: float, pushed: bool, rng: np.random.Generator) -> None:
        self._period, self._share, self._rng = task.robot.period_s, share, rng
        self._rate = PUSHES_PER_S * self._period if pushed else 0.0
        self._low, self._range = task.robot.input_low, task.robot.input_high - task.robot.input_low
        self._left, self._push, self.teacher = 0, np.zeros(0), True

    def command(self, tick: int, teacher: Array | None, policy: Array | None) -> Array | None:
        if tick % max(1, round(TURN_S / self._period)) == 0:
            self.teacher = bool(self._rng.random() < self._share)
        if self._rng.random() < self._rate:
            self._left = max(1, round(PUSH_S / self._period))
            self._push = self._low + self._range * self._rng.random(self._low.size)
        self._left -= 1
        if self._left >= 0:
            return self._push
        return teacher if policy is None or (self.teacher and teacher is not None) else policy


def run(task: Task, number: int, teacher: Driver | None, policy: Driver | None, teacher_share: float = 1.0,
        pushed: bool = False) -> Episode:
    """Same task and number, same bits. Nothing is recorded without a teacher."""
    rng = np.random.default_rng([task.seed, number])
    robot, scale = task.robot, NOISE if pushed else 1.0
    belief = BeliefCourse(robot, task.prior, rng)
    motion = _core.Motion(robot, belief.truth)
    motion.move(scale * task.facts["start_sd"] * rng.standard_normal(len(robot.states)))
    noise = scale * task.facts["process_sd"] * np.sqrt(robot.period_s)
    turns, samples = _Turns(task, teacher_share, pushed, rng), Samples()
    ticks, last = round(task.seconds / robot.period_s), np.array(task.facts["safe_command"])
    costs: list[float] = []
    marks: list[int] = []
    while len(costs) < ticks and motion.readable:
        tick = len(costs)
        now = belief.at(tick * robot.period_s)
        wanted = teacher.ask(motion, belief, now, last, tick) if teacher else None
        own = policy.ask(motion, belief, now, last, tick) if policy else None
        if wanted:
            _record(task, samples, number, motion.state, now, last, tick, wanted, rng)
        marks += [tick] * (len(samples.read) - len(marks))
        given = turns.command(tick, wanted and wanted[0], own and own[0])
        last = last if given is None else given
        costs.append(motion.cost(last, tick))
        motion.step(last)
        motion.move(noise * rng.standard_normal(noise.size))
    lost = len(costs) < ticks
    total = sum(costs) + (costs[-1] if costs else np.inf) * (ticks - len(costs))
    samples.to_go = _to_go(costs, robot.horizon)[marks].tolist() if marks else []
    return Episode(samples, float(total / ticks) if np.isfinite(total) else np.inf, lost)


def _to_go(costs: list[float], horizon: int) -> Array:
    """Mean cost of the next `horizon` ticks, or of those that are left."""
    total = np.concatenate([[0.0], np.cumsum(costs)])
    first = np.arange(len(costs))
    end = np.minimum(first + horizon, len(costs))
    return np.asarray((total[end] - total[first]) / (end - first))


def _record(task: Task, samples: Samples, number: int, x: Array, now: Moments, last: Array, step: int,
            wanted: tuple[Array, Array | None], rng: np.random.Generator) -> None:
    command, gain = wanted
    sd = NEARBY_SD * np.hypot(task.facts["start_sd"], task.facts["process_sd"] * np.sqrt(task.robot.period_s))
    offsets = [np.zeros(x.size)]
    if gain is not None:
        offsets += [sd * rng.standard_normal(x.size) for _ in range(NEARBY)]
    low, high = task.robot.input_low, task.robot.input_high
    for off in offsets:
        answer = command if gain is None else command + gain @ off
        samples.read.append(_core.policy_row(task.robot, task.reads, x + off, now.mean, now.sd, last, step))
        samples.share.append(np.clip((2 * answer - low - high) / np.where(high > low, high - low, 1), -1, 1))
        samples.episode.append(number)
