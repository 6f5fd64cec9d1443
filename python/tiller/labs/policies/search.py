"""The loop of every policy search on a learnt model: trials, a Gaussian process of all transitions, a better policy."""
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import jax
import numpy as np

from .feedback import Feedback, command, make_feedback
from .forecast import Forecast, forecast
from .minimise import Numbers
from .moments import Bumps, Normal, with_sines
from .plant import RunTrial, Trial, random_controller
from .process import ProcessOptions, Shape, condition, fit_shape
from .shown import distance
from .task import Task, features, sure_cost

Improve = Callable[[Bumps, Feedback, int], Feedback]  # dynamics learnt so far, the policy before, the trial's index
Try = Callable[[Feedback | None, int], Trial]  # a policy, None before there is one, and the trial's index


@dataclass
class SearchOptions:
    trials: int = 8  # with a policy, after `random_trials` with random commands
    random_trials: int = 1
    kind: str = "rbf"  # linear, rbf
    bumps: int = 20
    evaluations: int = 100  # of cost and gradient, before each trial
    restarts: int = 1  # searches from fresh policies before each trial
    seed: int = 1
    process: ProcessOptions = field(default_factory=ProcessOptions)


@dataclass
class SearchStep:
    """One trial and what was thought of it before."""
    trial: Trial
    cost: float  # of the true states
    predicted: float = float("nan")  # NaN: none, the commands were random
    seconds: float = 0.0  # learning and searching before it
    forecast: Forecast | None = None


@dataclass
class SearchResult:
    steps: list[SearchStep] = field(default_factory=list)
    policy: Feedback | None = None  # of the last trial


def transitions(task: Task, trial: Trial) -> tuple[Numbers, Numbers]:
    """What the process sees, (periods, seen + nu), and what the state gained (beyond the physics where there are some),
    (periods, nx)."""
    before, after = trial.measured[:-1], trial.measured[1:]
    if task.physics is not None:
        expected = np.asarray(jax.vmap(task.physics)(np.concatenate([before, trial.command], 1))[0])
    else:
        expected = before
    seen = np.asarray(features(task.angles, before))[:, task.seen]
    return np.concatenate([seen, trial.command], 1), after - expected


def start_features(task: Task) -> Normal:
    """Of what the policy sees at the start."""
    f, seen = with_sines(Normal(task.start_mean, task.start_covariance), task.angles), np.array(task.seen)
    return Normal(np.asarray(f.mean)[seen], np.asarray(f.covariance)[np.ix_(seen, seen)])


def realised_cost(task: Task, trial: Trial) -> float:
    """A period that a trial lacks, because the robot stopped, costs as much as any can. Of demonstrations to match:
    the distance from them."""
    if task.shown is not None:
        return distance(task.shown, trial.truth)
    return float(sure_cost(task, trial.truth[1:]).sum()) + task.horizon - len(trial.command)


def fresh_policy(task: Task, o: SearchOptions, index: int, deviation: float = 0.1) -> Feedback:
    return make_feedback(task, o.kind, o.bumps, start_features(task), deviation, [o.seed, 91, index])


def on_plant(task: Task, run: RunTrial, seed: int) -> Try:
    """Random commands come first."""
    answer = jax.jit(lambda policy, x: command(task, policy)(x))

    def one(policy: Feedback | None, index: int) -> Trial:
        if policy is None:
            return run(random_controller(task.low, task.high, seed, index), index)
        return run(lambda x, k: np.asarray(answer(policy, x)), index)

    return one


def search_policy(task: Task, run: Try, o: SearchOptions, improve: Improve,
                  after: Callable[[SearchStep, int], None], result: SearchResult) -> None:
    """Trials before there is a policy; then, over and over, a Gaussian process, a better policy, and a trial of it.
    Fills `result` as it goes, so that what an interrupt leaves is whole."""
    seen: list[tuple[Numbers, Numbers]] = []
    shape: Shape | None = None
    predict = jax.jit(lambda process, policy: forecast(task, process, policy))
    policy = fresh_policy(task, o, 0)
    for i in range(o.random_trials + o.trials):
        begun = time.monotonic()
        if i < o.random_trials:
            trial = run(None, i)
            step = SearchStep(trial, realised_cost(task, trial))
        else:
            x, y = (np.concatenate(rows) for rows in zip(*seen, strict=True))
            shape = fit_shape(x, y, o.process, o.seed, shape)
            process = condition(x, y, shape, o.process)
            policy = improve(process, policy, i)
            expected = Forecast(*map(np.asarray, predict(process, policy)))
            seconds = time.monotonic() - begun
            trial = run(policy, i)
            step = SearchStep(trial, realised_cost(task, trial), float(expected.cost[1:].sum()), seconds, expected)
            result.policy = policy
        seen.append(transitions(task, trial))
        result.steps.append(step)
        after(step, i)
