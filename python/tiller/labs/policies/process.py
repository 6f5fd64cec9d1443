"""A Gaussian process of the dynamics: its shape by the marginal likelihood, and what it says of the next period."""
from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from .minimise import Numbers, minimise
from .moments import Array, Bumps

BUCKET = 50  # data are filled up to a multiple with points that count nothing: few shapes to compile for
MOST_LENGTH = 100.0  # deviations of an input


@dataclass
class Shape:
    """Of each output length scales, signal and noise, as logarithms."""
    log_length: Numbers  # (outputs, inputs)
    log_signal: Numbers  # (outputs) standard deviations
    log_noise: Numbers


@dataclass
class ProcessOptions:
    most_points: int = 150  # more data are told by so many inducing points
    most_fitted: int = 250  # data that the shape is fitted to; of more, a random part
    evaluations: int = 80  # of the marginal likelihood, for each output
    most_ratio: float = 500.0  # of signal to noise, softly


def _fine(excess: Array, log_bound: float) -> Array:
    """Nothing inside of the bound, much beyond it."""
    return (excess / log_bound)**30


def evidence(p: Array, x: Array, y: Array, used: Array) -> Array:
    """Negative logarithm of the marginal likelihood of targets y (n) at x (n, inputs), a squared exponential kernel
    with a length for each input and white noise (Rasmussen and Williams 2006, equation 5.8); p = (log lengths, log
    signal, log noise), used (n): which data count. Cost: O(n^3)."""
    z = x / jnp.exp(p[:-2])
    square = jnp.maximum((z**2).sum(1)[:, None] + (z**2).sum(1) - 2 * z @ z.T, 0.0)
    signal, noise = jnp.exp(2 * p[-2]), jnp.exp(2 * p[-1])
    k = jnp.where(used[:, None] & used, signal * jnp.exp(-0.5 * square), 0.0)
    root = jnp.linalg.cholesky(k + jnp.diag(jnp.where(used, noise + 1e-8 * signal, 1.0)))
    half = jax.scipy.linalg.solve_triangular(root, jnp.where(used, y, 0.0), lower=True)
    return 0.5 * half @ half + jnp.log(jnp.diag(root)).sum() + 0.5 * used.sum() * jnp.log(2 * jnp.pi)


@partial(jax.jit, static_argnames="most_ratio")
def _fined(p: Array, x: Array, y: Array, used: Array, log_spread: Array, most_ratio: float) -> tuple[Array, Array]:
    def whole(p: Array) -> Array:
        return (evidence(p, x, y, used) + _fine(p[:-2] - log_spread, np.log(MOST_LENGTH)).sum()
                + _fine(p[-2] - p[-1], np.log(most_ratio)))
    value, slope = jax.value_and_grad(whole)(p)
    return value, slope


def _filled(a: Numbers, size: int) -> Numbers:
    return np.concatenate([a, np.zeros((size - len(a), *a.shape[1:]))])


def bucket(count: int) -> int:
    return -(-count // BUCKET) * BUCKET


def _deviation(v: Numbers) -> Numbers:
    return np.maximum(1e-6, v.std(0))


def fit_shape(x: Numbers, y: Numbers, o: ProcessOptions, seed: int, before: Shape | None = None) -> Shape:
    """The largest marginal likelihood of y (n, outputs) at x (n, inputs), searched from `before`. Signal-to-noise
    ratios over most_ratio and lengths beyond a hundred deviations of the inputs are fined."""
    if len(x) > o.most_fitted:
        some = np.sort(np.random.default_rng([seed, 90, len(x)]).choice(len(x), o.most_fitted, replace=False))
        x, y = x[some], y[some]
    log_spread = np.log(_deviation(x))
    if before is None:
        signal = np.log(_deviation(y))
        before = Shape(np.tile(log_spread, (y.shape[1], 1)), signal, signal - np.log(10))
    size = bucket(len(x))
    used, filled = np.arange(size) < len(x), _filled(x, size)
    found = []
    for a in range(y.shape[1]):
        target = _filled(y[:, a], size)
        first = np.concatenate([before.log_length[a], [before.log_signal[a], before.log_noise[a]]])
        whole = partial(_fined, x=filled, y=target, used=used, log_spread=log_spread, most_ratio=o.most_ratio)
        found.append(minimise(whole, first, o.evaluations, 1e-6, 1e-3)[0])
    p = np.array(found)
    return Shape(p[:, :-2], p[:, -2], p[:, -1])


def _correlation(a: Numbers, b: Numbers, log_length: Numbers) -> Numbers:
    a, b = a / np.exp(log_length), b / np.exp(log_length)
    out: Numbers = np.exp(np.minimum(0, a @ b.T - 0.5 * (a**2).sum(1)[:, None] - 0.5 * (b**2).sum(1)))
    return out


def _pivots(x: Numbers, shape: Shape, wanted: int) -> list[int]:
    """Data by falling variance given the points before, until nothing is left to tell (pivoted Cholesky)."""
    left, root, chosen = np.ones(len(x)), np.zeros((len(x), wanted)), []
    for k in range(wanted):
        at = int(left.argmax())
        if left[at] < 1e-8:
            break
        column = np.mean([_correlation(x, x[at:at + 1], length)[:, 0] for length in shape.log_length], 0)
        root[:, k] = (column - root[:, :k] @ root[at, :k]) / np.sqrt(left[at])
        left -= root[:, k]**2
        left[at] = 0
        chosen.append(at)
    return chosen


def _exact(x: Numbers, y: Numbers, log_length: Numbers, signal: float, noise: float) -> tuple[Numbers, Numbers]:
    k = signal * _correlation(x, x, log_length) + (noise + 1e-8 * signal) * np.eye(len(x))
    factor = cho_factor(k)
    return cho_solve(factor, y), cho_solve(factor, np.eye(len(x)))


def _sparse(u: Numbers, x: Numbers, y: Numbers, log_length: Numbers, signal: float,
            noise: float) -> tuple[Numbers, Numbers]:
    """FITC: with V = L^-1 K_uf, L L' = K_uu, and the diagonal D of what u leaves of the variance plus the noise,
    B = I + V D^-1 V', beta = L^-T B^-1 V D^-1 y and W = L^-T (I - B^-1) L^-1."""
    root = np.linalg.cholesky(signal * _correlation(u, u, log_length) + 1e-6 * signal * np.eye(len(u)))
    v = solve_triangular(root, signal * _correlation(u, x, log_length), lower=True)
    scaled = v / (np.maximum(0, signal - (v**2).sum(0)) + noise + 1e-8 * signal)
    b = cho_factor(np.eye(len(u)) + scaled @ v.T)
    middle = np.eye(len(u)) - cho_solve(b, np.eye(len(u)))
    inverse = solve_triangular(root, np.eye(len(u)), lower=True)
    return inverse.T @ cho_solve(b, scaled @ y), inverse.T @ middle @ inverse


def condition(x: Numbers, y: Numbers, shape: Shape, o: ProcessOptions) -> Bumps:
    """The process given y (n, outputs) at x (n, inputs): exact up to most_points, else by inducing points taken from
    the data where the variance is largest, in the FITC approximation (Snelson and Ghahramani 2006)."""
    exact = len(x) <= o.most_points
    u = x if exact else x[_pivots(x, shape, o.most_points)]
    beta, w = [], []
    for a in range(y.shape[1]):
        how = shape.log_length[a], float(np.exp(2 * shape.log_signal[a])), float(np.exp(2 * shape.log_noise[a]))
        one = _exact(x, y[:, a], *how) if exact else _sparse(u, x, y[:, a], *how)
        beta.append(one[0])
        w.append(0.5 * (one[1] + one[1].T))
    more = bucket(len(u)) - len(u)
    return Bumps(np.concatenate([u, np.repeat(u[:1], more, 0)]), shape.log_length, shape.log_signal,
                 np.pad(np.array(beta), ((0, 0), (0, more))), np.pad(np.array(w), ((0, 0), (0, more), (0, more))))
