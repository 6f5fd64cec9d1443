"""A motion to second order: the model's slopes, the cost's groups, and which inputs are at limits."""
from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from .cost import Cost, ends, stages
from .expansion import FREE, GIVEN, HIGH, LOW, Array, Expansion
from .problem import Scene

AT_LIMIT = 1e-3  # an input that is this share of its range from a limit counts as at it


def sides(scene: Scene, inputs: Array, before: Array, share: float) -> Array:
    """(T, nu) of LOW, FREE, HIGH: limits of the inputs, and of their change in a period."""
    low, high = jnp.asarray(scene.low), jnp.asarray(scene.high)
    near = jnp.where(jnp.isfinite(high - low), share * (high - low), 0.0)
    earlier = jnp.concatenate([before[None], inputs[:-1]])
    low, high = jnp.maximum(low, earlier - scene.most_change), jnp.minimum(high, earlier + scene.most_change)
    return jnp.where(inputs <= low + near, LOW, jnp.where(inputs >= high - near, HIGH, FREE))


def _spread(a: Array, places: np.ndarray, size: int, axes: int) -> Array:
    out = jnp.zeros((*a.shape[:a.ndim - axes], *(size,) * axes))
    return out.at[..., places].set(a) if axes == 1 else out.at[..., places[:, None], places].set(a)


def _with_rates(gradient: Array, hessian: Array, rate: Array, change: Array, nx: int) -> tuple[Array, Array]:
    """Adds S (u - u before)^2, its slopes and curvatures, to groups over (x, input before, u)."""
    nu = rate.shape[-1]
    before, now = np.arange(nx, nx + nu), np.arange(nx + nu, nx + 2 * nu)
    slope, bend = 2 * rate[:, None, :] * change, 2 * rate[:, None, :]
    gradient = gradient.at[..., now].add(slope).at[..., before].add(-slope)
    for rows, columns, sign in ((now, now, 1), (before, before, 1), (now, before, -1), (before, now, -1)):
        hessian = hessian.at[..., rows, columns].add(sign * bend)
    return gradient, hessian


def _targets(e: Expansion, targets: Sequence[int]) -> Expansion:
    """For each target two groups more, of its stages and of the end: w (d - s)^2 = w d^2 - 2 w s d + const."""
    for state in targets:
        linear = jnp.zeros_like(e.gradient[:1]).at[..., state].set(-2.0)
        end = jnp.zeros_like(e.end_gradient[:1]).at[..., state].set(-2.0)
        flat, end_flat = jnp.zeros_like(e.hessian[:2]), jnp.zeros_like(e.end_hessian[:2])
        e = e._replace(
            gradient=jnp.concatenate([e.gradient, linear, jnp.zeros_like(linear)]),
            hessian=jnp.concatenate([e.hessian, flat]),
            end_gradient=jnp.concatenate([e.end_gradient, jnp.zeros_like(end), end]),
            end_hessian=jnp.concatenate([e.end_hessian, end_flat]))
    return e


def expand(scene: Scene, cost: Cost, states: Array, inputs: Array, before: Array | None = None,
           targets: Sequence[int] = (), share: float = AT_LIMIT) -> Expansion:
    """`before` (nu) is the input in force before the first. None: nothing is known of it, and where changes cost the
    first input is given, for it depends on what is not known."""
    states, inputs = jnp.asarray(states), jnp.asarray(inputs)
    nx, nu, rates = scene.nx, scene.nu, cost.has_rates
    n = nx + (nu if rates else 0)
    places = np.concatenate([np.arange(nx), np.arange(n, n + nu)])
    earlier = inputs[0] if before is None else before
    by_x, by_u = jax.vmap(jax.jacfwd(scene.step, (0, 1)))(states[:-1], inputs)
    defect = scene.difference(scene.step(states[:-1], inputs), states[1:])
    gradient, hessian = stages(cost, states, inputs)
    gradient, hessian = _spread(gradient, places, n + nu, 1), _spread(hessian, places, n + nu, 2)
    end_gradient, end_hessian = ends(cost, states)
    slope = jnp.zeros((len(inputs), n, n + nu)).at[:, :nx, :nx].set(by_x).at[:, :nx, n:].set(by_u)
    if rates:
        change = jnp.diff(jnp.concatenate([earlier[None], inputs]), axis=0)
        gradient, hessian = _with_rates(gradient, hessian, jnp.asarray(cost.rate), change, nx)
        slope = slope.at[:, nx:, n:].set(jnp.eye(nu))
    side = sides(scene, inputs, earlier, share)
    if rates and before is None:
        side = side.at[0].set(GIVEN)
    size = np.arange(nx)
    e = Expansion(slope, jnp.pad(defect, ((0, 0), (0, n - nx))), gradient, hessian,
                  _spread(end_gradient, size, n, 1), _spread(end_hessian, size, n, 2), side)
    return _targets(e, targets)
