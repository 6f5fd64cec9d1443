"""Primitives of JAX over the calls of python/bindings/jax.cpp.

Operands have the same number of leading dimensions, of which one of length 1 stands for whatever the others have: that
is how vmap hands on what it does not map, without copies. Values are the kernel's. The derivative is one linear map,

    dz+ = a dz + b du + c dp,    z = (states, effects' states),

with Jacobians a, b, c of each period (slopes) that JAX keeps between forward and backward pass; `push` applies it,
`pull` its transpose, and each is the transpose of the other.
"""
from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from .. import _core
from .._errors import Error

ONE_ORDER = ("tiller.jax has first derivatives: the kernel has no second ones; take jax.jacobian of residuals and "
             "their Gauss-Newton product, or differences of gradients")

NO_DELAY = ("the kernel does not differentiate by commands of the past; leave the effect input_delay out, or shift the "
            "inputs by whole periods in its place")

Array = Any
Tangent = Any


def _lead(cores: tuple[int, ...], avals: tuple[Any, ...]) -> tuple[int, ...]:
    """What the leading dimensions of the operands come to."""
    return np.broadcast_shapes(*(a.shape[:a.ndim - core] for core, a in zip(cores, avals, strict=True)))


def _make(name: str, cores: tuple[int, ...], shapes: Any) -> Primitive:
    """A primitive with a target of the same name. cores: dimensions of a row of each operand. shapes(lead, *operands,
    **settings): of its results."""
    one = Primitive(f"tiller_{name}")
    one.multiple_results = True

    def abstract(*avals: Any, **settings: Any) -> list[Any]:
        lead = _lead(cores, avals)
        return [jax.core.ShapedArray(shape, avals[0].dtype) for shape in shapes(lead, *avals, **settings)]

    def lower(context: Any, *operands: Any, **settings: Any) -> Any:
        attributes = {key: np.int64(value) for key, value in settings.items() if key != "by_params"}
        return jax.ffi.ffi_lowering(f"tiller_{name}")(context, *operands, **attributes)

    def elsewhere(context: Any, *operands: Any, **settings: Any) -> Any:
        raise Error("tiller.jax runs on the processor alone; run under jax.default_device(jax.devices('cpu')[0])",
                    status="wrong_device", remedy="run under jax.default_device(jax.devices('cpu')[0])")

    def batch(operands: Any, dims: Any, **settings: Any) -> Any:
        rows = [jnp.expand_dims(a, 0) if d is None else jnp.moveaxis(a, d, 0)
                for a, d in zip(operands, dims, strict=True)]
        return one.bind(*rows, **settings), [0] * len(shapes((), *operands, **settings))

    jax.ffi.register_ffi_target(f"tiller_{name}", _core.jax_targets()[name], platform="cpu")
    one.def_abstract_eval(abstract)
    one.def_impl(jax.jit(one.bind, static_argnames=("robot", "threads", "by_params")))
    mlir.register_lowering(one, lower, platform="cpu")
    mlir.register_lowering(one, elsewhere)
    batching.primitive_batchers[one] = batch
    return one


rollout_p = _make("rollout", (1, 2, 1, 2), lambda lead, x0, u, *_, **__: [(*lead, u.shape[-2] + 1, x0.shape[-1])])
cost_p = _make("cost", (1, 2, 1, 2), lambda lead, *_, **__: [lead])
cost_slopes_p = _make("cost_slopes", (2, 2, 1), lambda lead, x, u, p, **_: [
    (*lead, *x.shape[-2:]), (*lead, *u.shape[-2:]), (*lead, p.shape[-1])])
push_p = _make("push", (2, 2, 1, 1, 2, 1), lambda lead, x, *_, **__: [(*lead, *x.shape[-2:])])
pull_p = _make("pull", (2, 2, 1, 2), lambda lead, x, u, p, w, by_params, **_: [
    (*lead, x.shape[-1]), (*lead, *u.shape[-2:]), (*lead, p.shape[-1] if by_params else 0)])


# ---- the derivative of values -------------------------------------------------------------------------


def _filled(tangent: Tangent) -> Array:
    return ad.instantiate_zeros(tangent)


def _way_and_tangent(primals: Any, tangents: Any, robot: int, threads: int) -> tuple[Array, Array]:
    """The states and their tangent."""
    x0, u, p, history = primals
    dx0, du, dp, _ = tangents
    if _core.jax_memory(robot)[1]:
        raise Error(f"tiller.jax: a derivative of a robot with an input delay; {NO_DELAY}", status="delayed",
                    remedy=NO_DELAY)
    by_params = not isinstance(dp, ad.Zero)
    states = rollout_p.bind(x0, u, p, history, robot=robot, threads=threads)[0]
    dp = _filled(dp) if by_params else jnp.zeros((*p.shape[:-1], 0), p.dtype)
    return states, push_p.bind(states, u, p, _filled(dx0), _filled(du), dp, robot=robot, threads=threads)[0]


def _rollout_jvp(primals: Any, tangents: Any, **settings: Any) -> Any:
    states, tangent = _way_and_tangent(primals, tangents, **settings)
    return [states], [tangent]


def _cost_jvp(primals: Any, tangents: Any, robot: int, threads: int) -> Any:
    _, u, p, _ = primals
    _, du, dp, _ = tangents
    cost = cost_p.bind(*primals, robot=robot, threads=threads)
    states, dx = _way_and_tangent(primals, tangents, robot, threads)
    by_state, by_control, by_param = cost_slopes_p.bind(states, u, p, robot=robot, threads=threads)
    total = (by_state * dx).sum((-2, -1))
    if not isinstance(du, ad.Zero):
        total = total + (by_control * du).sum((-2, -1))
    if not isinstance(dp, ad.Zero):
        total = total + (by_param * dp).sum(-1)
    return cost, [total]


def _refuse(primals: Any, tangents: Any, **settings: Any) -> Any:
    raise Error(f"tiller.jax: a derivative of a derivative; {ONE_ORDER}", status="second_order", remedy=ONE_ORDER)


ad.primitive_jvps[rollout_p] = _rollout_jvp
ad.primitive_jvps[cost_p] = _cost_jvp
ad.primitive_jvps[cost_slopes_p] = _refuse


# ---- the linear map -----------------------------------------------------------------------------------


def _folded(value: Array, shape: tuple[int, ...]) -> Array:
    """What `value`'s broadcast operand of this shape gets: sums over the dimensions that it has once."""
    axes = tuple(i for i, (have, want) in enumerate(zip(value.shape, shape, strict=True)) if have != want)
    return value.sum(axes, keepdims=True) if axes else value


def _linear_jvp(one: Primitive) -> Any:
    def jvp(primals: Any, tangents: Any, **settings: Any) -> Any:
        if not all(isinstance(t, ad.Zero) for t in tangents[:3]):
            _refuse(primals, tangents)
        moved = one.bind(*primals[:3], *map(_filled, tangents[3:]), **settings)
        return one.bind(*primals, **settings), moved
    return jvp


def _push_transpose(weights: Any, x: Array, u: Array, p: Array, dx0: Any, du: Any, dp: Any, **settings: Any) -> Any:
    (weight,) = weights
    if isinstance(weight, ad.Zero):
        return [None] * 6
    shape = dp.aval.shape if ad.is_undefined_primal(dp) else dp.shape
    back = pull_p.bind(x, u, p, weight, by_params=ad.is_undefined_primal(dp) and shape[-1] > 0, **settings)
    return [None] * 3 + [_folded(value, to.aval.shape) if ad.is_undefined_primal(to) else None
                         for value, to in zip(back, (dx0, du, dp), strict=True)]


def _pull_transpose(weights: Any, x: Array, u: Array, p: Array, w: Any, by_params: bool, **settings: Any) -> Any:
    if all(isinstance(weight, ad.Zero) for weight in weights):
        return [None] * 4
    ahead = push_p.bind(x, u, p, *map(_filled, weights), **settings)[0]
    return [None] * 3 + [_folded(ahead, w.aval.shape)]


ad.primitive_jvps[push_p] = _linear_jvp(push_p)
ad.primitive_jvps[pull_p] = _linear_jvp(pull_p)
ad.primitive_transposes[push_p] = _push_transpose
ad.primitive_transposes[pull_p] = _pull_transpose
