"""Trials on the plant of [sim], each from a fresh start."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ... import _core
from ..._errors import RobotFileError
from ..robot_text import with_words
from .minimise import Numbers

Controller = Callable[[Numbers, int], Numbers]  # the command (nu) for what is measured (nx) at period k


class Trial(NamedTuple):
    """What one run of the plant left."""
    measured: Numbers  # (periods + 1, nx), with the sensors' noise
    truth: Numbers  # (periods + 1, nx)
    command: Numbers  # (periods, nu)


RunTrial = Callable[[Controller, int], Trial]  # with the trial's index: of its own noise and start


def measured_deviation(robot: _core.Robot, period_s: float) -> Numbers:
    """(nx) of what is measured of each state: that of [sim] where a sensor is, and of a rate that of the difference
    quotient of its position, sqrt(2) sd / period."""
    facts = _core.training_facts(robot)
    sd = np.array(facts["sensor_sd"])
    for position, velocity in facts["joints"]:
        if sd[velocity] == 0:
            sd[velocity] = np.sqrt(2) * sd[position] / period_s
    return sd


class PlantTrials:
    """The plant itself is the same in all trials: what [sim] draws is drawn once, by plant_seed or the
    file's seed."""

    def __init__(self, robot: _core.Robot, period_s: float, horizon: int, noise_sd: Numbers, start_mean: Numbers,
                 start_covariance: Numbers, seed: int, stream: int = 0,
                 plant_seed: int | None = None) -> None:
        self._robot, self._period_s, self._horizon, self._noise_sd = robot, period_s, horizon, noise_sd
        self._start, self._spread = start_mean, np.linalg.cholesky(start_covariance + 1e-18 * np.eye(len(start_mean)))
        self._seed = [seed, 92, stream]
        with open(robot.path, encoding="utf-8") as file:
            self._text = file.read()
        self._params = np.array(_core.Plant(robot, plant_seed).true_params)

    def _plant(self, start: Numbers, seed: int) -> _core.Plant:
        named = {name: float(v) for name, v in zip(self._robot.states, start, strict=True)}
        text = with_words(self._text, {"model": {"period_s": self._period_s}, "start": {"state": named},
                                       "sim": {"watchdog_s": 0.0}})
        return _core.Plant(_core.Robot.from_text(text, self._robot.path), seed, self._params)

    def __call__(self, controller: Controller, index: int) -> Trial:
        """Raises RobotFileError where the plant does not show every state."""
        rng = np.random.default_rng([*self._seed, index])
        nx, nu = len(self._start), len(self._robot.inputs)
        plant = self._plant(self._start + self._spread @ rng.standard_normal(nx), int(rng.integers(1, 1 << 40)))
        rows = self._horizon + 1
        trial = Trial(np.empty((rows, nx)), np.empty((rows, nx)), np.empty((self._horizon, nu)))
        for k in range(self._horizon + 1):
            trial.truth[k] = plant.true_state
            trial.measured[k] = trial.truth[k] + self._noise_sd * rng.standard_normal(nx)
            if k < self._horizon:
                trial.command[k] = controller(trial.measured[k], k)
                plant.step(trial.command[k])
        if not np.isfinite(trial.truth).all():
            raise RobotFileError(f"{self._robot.path}: the plant's state is not finite, or it has not all states of "
                                 "the model; a policy needs all: choose another [sim] plant")
        return trial


def random_controller(low: Numbers, high: Numbers, seed: int, index: int) -> Controller:
    """Commands drawn evenly between the limits, anew in each period."""
    rng = np.random.default_rng([seed, 93, index])
    return lambda measured, k: low + (high - low) * rng.random(len(low))
