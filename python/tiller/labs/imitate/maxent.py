"""Weights that make demonstrated inputs most likely (Ziebart and others 2008; Levine and Koltun 2012)."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np

from .expansion import Array, Expansion, side_by_side, windows_of
from .problem import ImitationError, Numbers
from .sweep import Periods, information, log_likelihood, surprise, sweep, with_noise

PRIOR_SD = 5.0      # of a weight's logarithm around the robot file's, and of a target in its unit
NINETY = 1.6448536  # deviations of a central 90 %
ALIKE = 0.98        # correlation of logarithms beyond which two weights act alike


@dataclass
class Target:
    """A target that is learnt beside the weights."""
    state: int
    key: str
    value: float  # the file's
    unit: float   # of the search
    of: tuple[int, int]         # learnt terms that multiply stages and end, -1: what is kept
    kept: tuple[float, float]   # their weights where they are kept


@dataclass
class Weight:
    key: str
    file: float
    value: float
    low: float = np.nan
    high: float = np.nan
    log_sd: float = np.nan
    varies: bool = True
    identified: bool = True


@dataclass
class LearntTarget:
    target: Target
    value: float
    low: float
    high: float
    identified: bool


@dataclass
class Fit:
    weights: list[Weight] = field(default_factory=list)
    targets: list[LearntTarget] = field(default_factory=list)
    nats: float = np.nan  # what one unit of the kept cost is in nats, by the noise of the inputs
    noise_sd: Numbers = field(default_factory=lambda: np.zeros(0))  # (nu) of the inputs around what the weights ask for
    log_likelihood: float = np.nan
    before: float = np.nan  # of the robot file's weights at their own best scale
    inputs: int = 0
    limited: int = 0
    iterations: int = 0
    converged: bool = True
    alike: list[tuple[int, int]] = field(default_factory=list)
    surprise: Numbers = field(default_factory=lambda: np.zeros(0))     # (motions) mean over the inputs; about 1
    persistence: Numbers = field(default_factory=lambda: np.zeros(0))  # (motions) of what is left, period to period


class Posterior:
    """Log posterior of theta: logarithms of the scale in nats and of the learnt weights relative to what is kept, then
    the moves of targets in their units, then the logarithms of the inputs' precisions. Under noise `own` the scale has
    no say, under `entropy` the precisions have none."""

    def __init__(self, motions: Sequence[Expansion], start: Numbers, targets: Sequence[Target], horizon: int,
                 every: int, noise: str = "own") -> None:
        self.windows = windows_of(motions, horizon, every)
        self.motions = side_by_side(motions)
        self.targets = list(targets)
        acts = np.any([e.has_slope() for e in motions], 0)
        self.varies = acts[1:1 + len(start)]
        self.start = start
        self.nu, self.own = motions[0].side.shape[-1], noise == "own"
        self.centre = np.concatenate([[0.0], np.log(start), np.zeros(len(self.targets) + self.nu)])
        # a weight without a slope anywhere stays where it is
        sd = np.where(self.varies, PRIOR_SD, 1e-3)
        self.precision = np.concatenate([[float(self.own)], 1 / sd**2, np.full(len(self.targets), 1 / PRIOR_SD**2),
                                         np.full(self.nu, float(not self.own))])
        self.data = jax.jit(self._data)
        self._all = jax.jit(self._with_information)
        self.policy = jax.jit(self._sweep)

    def coefficient(self, theta: Array) -> Array:
        """(groups) of the expansions, in nats."""
        count = len(self.varies)
        weight = jnp.exp(theta[0] + jnp.concatenate([jnp.zeros(1), theta[1:1 + count]]))
        moved = [theta[1 + count + t] * target.unit * weight[1 + of] * (1.0 if of >= 0 else kept)
                 for t, target in enumerate(self.targets) for of, kept in zip(target.of, target.kept, strict=True)]
        return jnp.concatenate([weight, jnp.array(moved)]) if moved else weight

    def _sweep(self, theta: Array) -> Periods:
        return sweep(self.motions, self.coefficient(theta), self.windows)

    def periods(self, theta: Array) -> Periods:
        p = self._sweep(theta)
        return with_noise(p, jnp.exp(theta[-self.nu:])) if self.own else p

    def left(self, theta: Numbers) -> tuple[Numbers, float]:
        """(nu) deviations of the inputs around what the weights ask for; the scale in nats at which maximum entropy has
        as much noise."""
        p = self.policy(jnp.asarray(theta))
        wish, free = np.asarray(p.wish), np.asarray(p.free)
        squares, count = ((wish * free)**2).sum((0, 1)), free.sum((0, 1))
        return (np.sqrt(np.maximum(squares, 1e-24) / np.maximum(count, 1)),
                float(np.exp(theta[0]) * free.sum() / np.asarray(surprise(p)).sum()))

    def _data(self, theta: Array) -> Array:
        return log_likelihood(self.periods(theta))

    def prior(self, theta: Array) -> Array:
        return -0.5 * (self.precision * (theta - self.centre)**2).sum()

    def value(self, theta: Numbers) -> float:
        return float(self.data(jnp.asarray(theta)) + self.prior(jnp.asarray(theta)))

    def _with_information(self, theta: Array) -> tuple[Array, Array]:
        def smooth(t: Array) -> tuple[Periods, Array]:
            p = self.periods(t)
            return p._replace(free=p.free * 1.0, limited=p.limited * 1.0), log_likelihood(p) + self.prior(t)

        by, gradient = jax.jacfwd(smooth)(theta)
        return gradient, information(self.periods(theta), by) + jnp.diag(self.precision)

    def with_information(self, theta: Numbers) -> tuple[Numbers, Numbers]:
        gradient, info = self._all(jnp.asarray(theta))
        return np.asarray(gradient), np.asarray(info)

    def counts(self, theta: Numbers) -> tuple[int, int]:
        p = self.periods(jnp.asarray(theta))
        return int(p.free.sum()), int(p.limited.sum())


def _start_scale(posterior: Posterior, theta: Numbers, inputs: int) -> Numbers:
    """The precisions, or the scale, that suit the motions' noise best. The slope along the scale is (n - squares) / 2."""
    if posterior.own:
        return np.concatenate([theta[:-posterior.nu], -2 * np.log(posterior.left(theta)[0])])
    slope = jax.jit(jax.grad(lambda s, t: posterior.data(t.at[0].set(s))))
    for _ in range(3):
        squares = inputs - 2 * float(slope(theta[0], jnp.asarray(theta)))
        if not np.isfinite(squares) or squares <= 0:
            break
        theta = theta.copy()
        theta[0] += np.log(inputs / squares)
    return theta


def _improved(posterior: Posterior, theta: Numbers, at: float, damping: float) -> tuple[Numbers, float, float] | None:
    """A step of Fisher scoring with Levenberg's damping by the curvature of the scale and of the ratios; at most 3 in
    any parameter."""
    gradient, info = posterior.with_information(theta)
    for _ in range(12):
        step = np.linalg.solve(info + np.diag(damping * np.diag(info) + 1e-12), gradient)
        longest = np.abs(step).max()
        if np.isfinite(longest):
            candidate = theta + step * min(1.0, 3 / max(longest, 1e-300))
            value = posterior.value(candidate)
            if value >= at:
                return candidate, value, max(1e-6, damping / 10)
        damping *= 5
    return None


def _read(posterior: Posterior, keys: Sequence[str], theta: Numbers, covariance: Numbers, fit: Fit) -> None:
    count = len(keys)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    for i, key in enumerate(keys):
        file, varies = float(posterior.start[i]), bool(posterior.varies[i])
        value = float(np.exp(theta[1 + i])) if varies else file
        log_sd = float(sd[1 + i]) if varies else np.inf
        fit.weights.append(Weight(key, file, value, value * np.exp(-NINETY * log_sd), value * np.exp(NINETY * log_sd),
                                  log_sd, varies, log_sd <= 1))
        fit.alike += [(j, i) for j in range(i) if varies and posterior.varies[j]
                      and abs(covariance[1 + i, 1 + j]) > ALIKE * sd[1 + i] * sd[1 + j]]
    for t, target in enumerate(posterior.targets):
        value, spread = target.value + target.unit * theta[1 + count + t], sd[1 + count + t]
        fit.targets.append(LearntTarget(target, float(value), float(value - NINETY * spread * target.unit),
                                        float(value + NINETY * spread * target.unit), bool(spread <= 1)))


def _judge_motions(posterior: Posterior, theta: Numbers, fit: Fit) -> None:
    """How surprising each motion is under what all of them say, and how much of that stays from input to input."""
    p = posterior.periods(jnp.asarray(theta))
    chi, free, wish = np.asarray(surprise(p)), np.asarray(p.free), np.asarray(p.wish * p.free)
    owner, count = np.asarray(posterior.windows.motion), int(posterior.motions.slope.shape[0])
    fit.surprise, fit.persistence = np.full(count, np.nan), np.full(count, np.nan)
    for d in range(count):
        mine = owner == d
        number = free[:, mine].sum()
        if number:
            fit.surprise[d] = chi[:, mine].sum() / number
        series = wish[:, mine].reshape(-1, wish.shape[-1])  # in time, for windows are in order
        if len(series) > 20:
            fit.persistence[d] = (series[1:] * series[:-1]).sum() / max((series**2).sum(), 1e-300)


def fit_weights(motions: Sequence[Expansion], keys: Sequence[str], start: Sequence[float], horizon: int = 0,
                every: int = 1, targets: Sequence[Target] = (), iterations: int = 100,
                progress: Callable[[int, float], None] | None = None, noise: str = "own") -> Fit:
    """Weights of the groups behind the first by maximum likelihood, with a wide Gaussian around `start`. `noise`: what
    the inputs do around the optimum, `own`, white with a deviation of each input's own, or `entropy`, as the policy of
    maximum entropy has it, which says something about the weights. Ends where a step gains less than 1e-7 nats and 1e-9
    of the value. Raises ImitationError."""
    posterior = Posterior(motions, np.asarray(start, float), targets, horizon, every, noise)
    theta, fit = posterior.centre.copy(), Fit()
    fit.inputs, fit.limited = posterior.counts(theta)
    if not np.isfinite(posterior.value(theta)):
        raise ImitationError("the cost has no curvature in some input along the demonstrations; give every input an "
                             "input_weight")
    if fit.inputs == 0:
        raise ImitationError("every demonstrated input is at a limit, where the cost has no say; demonstrate a slower "
                             "motion, or raise the limits in a copy of the robot file")
    theta = _start_scale(posterior, theta, fit.inputs)
    fit.before = float(posterior.data(jnp.asarray(theta)))
    at, damping, fit.converged = posterior.value(theta), 1e-3, False
    while fit.iterations < iterations:
        step = _improved(posterior, theta, at, damping)
        fit.iterations += 1
        if step is None:  # no step is better: the top, as well as it is known
            fit.converged = True
            break
        gained = step[1] - at
        theta, at, damping = step
        if progress:
            progress(fit.iterations, at)
        if gained < 1e-7 + 1e-9 * abs(at):
            fit.converged = True
            break
    fit.log_likelihood = float(posterior.data(jnp.asarray(theta)))
    fit.noise_sd, fit.nats = posterior.left(theta)
    _, info = posterior.with_information(theta)
    _read(posterior, keys, theta, np.asarray(np.linalg.inv(info), np.float64), fit)
    _judge_motions(posterior, theta, fit)
    return fit
