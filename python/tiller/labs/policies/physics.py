"""One period of the robot file's model at its priors' centre, its slope, and the slope's own derivative."""
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import tomlkit

from ... import _core
from ...jax import rollout
from ..robot_text import with_words
from .moments import Array

MOST_SUBSTEPS = 64
Physics = Callable[[Array], tuple[Array, Array]]  # (nx + nu) -> next (nx) and slope (nx, nx + nu)


def _without_delay(text: str) -> str:
    """The kernel does not differentiate by commands of the past."""
    document: Any = tomlkit.parse(text)
    for i in reversed(range(len(document.get("effects", [])))):
        if document["effects"][i]["kind"] == "input_delay":
            del document["effects"][i]
    return tomlkit.dumps(document)


def at_period(robot: _core.Robot, period_s: float) -> _core.Robot:
    """The robot whose control period is the policy's, with finer steps in it."""
    with open(robot.path, encoding="utf-8") as file:
        text = _without_delay(file.read())
    substeps = int(tomlkit.parse(text)["model"].get("substeps", 1))  # type: ignore[union-attr]
    finer = min(MOST_SUBSTEPS, substeps * max(1, math.ceil(period_s / robot.period_s - 1e-9)))
    return _core.Robot.from_text(with_words(text, {"model": {"period_s": period_s, "substeps": finer}}), robot.path)


def physics_of(robot: _core.Robot, period_s: float) -> Physics:
    """z = (x, u) (nx + nu) -> the state a period later and its slope, differentiable in reverse: the kernel has first
    derivatives, and those of the slope are central differences. Effects with a memory begin at rest."""
    coarse, nx = at_period(robot, period_s), len(robot.states)

    def step(z: Array) -> Array:
        return rollout(coarse, z[..., :nx], z[..., None, nx:], threads=1)[..., 1, :]

    @jax.custom_vjp
    def linearised(z: Array) -> tuple[Array, Array]:
        return step(z), jax.jacfwd(step)(z)

    def forward(z: Array) -> tuple[Any, Any]:
        next_state, slope = linearised(z)
        return (next_state, slope), (z, slope)

    def backward(kept: Any, by: Any) -> tuple[Array]:
        z, slope = kept
        h = 1e-4 * (1 + jnp.abs(z))
        moved = jax.vmap(jax.jacfwd(step))(jnp.concatenate([z + jnp.diag(h), z - jnp.diag(h)]))
        bend = (moved[:len(z)] - moved[len(z):]) / (2 * h[:, None, None])
        return (slope.T @ by[0] + jnp.einsum("kij,ij->k", bend, by[1]),)

    linearised.defvjp(forward, backward)
    return linearised
