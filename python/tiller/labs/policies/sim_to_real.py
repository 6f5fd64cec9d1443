"""SimOpt's alternation (Chebotar et al., ICRA 2019): a policy trained on drawn models, run on the plant, and the
models' distribution moved to where they do what the plant did under it."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..methods.discrepancy import Residual
from ..methods.logs import Logs
from ..methods.reps import bounded_weights
from ..methods.simopt import LEAST_SHARE, refitted
from ..mixture import Mixture
from .guide import Goal
from .minimise import Numbers
from .plant import RunTrial, Trial
from .student import Student
from .task import Task, features
from .trpo import Trpo, TrpoOptions


@dataclass
class SimToRealOptions:
    iterations: int = 5
    updates: int = 150  # of the policy before the plant is seen; half as many in later iterations
    runs: int = 3  # of the plant, an iteration
    candidates: int = 256  # models that are compared with the runs
    kl: float = 1.0  # bound of the candidates' weights from equal ones, nats
    hidden: list[int] = field(default_factory=lambda: [24, 24])
    trpo: TrpoOptions = field(default_factory=TrpoOptions)
    seed: int = 1


@dataclass
class SimToRealStep:
    """After an iteration's training: mean costs of the policy from the same starts, and the models that it was trained
    on."""
    model_cost: float
    plant_cost: float
    mean: Numbers  # (np)
    sd: Numbers
    discrepancy: float  # of the candidates, by their weights


@dataclass
class SimToRealResult:
    steps: list[SimToRealStep] = field(default_factory=list)
    network: dict[str, Any] | None = None  # of the iteration whose runs cost least
    best: int = -1


@dataclass
class Priors:
    """Draws (n, np) of the parameters, and bounds."""
    draws: Numbers
    low: Numbers
    high: Numbers

    def __post_init__(self) -> None:
        self.free = np.flatnonzero(np.ptp(self.draws, axis=0) > 0)

    def normal(self) -> Mixture:
        """Of the free ones."""
        rows = self.draws[:, self.free]
        return Mixture(np.ones(1), rows.mean(0)[None], np.cov(rows.T).reshape(1, len(self.free), -1)
                       ).cut(self.low[self.free], self.high[self.free])

    def params(self, v: Numbers) -> Numbers:
        out = np.tile(self.draws.mean(0), (len(v), 1))
        out[:, self.free] = v
        return out


class SimToReal:
    def __init__(self, task: Task, goal: Goal, step: Callable[[Any, Any], Any], priors: Priors, run: RunTrial,
                 noise_sd: Numbers, o: SimToRealOptions) -> None:
        self._task, self._goal, self._priors, self._run, self._noise_sd, self._o = task, goal, priors, run, noise_sd, o
        self._rng = np.random.default_rng([o.seed, 88])
        student = Student(task, o.hidden, o.seed)
        spread = np.sqrt(np.diag(task.start_covariance)) + np.abs(goal.target - task.start_mean) / 2
        x = task.start_mean + 2 * spread * self._rng.standard_normal((1000, task.nx))
        seen = np.asarray(features(task.angles, x))[:, task.seen]
        student.scale = seen.mean(0), np.maximum(0.3, seen.std(0))
        self._trpo, self.student = Trpo(task, goal, step, student, o.trpo), student

    def run(self, after: Callable[[SimToRealStep, int], None], result: SimToRealResult) -> None:
        """Fills `result` as it goes."""
        o, normal, trials = self._o, self._priors.normal(), 0
        least_sd = LEAST_SHARE * np.sqrt(np.diag(normal.covariance[0]))
        for i in range(o.iterations):
            self._trpo.run(lambda n: self._draw(normal, n), o.updates if i == 0 else o.updates // 2, o.seed * 1000 + i)
            runs = [self._run(self.student.command, trials + r) for r in range(o.runs)]
            trials += o.runs
            params, starts = self._draw(normal, 64 * o.runs)[0], np.tile([t.measured[0] for t in runs], (64, 1))
            batch, _ = self._trpo.policy_rollouts(self.student.arrays, params, starts)
            v = normal.draw(self._rng, o.candidates)
            logs = self._logs(runs)
            cost = logs.evaluated(self._priors.params(v), Residual(logs, 1.0, 1.0, True, 0.0))
            weights = bounded_weights(cost, o.kl)
            plant_cost = float(np.mean([self._goal.of(t.truth, t.command) for t in runs]))
            held = weights.weight > 0
            step = SimToRealStep(float(batch.cost.sum(0).mean()), plant_cost, self._priors.params(normal.mean)[0],
                                 np.zeros(self._priors.draws.shape[1]), float(weights.weight[held] @ cost[held]))
            step.sd[self._priors.free] = np.sqrt(np.diag(normal.covariance[0]))
            if result.best < 0 or plant_cost < result.steps[result.best].plant_cost:
                result.network, result.best = self.student.network(), i
            result.steps.append(step)
            normal = refitted(normal, v, weights.weight, least_sd)
            after(step, i)

    def _draw(self, normal: Mixture, count: int) -> tuple[Numbers, Numbers]:
        starts = self._rng.multivariate_normal(self._task.start_mean, self._task.start_covariance, count)
        return self._priors.params(normal.draw(self._rng, count)), starts

    def _logs(self, runs: list[Trial]) -> Logs:
        """What was measured of the runs; candidates go from the same starts under the policy, as in the paper."""
        task, count, lanes = self._task, len(runs), 64
        start = np.array([t.measured[0] for t in runs])

        def simulate(params: Numbers) -> Numbers:
            wide = np.concatenate([params, np.repeat(params[-1:], lanes - len(params), 0)])
            batch, last = self._trpo.policy_rollouts(self.student.arrays, np.repeat(wide, count, 0),
                                                     np.tile(start, (lanes, 1)))
            x = np.concatenate([batch.x[1:], last[None]]).reshape(task.horizon, lanes, count, task.nx)
            return x.transpose(2, 0, 3, 1).reshape(count * task.horizon, task.nx, lanes)

        rows = lambda per_run: np.repeat(per_run, task.horizon, 0)
        sd = np.tile(self._noise_sd, (count * task.horizon, 1))
        return Logs(rows(np.arange(count)), np.tile(np.arange(1.0, task.horizon + 1), count),
                    np.concatenate([t.command for t in runs]), rows(start), sd,
                    np.concatenate([t.measured[1:] for t in runs]), sd, np.isin(np.arange(task.nx), task.angles),
                    np.zeros(task.nx), task.period_s, lanes, simulate)
