"""A sparse Gaussian process over each joint's force, and functions drawn from its posterior."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from .data import Array, Samples

WAVES, FITTED, STEPS = 64, 300, 60
JITTER = 1e-6  # of the signal's variance, on the diagonal of the inducing points
LENGTH = 2.0  # deviations of an input, about which its length has a log-normal prior


@dataclass(frozen=True)
class Scales:
    """Of the squared exponential: a length for each input (standardised), signal and noise of each force."""
    length: Array
    signal: Array
    noise: Array


def _kernel(a: Any, b: Any) -> Any:
    """exp(-1/2 |a - b|^2) of rows that are scaled by their lengths, (n, m)."""
    squares = (a * a).sum(1)[:, None] + (b * b).sum(1) - 2 * a @ b.T
    return jnp.exp(-0.5 * jnp.maximum(squares, 0))


@jax.jit
def _loss(theta: Any, x: Any, y: Any, weight: Any) -> Any:
    """Less the log marginal likelihood (Rasmussen and Williams 2006, equation 2.30) and the lengths' log prior.
    theta: logarithms of lengths, signals, noises."""
    d, k = x.shape[1], y.shape[1]
    shape = _kernel(x / jnp.exp(theta[:d]), x / jnp.exp(theta[:d]))
    loss = 0.5 * ((theta[:d] - jnp.log(LENGTH)) ** 2).sum()
    for o in range(k):
        spread = jnp.exp(2 * theta[d + k + o]) / jnp.maximum(weight[:, o], 1e-3)
        root = jnp.linalg.cholesky(jnp.exp(2 * theta[d + o]) * shape + jnp.diag(spread))
        z = jax.scipy.linalg.solve_triangular(root, y[:, o], lower=True)
        loss += 0.5 * (z @ z) + jnp.log(jnp.diagonal(root)).sum() + 0.5 * len(z) * jnp.log(2 * jnp.pi)
    return loss


_slope = jax.jit(jax.value_and_grad(_loss))


def fit_scales(samples: Samples, seed: int, fitted: int = FITTED) -> Scales:
    """The most likely ones for some of the periods. Cost: STEPS x fitted^3."""
    d, k = samples.x.shape[1], samples.y.shape[1]
    counts = np.flatnonzero(samples.weight.sum(1) > 0)
    some = np.random.default_rng(seed).permutation(counts)[:fitted]
    rows = [jnp.asarray(a[some]) for a in (samples.x, samples.y, samples.weight)]

    def value(theta: Array) -> tuple[float, Array]:
        loss, slope = _slope(jnp.asarray(theta), *rows)
        return (float(loss), np.asarray(slope)) if np.isfinite(loss) else (1e12, np.zeros_like(theta))

    begin = np.concatenate([np.full(d, np.log(LENGTH)), np.zeros(k), np.full(k, np.log(0.3))])
    best = minimize(value, begin, jac=True, method="L-BFGS-B", bounds=[(np.log(1e-2), np.log(1e2))] * len(begin),
                    options={"maxiter": STEPS}).x
    return Scales(np.exp(best[:d]), np.exp(best[d:d + k]), np.exp(best[d + k:]))


def _inducing(x: Array, count: int) -> Array:
    """Rows as far from each other as can be, the first nearest to the middle (Gonzalez 1985)."""
    at = int(((x - x.mean(0)) ** 2).sum(1).argmin())
    distance, chosen = np.full(len(x), np.inf), []
    for _ in range(min(count, len(x))):
        chosen.append(at)
        distance = np.minimum(distance, ((x - x[at]) ** 2).sum(1))
        at = int(distance.argmax())
    return x[chosen]


def fit(samples: Samples, members: int, inducing: int, seed: int, waves: int = WAVES,
        fitted: int = FITTED) -> tuple[Array, list[int], Scales]:
    """Weights in the file's order on plain inputs and outputs, the numbers of centres and waves, and the scales. The
    values at the inducing points have the posterior of a subset of regressors (Rasmussen and Williams, section 8.3.1).
    The first member is the mean; each other is a draw by Matheron's rule (Wilson et al., ICML 2020): a function from
    the prior, of waves, and the kernel's update at the inducing points. Cost: periods x inducing^2."""
    rng, scales = np.random.default_rng(seed + 1), fit_scales(samples, seed, fitted)
    x = samples.x / scales.length
    z = _inducing(x, inducing)
    wave, phase = rng.normal(size=(waves, x.shape[1])), 2 * np.pi * rng.random(waves)
    width = samples.x_sd * scales.length
    plain_phase = np.remainder(phase - wave @ (samples.x_mean / width), 2 * np.pi)
    out = [1 / width, (samples.x_mean + z * width).ravel(), np.column_stack([plain_phase, wave / width]).ravel()]
    kzz, kzx = np.asarray(_kernel(z, z)) + JITTER * np.eye(len(z)), np.asarray(_kernel(z, x))
    factor, at_z = cho_factor(kzz), np.cos(z @ wave.T + phase)
    posteriors = [_condition(kzz * s**2, kzx * s**2, samples.y[:, o], samples.weight[:, o], s**2, n**2)
                  for o, (s, n) in enumerate(zip(scales.signal, scales.noise, strict=True))]
    for member in range(members):
        for o, (mean, root) in enumerate(posteriors):
            own = scales.signal[o] * (2 / waves) ** 0.5 * rng.normal(size=waves) * (member > 0)
            u = mean + root @ rng.normal(size=len(mean)) * (member > 0)
            out.append(samples.y_sd[o] * np.concatenate([[0.0], cho_solve(factor, u - at_z @ own), own]))
    return np.concatenate(out), [len(z), waves], scales


def _condition(kzz: Array, kzx: Array, y: Array, weight: Array, signal: float, noise: float) -> tuple[Array, Array]:
    """Mean, and root of the covariance, of one force's values at the inducing points."""
    factor = cho_factor(kzz + kzx * weight @ kzx.T / noise + JITTER * signal * np.eye(len(kzz)))
    mean = kzz @ cho_solve(factor, kzx @ (weight * y)) / noise
    covariance = kzz @ cho_solve(factor, kzz)
    return mean, np.linalg.cholesky(0.5 * (covariance + covariance.T) + JITTER * signal * np.eye(len(kzz)))
