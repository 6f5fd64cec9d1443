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


def _size(aval: Any, axis: int) -> int:
    return int(aval.shape[axis])


def _nz(x: Any, robot: int) -> int:
    return _size(x, -1) + _core.effect_state_count(robot)


rollout_p = _make("rollout", (1, 2, 1, 2), lambda lead, x0, u, p, history, **_: [
    (*lead, _size(u, -2) + 1, _size(x0, -1))])
cost_p = _make("cost", (1, 2, 1, 2), lambda lead, *_, **__: [lead])
slopes_p = _make("slopes", (2, 2, 1), lambda lead, x, u, p, robot, by_params, **_: [
    (*lead, _size(u, -2), _nz(x, robot), width) for width in (
        _nz(x, robot), _size(u, -1), _size(p, -1) if by_params else 0)])
cost_slopes_p = _make("cost_slopes", (2, 2, 1), lambda lead, x, u, p, **_: [
    (*lead, *x.shape[-2:]), (*lead, *u.shape[-2:]), (*lead, _size(p, -1))])
push_p = _make("push", (3, 3, 3, 1, 2, 1), lambda lead, a, b, c, x, *_, **__: [
    (*lead, _size(a, -3) + 1, _size(x, -1))])
pull_p = _make("pull", (3, 3, 3, 2), lambda lead, a, b, c, w, **_: [
    (*lead, _size(w, -1)), (*lead, _size(a, -3), _size(b, -1)), (*lead, _size(c, -1))])


# ---- the derivative of values -------------------------------------------------------------------------


def _filled(tangent: Tangent) -> Array:
    return ad.instantiate_zeros(tangent)


def _way_and_tangent(primals: Any, tangents: Any, robot: int, threads: int) -> tuple[Array, Array]:
    """The states and their tangent."""
    x0, u, p, history = primals
    dx0, du, dp, _ = tangents
    by_params = not isinstance(dp, ad.Zero)
    states = rollout_p.bind(x0, u, p, history, robot=robot, threads=threads)[0]
    a, b, c = slopes_p.bind(states, u, p, robot=robot, threads=threads, by_params=by_params)
    dp = _filled(dp) if by_params else jnp.zeros((*p.shape[:-1], 0), p.dtype)
    return states, push_p.bind(a, b, c, _filled(dx0), _filled(du), dp, threads=threads)[0]


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
ad.primitive_jvps[slopes_p] = _refuse
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


def _push_transpose(weights: Any, a: Array, b: Array, c: Array, dx0: Any, du: Any, dp: Any, threads: int) -> Any:
    (weight,) = weights
    if isinstance(weight, ad.Zero):
        return [None] * 6
    back = pull_p.bind(a, b, c, weight, threads=threads)
    return [None] * 3 + [_folded(value, x.aval.shape) if ad.is_undefined_primal(x) else None
                         for value, x in zip(back, (dx0, du, dp), strict=True)]


def _pull_transpose(weights: Any, a: Array, b: Array, c: Array, w: Any, threads: int) -> Any:
    if all(isinstance(weight, ad.Zero) for weight in weights):
        return [None] * 4
    ahead = push_p.bind(a, b, c, *map(_filled, weights), threads=threads)[0]
    return [None] * 3 + [_folded(ahead, w.aval.shape)]


ad.primitive_jvps[push_p] = _linear_jvp(push_p)
ad.primitive_jvps[pull_p] = _linear_jvp(pull_p)
ad.primitive_transposes[push_p] = _push_transpose
ad.primitive_transposes[pull_p] = _pull_transpose
