"""Exact means and covariances of what a normal state passes through, as functions of JAX."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

Array = Any  # of JAX, which has no types here
QUARTER = np.pi / 2


class Normal(NamedTuple):
    mean: Array  # (n)
    covariance: Array  # (n, n)


class Moments(NamedTuple):
    """Of outputs at a normal input."""
    mean: Array  # (m)
    covariance: Array  # (m, m)
    gain: Array  # (n, m): the covariance of input and output is S gain


class Bumps(NamedTuple):
    """Outputs that are each a weighted sum of Gaussian bumps about shared points, and uncertain or not:

        k_a(x, x') = s_a^2 exp(-1/2 sum_d ((x_d - x'_d) / length_ad)^2)
        mean_a(x) = k_a(x, X) beta_a,    variance_a(x) = s_a^2 - k_a(x, X) W_a k_a(X, x)

    A full Gaussian process has W = (K + noise I)^-1, a sparse one W and X of its inducing points, a network of radial
    basis functions none.
    """
    x: Array  # (n, inputs)
    log_length: Array  # (outputs, inputs)
    log_signal: Array  # (outputs) log s
    beta: Array  # (outputs, n)
    w: Array | None = None  # (outputs, n, n), symmetric; None: the outputs are certain


def bump_moments(b: Bumps, of: Normal) -> Moments:
    """Exact moments of the outputs (Deisenroth and Rasmussen 2011, equations 14 to 23). What the outputs' own noise
    adds is left out. Cost: O(outputs^2 n^2 inputs)."""
    b, of = jax.tree.map(jnp.asarray, (b, of))
    s, zeta, identity = of.covariance, b.x - of.mean, jnp.eye(len(of.mean))
    square, inverse = jnp.exp(2 * b.log_length), jnp.exp(-2 * b.log_length)

    def one(length: Array, squared: Array, signal: Array, beta: Array) -> tuple[Array, Array]:
        t = jnp.linalg.inv(s + jnp.diag(squared))
        log_scale = 2 * signal + length.sum() + 0.5 * jnp.linalg.slogdet(t)[1]
        weighted = beta * jnp.exp(log_scale - 0.5 * ((zeta @ t) * zeta).sum(1))
        return weighted.sum(), t @ (zeta.T @ weighted)

    def pair(i: Array, j: Array) -> Array:
        """sum_kl g_kl E[k_i(x, x_k) k_j(x, x_l)]: the logarithm of the mean splits into a row, a column, a product."""
        first, second = zeta * inverse[i], zeta * inverse[j]
        r = identity + s * (inverse[i] + inverse[j])
        u = jnp.linalg.solve(r, s)
        row = 2 * b.log_signal[i] - 0.5 * ((zeta - first @ u) * first).sum(1) - 0.5 * jnp.linalg.slogdet(r)[1]
        column = 2 * b.log_signal[j] - 0.5 * ((zeta - second @ u) * second).sum(1)
        g = b.beta[i][:, None] * b.beta[j]
        if b.w is not None:
            g = g - jnp.where(i == j, b.w[i], 0.0)
        return (g * jnp.exp(row[:, None] + column + first @ u @ second.T)).sum()

    mean, gain = jax.vmap(one)(b.log_length, square, b.log_signal, b.beta)
    rows, columns = np.triu_indices(len(b.beta))
    second = jax.vmap(pair)(rows, columns)
    full = jnp.zeros((len(b.beta),) * 2).at[rows, columns].set(second).at[columns, rows].set(second)
    own = jnp.exp(2 * b.log_signal) if b.w is not None else jnp.zeros(len(b.beta))
    return Moments(mean, full - jnp.outer(mean, mean) + jnp.diag(own), gain.T)


def bump_values(b: Bumps, x: Array) -> tuple[Array, Array]:
    """Mean and variance (outputs) at a point."""
    gap = (x - b.x) / jnp.exp(b.log_length)[:, None, :]
    k = jnp.exp(2 * b.log_signal[:, None] - 0.5 * (gap**2).sum(-1))
    if b.w is None:
        return (k * b.beta).sum(1), jnp.zeros(len(b.beta))
    return (k * b.beta).sum(1), jnp.exp(2 * b.log_signal) - jnp.einsum("an,anm,am->a", k, b.w, k)


def _sines(of: Normal, phase: Array) -> Moments:
    """Of sin(x + phase): characteristic functions, products as halves of cosines of sums (and Stein's lemma)."""
    m, s = of.mean + phase, of.covariance
    own = jnp.diag(s)
    shrink = jnp.exp(-0.5 * own)
    mean, both = shrink * jnp.sin(m), own[:, None] + own
    product = 0.5 * (jnp.exp(s - 0.5 * both) * jnp.cos(m[:, None] - m)
                     - jnp.exp(-s - 0.5 * both) * jnp.cos(m[:, None] + m))
    return Moments(mean, product - jnp.outer(mean, mean), jnp.diag(shrink * jnp.cos(m)))


def with_sines(x: Normal, angles: Sequence[int]) -> Normal:
    """x and, behind it, sine and cosine of each of its angles."""
    if not len(angles):
        return x
    at = np.repeat(np.asarray(angles), 2)
    phase = np.tile([0.0, QUARTER], len(angles))
    wave = _sines(Normal(x.mean[at], x.covariance[np.ix_(at, at)]), phase)
    across = x.covariance[:, at] @ wave.gain
    return Normal(jnp.concatenate([x.mean, wave.mean]),
                  jnp.block([[x.covariance, across], [across.T, wave.covariance]]))


def squash(v: Array, low: Array, high: Array) -> Array:
    """Never beyond low and high, and flat there (Deisenroth and Rasmussen 2011, section 3.3)."""
    return 0.5 * (low + high) + (high - low) * (9 * jnp.sin(v) + jnp.sin(3 * v)) / 16


def squashed(v: Normal, low: Array, high: Array) -> Moments:
    """Of squash(v)."""
    n = len(low)
    triple = jnp.concatenate([jnp.eye(n), 3 * jnp.eye(n)])  # v and 3 v side by side
    wave = _sines(Normal(triple @ v.mean, triple @ v.covariance @ triple.T), jnp.zeros(2 * n))
    share = jnp.concatenate([jnp.diag(9 * (high - low)), jnp.diag(high - low)], 1) / 16
    return Moments(0.5 * (low + high) + share @ wave.mean, share @ wave.covariance @ share.T,
                   (share @ wave.gain @ triple).T)


def saturating_cost(of: Normal, target: Array, weight: Array) -> Array:
    """E[1 - exp(-1/2 (z - target)' W (z - target))], W symmetric, positive semidefinite."""
    r = jnp.eye(len(target)) + of.covariance @ weight
    off = of.mean - target
    return 1 - jnp.exp(-0.5 * off @ weight @ jnp.linalg.solve(r, off) - 0.5 * jnp.linalg.slogdet(r)[1])
