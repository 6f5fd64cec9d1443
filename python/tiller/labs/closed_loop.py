"""An episode of a whole controller, posterior and all, in lockstep with the plant of [sim]."""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .. import _core
from .._errors import Error


@dataclass
class Outcome:
    score: float  # the return: minus the mean stage cost; -infinity: the state was not finite
    safe: bool  # the controller latched SAFE


def play(robot: _core.Robot, judge: _core.Robot, seconds: float, seed: int,
         params: npt.NDArray[np.float64] | None = None) -> Outcome:
    """As `tiller run --sim --seed SEED` has it, by the stage cost of `judge` at the true states: a task that is made
    easier is no better controller. SAFE does not end an episode: the safe command's cost counts. `params`: true ones.
    """
    controller, plant = _core.Controller(robot, seed=seed), _core.Plant(robot, seed, params)
    armed, first, ticks, total = False, None, 0, 0.0
    while plant.time_s < seconds - 1e-9:
        armed = armed or _arm(controller)
        measurement = plant.measurement
        command = controller.tick(measurement.t, measurement)
        info, truth = controller.info, plant.true_state
        moves = info.state in (_core.State.ACTIVE, _core.State.HOLD)
        first = (first if first is not None else ticks) if moves else None  # the task begins again after a pause
        x = np.where(np.isnan(truth), info.state_mean, truth)
        if not np.isfinite(x).all():
            return Outcome(-math.inf, info.state == _core.State.SAFE)
        total += judge.stage_cost(x, command.value, ticks - first if first is not None else 0, info.param_mean)
        plant.step(command)
        controller.prepare()
        ticks += 1
    return Outcome(-total / ticks if math.isfinite(total) else -math.inf, controller.info.state == _core.State.SAFE)


def _arm(controller: _core.Controller) -> bool:
    try:
        controller.arm()
    except Error:  # before the first measurement
        return False
    return True
