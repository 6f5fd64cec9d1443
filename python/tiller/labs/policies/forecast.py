"""What a policy is expected to cost on the learnt dynamics: PILCO's cascade of normal distributions."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .feedback import Feedback
from .moments import Array, Bumps, Moments, Normal, bump_moments, saturating_cost, squashed, with_sines
from .shown import divergence
from .task import Task


class Forecast(NamedTuple):
    """Of the states from the start on."""
    mean: Array  # (horizon + 1, nx)
    covariance: Array  # (horizon + 1, nx, nx)
    cost: Array  # (horizon + 1)


def _with_commands(task: Task, policy: Callable[[Normal], Moments], f: Normal) -> Normal:
    """Features and, behind them, the commands that the policy gives for them."""
    seen = np.array(task.seen)
    before = policy(Normal(f.mean[seen], f.covariance[np.ix_(seen, seen)]))
    after = squashed(Normal(before.mean, before.covariance), task.low, task.high)
    across = f.covariance[:, seen] @ before.gain @ after.gain
    return Normal(jnp.concatenate([f.mean, after.mean]),
                  jnp.block([[f.covariance, across], [across.T, after.covariance]]))


def _next(task: Task, process: Bumps, both: Normal) -> Normal:
    """The state after a period, from features and commands before it."""
    nx, known = task.nx, len(task.target)
    commands = np.arange(known, known + task.nu)
    inputs, origin = np.concatenate([task.seen, commands]), np.concatenate([np.arange(nx), commands])
    learnt = bump_moments(process, Normal(both.mean[inputs], both.covariance[np.ix_(inputs, inputs)]))
    across = both.covariance[:, inputs] @ learnt.gain  # (all, nx)
    if task.physics is None:
        mean, slope = both.mean[:nx], jnp.eye(nx, nx + task.nu)
    else:
        mean, slope = task.physics(both.mean[origin])
    spread = slope @ both.covariance[np.ix_(origin, origin)] @ slope.T
    with_learnt = slope @ across[origin]
    covariance = spread + learnt.covariance + with_learnt + with_learnt.T
    return Normal(mean + learnt.mean, 0.5 * (covariance + covariance.T))


def _costs(task: Task, states: Normal) -> Array:
    """(horizon + 1) of normal states: expected ones, or divergences from demonstrations."""
    if task.shown is not None:
        return jax.vmap(divergence)(Normal(*map(jnp.asarray, task.shown)), states)
    return jax.vmap(lambda s: saturating_cost(with_sines(s, task.angles), task.target, task.weight))(states)


def forecast(task: Task, process: Bumps, policy: Feedback) -> Forecast:
    """The state's distribution is taken for normal at each period, with the exact moments of the step (Deisenroth and
    Rasmussen 2011); the physics' part, if there is one, is linearised about the mean. Not finite where the prediction
    runs away."""
    def period(state: Normal, _: None) -> tuple[Normal, Normal]:
        after = _next(task, process, _with_commands(task, answer, with_sines(state, task.angles)))
        return after, after

    answer = policy.of_normal()
    start = Normal(jnp.asarray(task.start_mean), jnp.asarray(task.start_covariance))
    later = jax.lax.scan(period, start, None, task.horizon)[1]
    states = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, later)
    return Forecast(states.mean, states.covariance, _costs(task, states))


def long_term_cost(task: Task, process: Bumps, policy: Feedback) -> Array:
    """Expected cost, summed over the states after the first."""
    return forecast(task, process, policy).cost[1:].sum()
