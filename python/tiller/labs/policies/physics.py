"""One period of the robot file's model, its slope, the slope's own derivative, and parameters that fit transitions."""
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tomlkit

from ... import _core
from ...jax import rollout
from ..robot_text import with_words
from .minimise import Numbers
from .moments import Array

MOST_SUBSTEPS = 64
Physics = Callable[[Array], tuple[Array, Array]]  # (nx + nu) -> next (nx) and slope (nx, nx + nu)


class Family(NamedTuple):
    """A model at any parameters (np), and those that fit transitions (N, 2 nx + nu)."""
    physics: Callable[[Any], Physics]
    fit: Callable[[Numbers], Any]
    first: Any


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
    substeps = int(tomlkit.parse(text)["model"].get("substeps", 1))
    finer = min(MOST_SUBSTEPS, substeps * max(1, math.ceil(period_s / robot.period_s - 1e-9)))
    return _core.Robot.from_text(with_words(text, {"model": {"period_s": period_s, "substeps": finer}}), robot.path)


class Model:
    """The robot file's model at the policy's period; compiled once."""

    def __init__(self, robot: _core.Robot, period_s: float) -> None:
        coarse, self._robot, self._nx = at_period(robot, period_s), robot, len(robot.states)
        nx = self._nx

        def step(z: Array, params: Array) -> Array:
            return rollout(coarse, z[:nx], z[None, nx:], params, threads=1)[1]

        self.step = step  # of states and commands (nx + nu), and parameters (np)
        many = lambda f: jax.vmap(f, (0, None))
        self.expand = jax.jit(lambda z, params: (
            many(step)(z, params), many(jax.jacfwd(step, 0))(z, params), many(jax.jacfwd(step, 1))(z, params)))

    def physics(self, params: Numbers | None = None) -> Physics:
        """z = (x, u) (nx + nu) -> the state a period later and its slope, differentiable in reverse: the kernel has
        first derivatives, and those of the slope are central differences. Effects with a memory begin at rest. params
        (np); None: the priors' centre."""
        params = jnp.asarray(self._robot.prior_centre if params is None else params)
        step = lambda z: self.step(z, params)

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

    def fit(self, rows: Numbers, variance: Numbers, iterations: int = 6) -> Numbers:
        """(np) parameters of the largest posterior of transitions: rows (N, nx + nu + nx) of states, commands and next
        states, measured with `variance` (nx). Gauss-Newton from the priors' moments, each taken for a normal one; a
        transition's error has the measurements' covariance, that before it through the slope (errors in variables)."""
        nx, draws = self._nx, _core.draw_params(self._robot, 1, 512)
        centre, sd = draws.mean(0), draws.std(0)
        bounds = [(p.get("low", -np.inf), p.get("high", np.inf)) for p in self._robot.priors.values()]
        low, high = np.array(bounds, float).reshape(-1, 2).T
        free = np.flatnonzero(np.ptp(draws, axis=0) > 0)
        now, best, least = centre.copy(), centre, np.inf
        for _ in range(iterations if free.size else 0):
            value, slope, by = (np.asarray(a, float) for a in self.expand(rows[:, :-nx], now))
            slope = slope[:, :, :nx]
            noise = np.einsum("nij,j,nkj->nik", slope, variance, slope) + np.diag(variance + 1e-12)
            off, by = rows[:, -nx:] - value, by[:, :, free] * sd[free]
            sharp = np.linalg.solve(noise, np.concatenate([by, off[:, :, None]], 2))
            share = (now - centre)[free] / sd[free]
            surprise = float((off * sharp[:, :, -1]).sum() + np.linalg.slogdet(noise)[1].sum() + share @ share)
            if surprise < least:
                best, least = now.copy(), surprise
            bend = np.einsum("nia,nib->ab", by, sharp[:, :, :-1]) + np.eye(free.size)
            move = np.linalg.solve(bend, np.einsum("nia,ni->a", by, sharp[:, :, -1]) - share)
            now[free] = np.clip(now[free] + sd[free] * np.clip(move, -1, 1), low[free], high[free])
        return best
