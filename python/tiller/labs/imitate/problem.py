"""What is learnt from: a robot, and demonstrations as `tiller data imitate` writes them."""
from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]
Array = Any  # of JAX, which has no types here


class ImitationError(Exception):
    """Nothing can be learnt; a sentence for the user."""


@dataclass
class Motion:
    """States (T + 1, nx) under inputs (T, nu)."""
    states: Numbers
    inputs: Numbers

    @property
    def steps(self) -> int:
        return len(self.inputs)


@dataclass
class Demonstration:
    """A stretch of a log: as measured, and as the model explains it."""
    path: str
    first_time_s: float
    misfit: float  # RMS of the model's prediction errors, in their own deviations
    measured: dict[str, list[float | None]]
    motion: Motion
    limited: float = 0.0  # share of the inputs that are at a limit


@dataclass(frozen=True)
class Scene:
    """A robot's model and limits. step(x (.., nx), u (.., nu)) is the state a period later, a function of JAX."""
    step: Callable[[Array, Array], Array]
    angles: npt.NDArray[np.bool_]  # (nx)
    low: Numbers                   # (nu) limits of the inputs, and of their change in a period
    high: Numbers
    most_change: Numbers

    @property
    def nx(self) -> int:
        return len(self.angles)

    @property
    def nu(self) -> int:
        return len(self.low)

    def difference(self, a: Any, b: Any) -> Array:
        """a - b, angles wrapped."""
        d = jnp.asarray(a) - b
        return jnp.where(self.angles, jnp.mod(d + jnp.pi, 2 * jnp.pi) - jnp.pi, d)


@dataclass
class Problem:
    """A robot file and what was demonstrated on it."""
    text: str  # of the robot file
    path: str
    name: str
    states: list[str]
    inputs: list[str]
    units: dict[str, str]
    planner: str
    horizon: int
    period_s: float
    rate_weight: Numbers  # (nu) [cost] input_rate_weight
    timed: bool           # the cost depends on the time since the task began
    seen: list[str]       # what a policy reads, by the names of docs/reference/networks.md
    scene: Scene
    demonstrations: list[Demonstration]
    warnings: list[str] = field(default_factory=list)


def _numbers(values: list[float | None]) -> Numbers:
    return np.array([np.inf if v is None else v for v in values], float)


def _scene(robot: Any, document: dict[str, Any]) -> Scene:
    import tiller.jax

    def step(x: Array, u: Array) -> Array:
        return tiller.jax.step(robot, x, u, threads=1)

    high = _numbers(document["input_high"])
    low = -_numbers([None if v is None else -v for v in document["input_low"]])
    return Scene(step, np.array(document["angles"], bool), low, high, _numbers(document["most_change"]))


def _demonstration(given: dict[str, Any]) -> Demonstration:
    motion = Motion(np.array(given["states"], float), np.array(given["inputs"], float))
    return Demonstration(given["path"], given["first_time_s"], given["misfit"], given["measured"], motion)


def read_problem(path: Path, robot_path: str) -> Problem:
    """`path`: what `tiller data imitate` wrote of the robot file."""
    import tiller

    document = json.loads(path.read_text(encoding="utf-8"))
    text = Path(robot_path).read_text(encoding="utf-8")
    robot = tiller.Robot.from_toml(robot_path)
    return Problem(text, robot_path, document["robot"], document["states"], document["inputs"], document["units"],
                   document["planner"], document["horizon"], document["period_s"],
                   np.array(document["input_rate_weight"], float), document["timed"], document["policy_inputs"],
                   _scene(robot, document), [_demonstration(d) for d in document["demonstrations"]],
                   document["warnings"])
