"""tiller: model predictive control of robots whose model is only partly known, with a posterior over its parameters.

    robot = tiller.Robot.from_toml("pendulum")
    controller = tiller.Controller(robot)
    plant = tiller.Plant(robot)
    controller.arm()
    for measurement in tiller.lockstep(plant, seconds=8):
        command = controller.tick(measurement.t, measurement)
        plant.step(command)
    print(dict(zip(robot.params, controller.posterior.mean)))

The guide is docs/guide/python.md.
"""
from __future__ import annotations

from . import _core
from ._core import (Adequacy, Command, Controller, Info, Measurement, Plant, Posterior, Robot, State, Status,
                    instruction_set, model_names, version)
from ._errors import (ArgumentError, ArgumentTypeError, CommandError, Error, MissingExtra, RobotFileError, StatusError)
from ._functions import (ExciteResult, GapResult, IdentifyResult, LearnResult, Result, excite, gap, identify, learn)
from ._loop import lockstep
from ._paths import prepare as _prepare
from ._robots import names as robot_names
from ._rollout import rollout

_prepare()

__version__ = "0.1.0"
__all__ = [
    "Adequacy", "ArgumentError", "ArgumentTypeError", "Command", "CommandError", "Controller", "Error", "ExciteResult",
    "GapResult", "IdentifyResult", "Info", "LearnResult", "Measurement", "MissingExtra", "Plant", "Posterior", "Result",
    "Robot", "RobotFileError", "State", "Status", "StatusError", "excite", "gap", "identify", "instruction_set", "learn",
    "lockstep", "model_names", "robot_names", "rollout", "version",
]
