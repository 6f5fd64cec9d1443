"""rollout(), step() and cost() over the primitives: arguments, shapes and what is refused."""
from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import _core
from .._calls import public
from .._errors import make_argument_error
from ._primitives import Array, cost_p, rollout_p

Params = Any  # an array, a dictionary of names, or None


def _robot(function: str, robot: object) -> _core.Robot:
    if not isinstance(robot, _core.Robot):
        raise make_argument_error(function, "robot", f"{robot!r:.60}", "a tiller.Robot",
                                  "pass tiller.Robot.from_toml(...)", True)
    return robot


def _array(function: str, name: str, value: object, core: str, names: list[str]) -> Array:
    """`value`, whose last dimensions are `core`, of which the last is as long as `names`."""
    what = f"shape (..., {core}) with {core.split(', ')[-1]} = {len(names)} ({', '.join(names)})"
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError):
        raise make_argument_error(function, name, f"{value!r:.60}", f"numbers of {what}",
                                  "pass an array of real numbers", True) from None
    if array.dtype.kind not in "iu" and array.dtype not in (jnp.float32, jnp.float64):
        raise make_argument_error(function, name, f"an array of {array.dtype}", "float64 or float32",
                                  f"pass {name}.astype('float32'): the kernel has these two", True)
    if array.ndim < core.count(",") + 1 or array.shape[-1] != len(names):
        raise make_argument_error(function, name, f"an array of shape {array.shape}", what,
                                  "pass rows in the order of Robot.states, inputs or params", False)
    return array


def _params(function: str, robot: _core.Robot, params: Params) -> Array:
    """(..., np) of an array, or of a dictionary's names and the prior's centre for the others."""
    names = robot.params
    if params is None:
        return jnp.asarray(robot.prior_centre, _widest([]))
    if not isinstance(params, Mapping):
        return _array(function, "params", params, "np", names)
    unknown = [name for name in params if name not in names]
    if unknown:
        raise make_argument_error(function, "params", f"a dictionary with {unknown[0]!r}",
                                  f"names of {', '.join(names)}", "pass names of Robot.params", False)
    given = {name: jnp.asarray(value) for name, value in params.items()}
    dtype = _widest(list(given.values()))
    centre = dict(zip(names, robot.prior_centre, strict=True))
    rows = jnp.broadcast_arrays(*(given[n].astype(dtype) if n in given else jnp.asarray(centre[n], dtype)
                                  for n in names))
    return jnp.stack(rows, -1)


def _widest(arrays: list[Array]) -> Any:
    """The type that all are taken to: of the numbers with a point, JAX's own where there are none."""
    floats = [a for a in arrays if a.dtype.kind == "f"]
    return jnp.result_type(*floats) if floats else jnp.result_type(float)


def _history(function: str, robot: _core.Robot, history: object, dtype: Any) -> Array:
    rows = _core.history_rows(robot)
    shape = (rows, len(robot.inputs))
    if history is None:
        return jnp.zeros(shape, dtype)
    given = jnp.asarray(history)
    if given.shape != shape:
        raise make_argument_error(function, "history", f"an array of shape {given.shape}", f"shape {shape}",
                                  "pass the commands before the first, newest first", False)
    return given.astype(dtype)


def _threads(function: str, threads: object) -> int:
    if threads is None:
        return min(256, len(os.sched_getaffinity(0)))
    if not isinstance(threads, int) or not 1 <= threads <= 256:
        raise make_argument_error(function, "threads", repr(threads), "1 to 256, or None", "pass None", False)
    return threads


def _call(function: str, primitive: Any, robot: _core.Robot, x0: object, u: object, params: Params, history: object,
          threads: object) -> Array:
    _robot(function, robot)
    state = _array(function, "x0", x0, "nx", robot.states)
    controls = _array(function, "u", u, "H, nu", robot.inputs)
    values = _params(function, robot, params)
    if controls.shape[-2] < 1:
        raise make_argument_error(function, "u", f"an array of shape {controls.shape}", "one step at least",
                                  "pass a row for each period", False)
    leads = {"x0": state.shape[:-1], "u": controls.shape[:-2], "params": values.shape[:-1]}
    try:
        rank = len(np.broadcast_shapes(*leads.values()))
    except ValueError:
        name = max(leads, key=lambda n: len(leads[n]))
        raise make_argument_error(function, name, f"an array with leading dimensions {leads[name]}",
                                  f"leading dimensions that broadcast with the others' ({leads})",
                                  "pass the same leading dimensions, or none for one row for all", False) from None
    # what the prior's centre is kept in does not widen what was passed
    dtype = _widest([state, controls] if params is None else [state, controls, values])
    rows = [jnp.reshape(a, (1,) * (rank - len(lead)) + a.shape).astype(dtype)
            for a, lead in zip((state, controls, values), leads.values(), strict=True)]
    out: Array = primitive.bind(*rows, _history(function, robot, history, dtype), robot=_core.jax_number(robot),
                                threads=_threads(function, threads))[0]
    return out


@public
def rollout(robot: _core.Robot, x0: Array, u: Array, params: Params = None, *, history: Array | None = None,
            threads: int | None = None) -> Array:
    """Trajectories of the robot's model, effects included, under open-loop inputs: tiller.rollout for JAX.

    x0       (..., nx) start states
    u        (..., H, nu) inputs, each held for Robot.period_s
    params   (..., np) in the order of Robot.params; or {name: value (...)}, the others at Robot.prior_centre; or None
    history  (rows, nu) commands before the first, newest first, where the robot has an input delay; None: zeros
    threads  None: as many as this process has processors

    Returns (..., H + 1, nx), the start states first. Leading dimensions broadcast. float64 (jax_enable_x64) or float32,
    whichever the arguments have; the values are those of tiller.rollout, to the last bit. Differentiable once, forward
    and backward, by x0, u and params; derivatives are computed in double.
    """
    return _call("tiller.jax.rollout", rollout_p, robot, x0, u, params, history, threads)


@public
def cost(robot: _core.Robot, x0: Array, u: Array, params: Params = None, *, history: Array | None = None,
         threads: int | None = None) -> Array:
    """The cost (...) of the robot's task along rollout(robot, x0, u, params), every term of [cost], from step 0 on."""
    return _call("tiller.jax.cost", cost_p, robot, x0, u, params, history, threads)


@public
def step(robot: _core.Robot, x: Array, u: Array, params: Params = None, *, threads: int | None = None) -> Array:
    """The state (..., nx) a period after x (..., nx) under the input u (..., nu); params as in rollout().

    For lax.scan and policies. A robot with effects that remember (lag, delay, backlash) has no such function: its next
    state depends on more than these.
    """
    name = "tiller.jax.step"
    remembered = sum(_core.jax_memory(_core.jax_number(_robot(name, robot))))
    if remembered:
        raise make_argument_error(name, "robot", f"{robot!r} with {remembered} numbers that its effects remember",
                                  "effects without memory", "use tiller.jax.rollout, which begins them at rest", False)
    control = _array(name, "u", u, "nu", robot.inputs)
    state = _array(name, "x", x, "nx", robot.states)
    return _call(name, rollout_p, robot, state, control[..., None, :], params, None, threads)[..., 1, :]
