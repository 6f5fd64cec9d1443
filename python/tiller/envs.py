"""Gymnasium environments of the simulated plants (extra `gym`):

    import gymnasium, tiller.envs
    env = gymnasium.make("tiller/CartPole-v0")

One environment for each robot that comes with the package and has a plant. An episode is the robot file's task: its
start, its period, its limits; true parameters that [sim] draws are drawn anew by reset(seed=...).
"""
from __future__ import annotations

import tomllib
from typing import Any

try:
    import gymnasium
except ImportError:
    from ._errors import missing_extra

    raise missing_extra("gymnasium", "gym", "tiller.envs") from None

import numpy as np
import numpy.typing as npt

from . import _core
from ._calls import public
from ._errors import make_argument_error
from ._robots import find, names

Array = npt.NDArray[np.float64]


class PlantEnv(gymnasium.Env[Array, Array]):
    """A plant in lockstep.

    observation  (nx) true state, or (ny) what the sensors say where observe="measurement"
    action       (nu) within the limits of the robot file; what lies beyond is cut
    reward       minus the quadratic terms of the task's cost (Robot.stage_cost), of the state after the step
    terminated   the state is not finite any more
    truncated    after `seconds`
    info         "true_params" and "measured": name -> value of what the plant knows and the sensors say; "time_s"; a
                 Controller takes env.unwrapped.plant.measurement
    """

    metadata: dict[str, Any] = {"render_modes": []}

    @public
    def __init__(self, robot: str | _core.Robot = "cart_pole", seconds: float = 8.0, observe: str = "state",
                 render_mode: str | None = None) -> None:
        if observe not in ("state", "measurement"):
            raise make_argument_error("PlantEnv", "observe", repr(observe), '"state" or "measurement"',
                                      "pass one of them", False)
        if not (isinstance(seconds, (int, float)) and 0 < seconds < np.inf):
            raise make_argument_error("PlantEnv", "seconds", repr(seconds), "a positive number of seconds",
                                      "pass e.g. 8.0", False)
        if render_mode is not None:
            raise make_argument_error("PlantEnv", "render_mode", repr(render_mode), "None",
                                      "draw pages with `tiller run --report`", False)
        self.robot = robot if isinstance(robot, _core.Robot) else _core.Robot.from_toml(find(robot))
        self.render_mode = render_mode
        self._observe = observe
        self._steps = max(1, round(seconds / self.robot.period_s))
        self._step = 0
        self._plant = _core.Plant(self.robot)
        count = len(self.robot.states if observe == "state" else self.robot.measurements)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (count,), np.float64)
        self.action_space = gymnasium.spaces.Box(self.robot.input_low.copy(), self.robot.input_high.copy(),
                                                 dtype=np.float64)

    @property
    def plant(self) -> _core.Plant:
        """The plant of the present episode, for a Controller of one's own."""
        return self._plant

    def _observation(self) -> Array:
        seen = self._plant.true_state if self._observe == "state" else self._plant.measurement.y.copy()
        return np.nan_to_num(seen, nan=0.0)

    def _info(self) -> dict[str, Any]:
        return {"true_params": _known(self.robot.params, self._plant.true_params),
                "measured": _known(self.robot.measurements, self._plant.measurement.y), "time_s": self._plant.time_s}

    @public
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self._plant = _core.Plant(self.robot, seed=int(self.np_random.integers(1, 2**31)))
        self._step = 0
        return self._observation(), self._info()

    @public
    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        given, shape = np.asarray(action, dtype=np.float64), self.robot.input_low.shape
        if given.shape != shape:
            raise make_argument_error("PlantEnv.step", "action", f"an array of shape {given.shape}", f"shape {shape}",
                                      "pass a number for each of " + ", ".join(self.robot.inputs), False)
        command = np.clip(given, self.robot.input_low, self.robot.input_high)
        self._plant.step(command)
        self._step += 1
        state = self._plant.true_state
        known = np.where(np.isnan(state), self.robot.target, state)
        reward = -self.robot.stage_cost(known, command, self._step)
        terminated = bool(not np.isfinite(self._observation()).all())
        return self._observation(), reward, terminated, self._step >= self._steps, self._info()


def _known(names: list[str], values: Array) -> dict[str, float]:
    """Of numbers among which NaN says that there is none."""
    return {name: float(value) for name, value in zip(names, values) if not np.isnan(value)}


def _with_plant() -> dict[str, str]:
    """identifier -> robot, of the robot files that have a plant."""
    found = {}
    for name in names():
        with open(find(name), "rb") as file:
            if tomllib.load(file).get("sim", {}).get("plant"):
                found[f"tiller/{''.join(word.capitalize() for word in name.split('_'))}-v0"] = name
    return found


@public
def environment_names() -> list[str]:
    """Identifiers of the environments, "tiller/CartPole-v0", ..."""
    return sorted(_with_plant())


def _register() -> None:
    for identifier, name in _with_plant().items():
        if identifier not in gymnasium.registry:
            gymnasium.register(id=identifier, entry_point="tiller.envs:PlantEnv", kwargs={"robot": name})


_register()
