"""A robot file's starts and cost, as guided search and the benches ask for them."""
from __future__ import annotations

import numpy as np

from ... import _core
from .guide import Goal
from .guided import Condition
from .physics import Family, Model
from .plant import PlantTrials, measured_deviation
from .task import Task


def goal_of(robot: _core.Robot, task: Task) -> Goal:
    """[cost]'s weights of states and inputs; without the input's change and other terms."""
    facts = _core.training_facts(robot)
    return Goal(robot.target, facts["state_weight"], facts["terminal_weight"], np.maximum(facts["input_weight"], 1e-6),
                task.low, task.high)


def family_of(robot: _core.Robot, task: Task) -> Family:
    """The robot file's model."""
    variance, model = measured_deviation(robot, task.period_s)**2, Model(robot, task.period_s)
    return Family(model.physics, lambda rows: model.fit(rows, variance), robot.prior_centre)


def conditions_of(robot: _core.Robot, task: Task, count: int, seed: int) -> list[Condition]:
    """Starts along the spread's diagonal, 1.5 deviations to each side: the same spread for any number of them."""
    found = []
    for c in range(count):
        share = 2 * c / (count - 1) - 1 if count > 1 else 0.0
        start = task.start_mean + 1.5 * share * np.sqrt(np.diag(task.start_covariance))
        run = PlantTrials(robot, task.period_s, task.horizon, measured_deviation(robot, task.period_s), start,
                          0.01 * task.start_covariance, seed, c + 1)
        found.append(Condition(start, run))
    return found
