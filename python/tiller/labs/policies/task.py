"""What is to be done, and what is seen of the state."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from ... import _core
from ..._errors import RobotFileError
from .minimise import Numbers
from .moments import Array
from .physics import Physics
from .shown import Shown

STATE = 1  # tiller_policy_input_t


@dataclass(frozen=True)
class Task:
    """Features are all states and, behind them, sine and cosine of each angle."""
    states: list[str]
    commands: list[str]
    angles: list[int]  # states whose sine and cosine stand in their place
    low: Numbers  # (nu)
    high: Numbers
    start_mean: Numbers  # (nx)
    start_covariance: Numbers
    period_s: float
    horizon: int  # periods
    target: Numbers  # (features)
    weight: Numbers  # (features, features) of the saturating cost
    physics: Physics | None = None  # what the learnt differences come on top of; None: the state before
    shown: Shown | None = None  # demonstrations to match, in the place of the target

    @property
    def nx(self) -> int:
        return len(self.states)

    @property
    def nu(self) -> int:
        return len(self.low)

    @property
    def seen(self) -> list[int]:
        """Features that policy and process read: the states in their order, an angle by sine and cosine."""
        return [f for i in range(self.nx) for f in (
            [self.nx + 2 * self.angles.index(i) + k for k in (0, 1)] if i in self.angles else [i])]

    @property
    def seen_names(self) -> list[str]:
        return [n for i, name in enumerate(self.states) for n in (
            [f"sin {name}", f"cos {name}"] if i in self.angles else [name])]


def features(angles: Sequence[int], x: Array) -> Array:
    """(..., features) of states (..., nx)."""
    turn = x[..., np.asarray(angles, int)]
    waves = jnp.stack([jnp.sin(turn), jnp.cos(turn)], -1)
    return jnp.concatenate([x, waves.reshape(*x.shape[:-1], -1)], -1)


def sure_cost(task: Task, x: Array) -> Array:
    """(...) saturating cost of states (..., nx)."""
    off = features(task.angles, x) - task.target
    return 1 - jnp.exp(-0.5 * ((off @ task.weight) * off).sum(-1))


def angles_of(robot: _core.Robot) -> list[int]:
    waves = {name[4:] for name in _core.policy_inputs(robot, STATE) if name.startswith("sin ")}
    return [i for i, name in enumerate(robot.states) if name in waves]


def make_task(robot: _core.Robot, period_s: float, seconds: float, width: float = 0.0, *,
              physics: Physics | None = None) -> Task:
    """The task of a robot file: its start, limits and target. The cost saturates over the file's state weights,

        1 - exp(-1/2 sum_i w_i d_i^2 / width^2),   d_i = x_i - target_i, and the chord for an angle

    so that no period costs more than one. width 0: the start lies four widths from the target. Raises RobotFileError
    where the file has no such task: no limits, no weights, or a start at the target."""
    facts, angles, nx = _core.training_facts(robot), angles_of(robot), len(robot.states)
    if not (np.isfinite(robot.input_low).all() and np.isfinite(robot.input_high).all()):
        raise RobotFileError(f"{robot.path}: [limits]: a policy needs low and high of every input; give them")
    weights = facts["state_weight"]
    rows = np.concatenate([np.where(np.isin(np.arange(nx), angles), 0.0, weights), np.repeat(weights[angles], 2)])
    start, target = (np.asarray(features(angles, x)) for x in (robot.initial_state, robot.target))
    distance = (start - target) @ (rows * (start - target))
    if not distance > 0:
        raise RobotFileError(f"{robot.path}: [cost] state_weight: the start costs nothing, so there is nothing to "
                             "search; give weights")
    return Task(robot.states, robot.inputs, angles, robot.input_low, robot.input_high, robot.initial_state,
                np.diag(facts["start_sd"]**2 + 1e-6), period_s, max(1, round(seconds / period_s)), target,
                np.diag(rows / (width**2 if width else distance / 16)), physics)
