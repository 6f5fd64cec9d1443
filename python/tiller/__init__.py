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

TYPE_CHECKING = False  # typing's own is not worth the time of its import

from ._about import instruction_set, model_names, version
from ._calls import public_methods as _public_methods
from ._core import Adequacy, Command, Controller, Info, Measurement, Plant, Posterior, Robot, State, Status
from ._errors import (ArgumentError, ArgumentTypeError, CommandError, Error, MissingExtra, RobotFileError, StatusError)
from ._loop import lockstep
from ._paths import prepare as _prepare
from ._rollout import rollout

if TYPE_CHECKING:
    from ._functions import (ExciteResult, GapResult, IdentifyResult, LearnResult, Result, excite, gap, identify, learn)
    from ._robots import robot_names

_prepare()
for _kind in (Command, Controller, Info, Measurement, Plant, Posterior, Robot):
    _public_methods(_kind)

__version__ = "0.2.0"
__all__ = [
    "Adequacy", "ArgumentError", "ArgumentTypeError", "Command", "CommandError", "Controller", "Error",
    "ExciteResult", "GapResult", "IdentifyResult", "Info", "LearnResult", "Measurement", "MissingExtra",
    "Plant", "Posterior", "Result", "Robot", "RobotFileError", "State", "Status", "StatusError", "excite",
    "gap", "identify", "instruction_set", "learn", "lockstep", "model_names", "robot_names", "rollout",
    "version",
]

# Loaded when they are first asked for: an import of tiller is over before those of what they need would be.
_LATER = {"robot_names": ("_robots", "robot_names")} | {name: ("_functions", name) for name in (
    "ExciteResult", "GapResult", "IdentifyResult", "LearnResult", "Result", "excite", "gap", "identify", "learn")}


def __getattr__(name: str) -> object:
    if name not in _LATER:
        raise AttributeError(f"module 'tiller' has no attribute {name!r}")
    from importlib import import_module

    module, original = _LATER[name]
    found: object = getattr(import_module(f".{module}", __name__), original)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})
