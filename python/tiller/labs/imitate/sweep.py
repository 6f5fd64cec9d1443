"""The Riccati sweep: the policy of maximum entropy along motions, and the likelihood of what was done.

With cost c the policy of maximum entropy is p(u | x) ~ exp(-Q(x, u)), Q the cost of u now and of the best from then
on. To second order it is Gaussian: covariance Quu^-1, mean -Quu^-1 Qu from the demonstrated input. The product over a
motion that follows the model is Levine and Koltun (ICML 2012), equation 5.
"""
from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.stats import norm

from .expansion import FREE, GIVEN, HIGH, LOW, Array, Expansion, Windows

HALF_LOG_2PI = 0.9189385332046727


class Periods(NamedTuple):
    """The policy of each period of each window; leading dimensions (longest, windows)."""
    wish: Array       # (.., nu) mean input minus the demonstrated one, of free inputs
    gain: Array       # (.., nu, n)
    curvature: Array  # (.., nu, nu) Quu, the identity for inputs that are not free
    pressed: Array    # (.., nu) log probability that a limited input wants beyond its limit
    free: Array       # (.., nu)
    limited: Array    # (.., nu)
    bend: Array       # (.., nu) curvature along a limited input, one for others
    beyond: Array     # (.., nu) how far beyond its limit such an input is wanted, in deviations of maximum entropy


def cholesky(a: Array) -> Array:
    """Of small matrices side by side, written out: LAPACK takes them one by one. NaN where there is none."""
    n = a.shape[-1]
    rows: list[list[Array]] = []
    for i in range(n):
        row: list[Array] = []
        for j in range(i + 1):
            rest = a[..., i, j] - sum((row[k] * (row if i == j else rows[j])[k] for k in range(j)), jnp.zeros(()))
            row.append(jnp.sqrt(rest) if i == j else rest / rows[j][j])
        rows.append(row)
    zero = jnp.zeros_like(a[..., 0, 0])
    return jnp.stack([jnp.stack(row + [zero] * (n - len(row)), -1) for row in rows], -2)


def solve_lower(root: Array, b: Array) -> Array:
    """root^-1 b for b (.., n, columns)."""
    out: list[Array] = []
    for i in range(root.shape[-1]):
        rest = b[..., i, :] - sum((root[..., i, k, None] * out[k] for k in range(i)), jnp.zeros(()))
        out.append(rest / root[..., i, i, None])
    return jnp.stack(out, -2)


def solve(root: Array, b: Array) -> Array:
    """(root root')^-1 b for b (.., n, columns)."""
    half, n = solve_lower(root, b), root.shape[-1]
    out: list[Array] = [half[..., 0, :]] * n
    for i in reversed(range(n)):
        rest = half[..., i, :] - sum((root[..., k, i, None] * out[k] for k in range(i + 1, n)), jnp.zeros(()))
        out[i] = rest / root[..., i, i, None]
    return jnp.stack(out, -2)


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _period(q1: Array, q2: Array, side: Array, n: int, planning: bool) -> Periods:
    nu = side.shape[-1]
    pressing = (side == HIGH) | (side == LOW)
    free = side == FREE
    if planning:  # an input at a limit whose cost falls away from there may leave it
        free = free | (pressing & (side * q1[..., n:] > 0))
    both = free[..., :, None] & free[..., None, :]
    curvature = jnp.where(both, q2[..., n:, n:], jnp.eye(nu))
    root = cholesky(curvature)
    wish = -solve(root, (q1[..., n:] * free)[..., None])[..., 0]
    gain = -solve(root, q2[..., n:, :n] * free[..., None])
    # a limited input, given the other limited ones where they are and the free ones at their best
    along = jnp.eye(nu) - solve(root, q2[..., n:, n:] * (free[..., :, None] & ~free[..., None, :]))
    slope = jnp.einsum("...ij,...i->...j", along, q1[..., n:] + _times(q2[..., n:, n:], wish))
    bend = jnp.einsum("...ij,...ik,...kj->...j", along, q2[..., n:, n:], along)
    limited = ~free & (side != GIVEN)
    bend = jnp.where(limited, bend, 1.0)
    beyond = jnp.where(limited, -side * slope / jnp.sqrt(bend), 0.0)
    return Periods(wish, gain, curvature, _log_mass(beyond, limited), free, limited, bend, beyond)


def _log_mass(beyond: Array, limited: Array) -> Array:
    return jnp.where(limited, norm.logcdf(beyond), 0.0)


def with_noise(p: Periods, precision: Array) -> Periods:
    """The same policy under white noise of a precision (nu) of its own for each input, in the place of the noise that
    maximum entropy asks of a cost."""
    eye = jnp.eye(precision.shape[0])
    both = p.free[..., :, None] & p.free[..., None, :]
    own = jnp.where(both, eye * precision, eye)
    return p._replace(curvature=own, pressed=_log_mass(p.beyond * jnp.sqrt(precision / p.bend), p.limited))


def sweep(e: Expansion, coefficient: Array, windows: Windows, planning: bool = False) -> Periods:
    """Backward along every window at once. `e` has motions side by side; `coefficient` (groups)."""
    n = e.defect.shape[-1]
    gradient = jnp.einsum("g,dgti->dti", coefficient, e.gradient)
    hessian = jnp.einsum("g,dgtij->dtij", coefficient, e.hessian)
    last = (windows.motion, windows.first + windows.length)
    value = (jnp.einsum("g,dgti->dti", coefficient, e.end_gradient)[last],
             jnp.einsum("g,dgtij->dtij", coefficient, e.end_hessian)[last])

    def back(value: tuple[Array, Array], k: Array) -> tuple[tuple[Array, Array], Periods]:
        p, big_p = value
        active = k < windows.length
        at = (windows.motion, jnp.where(active, windows.first + k, 0))
        f, ft = e.slope[at], jnp.swapaxes(e.slope[at], -1, -2)
        q1 = gradient[at] + _times(ft, p + _times(big_p, e.defect[at]))
        q2 = hessian[at] + ft @ big_p @ f
        side = jnp.where(active[:, None], e.side[at], GIVEN)
        period = _period(q1, q2, side, n, planning)
        # the input minimises Q, so that its own answer to the weights has no say here
        m = jnp.concatenate([jnp.broadcast_to(jnp.eye(n), (*period.gain.shape[:-2], n, n)), period.gain], -2)
        z = jnp.concatenate([jnp.zeros_like(p), period.wish], -1)
        mt = jnp.swapaxes(m, -1, -2)
        new_p = _times(mt, q1 + _times(q2, z))
        new_big = mt @ q2 @ m
        new_big = 0.5 * (new_big + jnp.swapaxes(new_big, -1, -2))
        keep = active[:, None]
        return (jnp.where(keep, new_p, p), jnp.where(keep[..., None], new_big, big_p)), period

    _, periods = jax.lax.scan(back, value, jnp.arange(windows.longest), reverse=True)
    return periods if windows.whole else jax.tree.map(lambda a: a[:1], periods)


def surprise(periods: Periods) -> Array:
    """(longest, windows) wish' Quu wish: chi-squared with a degree of freedom for each free input of an optimum."""
    return jnp.einsum("...i,...ij,...j->...", periods.wish, periods.curvature, periods.wish)


def log_likelihood(periods: Periods) -> Array:
    root = cholesky(periods.curvature)
    logs = jnp.log(jnp.diagonal(root, axis1=-2, axis2=-1)).sum(-1)
    return (logs - 0.5 * surprise(periods) - HALF_LOG_2PI * periods.free.sum(-1) + periods.pressed.sum(-1)).sum()


def information(periods: Periods, by: Periods) -> Array:
    """Expected (Fisher) information, `by` the derivatives by the parameters in a last dimension: of a Gaussian by its
    mean and its precision; of inputs at limits the product of slopes."""
    root = cholesky(periods.curvature)
    mean = jnp.einsum("...ji,...jp->...ip", root, by.wish)  # root' dk: dk' Quu dk is its square
    count = by.curvature.shape[-1]
    nu = root.shape[-1]
    shape = solve_lower(root, by.curvature.reshape(*by.curvature.shape[:-2], nu * count))
    shape = jnp.swapaxes(shape.reshape(*by.curvature.shape), -2, -3)
    shape = solve_lower(root, shape.reshape(*by.curvature.shape[:-2], nu * count)).reshape(*by.curvature.shape)
    rows = [mean.reshape(-1, count), jnp.sqrt(0.5) * shape.reshape(-1, count), by.pressed.reshape(-1, count)]
    return sum((r.T @ r for r in rows), jnp.zeros((count, count)))
