"""Relative entropy policy search on the process: PILCO's loop with samples in the place of gradients."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from scipy.optimize import minimize_scalar

from .feedback import Feedback, command
from .minimise import Numbers
from .moments import Array, Bumps, bump_values
from .search import SearchOptions, SearchResult, SearchStep, Try, search_policy
from .task import Task, features, sure_cost


@dataclass
class RepsOptions:
    samples: int = 60  # policies an iteration
    rollouts: int = 4  # of each policy; the same draws for all of an iteration
    iterations: int = 40  # before each trial
    epsilon: float = 0.5  # bound of the divergence of an iteration's weights, nats
    first_sd: float = 0.3  # of the parameters before the first iteration


def reps_weights(cost: Numbers, epsilon: float) -> Numbers:
    """Weights of samples, as near to the cheapest as a divergence of epsilon from equal weights allows: exp(-c / eta)
    with eta of the least dual eta epsilon + eta log mean exp(-c / eta) (Peters, Muelling, Altun, AAAI 2010). Costs that
    are not finite get none."""
    off = np.where(np.isfinite(cost), cost - np.nanmin(np.where(np.isfinite(cost), cost, np.nan)), np.inf)
    scale, count = max(1e-12, np.ptp(off[np.isfinite(off)])), np.isfinite(off).sum()

    def dual(log_eta: float) -> float:
        eta = np.exp(log_eta)
        return float(eta * (epsilon + np.log(np.exp(-off / eta).sum() / count)))

    log_scale = np.log(scale)
    eta = np.exp(minimize_scalar(dual, bounds=(log_scale - 12, log_scale + 7), method="bounded").x)
    w = np.exp(-off / eta)
    return w / w.sum()


def sampled_cost(task: Task, process: Bumps, policy: Feedback, key: Array) -> Array:
    """long_term_cost by one rollout in which each period's gain is drawn from the process's prediction at the state."""
    first, later = jax.random.split(key)
    x = task.start_mean + jnp.linalg.cholesky(jnp.asarray(task.start_covariance)) @ jax.random.normal(first, (task.nx,))

    answer = command(task, policy)

    def period(x: Array, z: Array) -> tuple[Array, Array]:
        u = answer(x)
        mean, variance = bump_values(process, jnp.concatenate([features(task.angles, x)[np.array(task.seen)], u]))
        known = x if task.physics is None else task.physics(jnp.concatenate([x, u]))[0]
        x = known + mean + jnp.sqrt(jnp.maximum(0, variance)) * z
        return x, sure_cost(task, x)

    return jax.lax.scan(period, x, jax.random.normal(later, (task.horizon, task.nx)))[1].sum()


def reps_search(task: Task, run: Try, o: SearchOptions, how: RepsOptions,
                after: Callable[[SearchStep, int], None], result: SearchResult) -> None:
    """An iteration draws parameters from a normal distribution, weighs them by what their policies cost on the process
    and moves mean and deviations to the weighted ones. It follows no normal approximation of the state, and takes the
    noise of few rollouts. The best mean of the search is kept."""
    jitted: list[Callable[..., Array]] = []

    def judge(rows: Numbers, process: Bumps, key: Array) -> Numbers:
        return np.asarray(jitted[0](rows, process, jax.random.split(key, how.rollouts)))

    def improve(process: Bumps, policy: Feedback, trial: int) -> Feedback:
        first, unravel = ravel_pytree(policy)
        if not jitted:
            one = lambda p, process, key: sampled_cost(task, process, unravel(p), key)
            many = jax.vmap(jax.vmap(one, (None, None, 0)), (0, None, None))
            jitted.append(jax.jit(lambda rows, process, keys: many(rows, process, keys).mean(1)))
        mean = np.asarray(first)
        best, least, sd = mean, np.inf, np.full(mean.size, how.first_sd)
        rng, key = np.random.default_rng([o.seed, 97, trial]), jax.random.key(o.seed * 1000 + trial)
        for i in range(how.iterations):
            drawn = mean + sd * rng.standard_normal((how.samples, mean.size))
            now = judge(mean[None], process, key)[0]  # by the same draws in all iterations
            if now < least:
                best, least = mean, now
            w = reps_weights(judge(drawn, process, jax.random.fold_in(key, i)), how.epsilon)
            # deviations about the mean before: else steps that pay shrink the search along themselves
            sd = np.maximum(1e-3, np.sqrt(w @ (drawn - mean)**2))
            mean = w @ drawn
        return unravel(best)

    search_policy(task, run, o, improve, after, result)
