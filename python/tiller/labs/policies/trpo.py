"""Trust region policy optimisation (Schulman, Levine, Abbeel, Jordan, Moritz, ICML 2015): policy search without a model
of what it acts on, here with rollouts on the robot file's."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.scipy.sparse.linalg import cg

from .guide import Goal
from .minimise import Numbers
from .moments import Array
from .student import Student
from .task import Task, features

LENGTHS = 0.7 ** np.arange(15)  # of the line search


@dataclass
class TrpoOptions:
    episodes: int = 128  # an update
    kl: float = 0.02  # bound of the mean over states of KL(old || new)
    discount: float = 0.99
    trace: float = 0.95  # generalised advantages' lambda
    damping: float = 0.01  # of the Fisher product, in shares of the identity
    conjugate: int = 15  # steps of conjugate gradients
    first_sd: float = 0.4  # of commands, in shares of half the range


class Actor(NamedTuple):
    arrays: Any  # of the network
    log_sd: Array  # (nu) of the commands about it, in shares of half the range


class Batch(NamedTuple):
    x: Array  # (T, n, nx)
    u: Array  # (T, n, nu) as drawn, before the limits cut
    cost: Array  # (T, n)


def normal_kl(mean: Array, log_sd: Array, new_mean: Array, new_log_sd: Array) -> Array:
    """KL(old || new) of independent normals, summed over the last dimension."""
    ratio = jnp.exp(2 * (log_sd - new_log_sd)) + ((mean - new_mean) / jnp.exp(new_log_sd))**2
    return (new_log_sd - log_sd + 0.5 * (ratio - 1)).sum(-1)


def advantages(f: Array, cost: Array, discount: float, trace: float) -> Array:
    """(T, n) of returns over a baseline that least squares fit to features (T, n, m), their squares and the time
    (Schulman et al., ICLR 2016), with deviation one."""
    periods, count, m = f.shape
    left = jnp.broadcast_to((jnp.arange(periods, 0, -1.0) / periods)[:, None, None], (periods, count, 1))
    rows = jnp.concatenate([f, f**2, f * left, left, left**2, left**3, jnp.ones_like(left)], -1)

    def back(later: Array, now: Array) -> tuple[Array, Array]:
        return now + discount * later, now + discount * later
    to_go = jax.lax.scan(back, jnp.zeros(count), -cost, reverse=True)[1]
    flat = rows.reshape(periods * count, -1)
    fitted = jnp.linalg.solve(flat.T @ flat + 1e-5 * len(flat) * jnp.eye(flat.shape[1]), flat.T @ to_go.ravel())
    value = jnp.concatenate([rows @ fitted, jnp.zeros((1, count))])
    gain = -cost + discount * value[1:] - value[:-1]
    _, found = jax.lax.scan(lambda later, now: (now + discount * trace * later,) * 2, jnp.zeros(count), gain,
                            reverse=True)
    return (found - found.mean()) / (found.std() + 1e-12)


class Trpo:
    """step(z (nx + nu), params (np)) is the state a period later. The network is `student`'s, whose scale is set."""

    def __init__(self, task: Task, goal: Goal, step: Callable[[Array, Array], Array], student: Student,
                 o: TrpoOptions) -> None:
        self._task, self._goal, self._step, self.student, self.o = task, goal, step, student, o
        self.actor = Actor(student.arrays, jnp.full(task.nu, np.log(o.first_sd)))
        self._half = 0.5 * (task.high - task.low)
        self._update, self._rollouts = jax.jit(self._updated), jax.jit(self.rollouts)
        self.policy_rollouts = jax.jit(lambda arrays, params, starts: self.rollouts(
            Actor(arrays, jnp.full(task.nu, -jnp.inf)), params, starts, jax.random.key(0)))

    def rollouts(self, actor: Actor, params: Array, starts: Array, key: Array) -> tuple[Batch, Array]:
        """Of parameters (n, np) from starts (n, nx), and the last states (n, nx). Costs are those of `goal`."""
        task, goal = self._task, self._goal

        def period(x: Array, key: Array) -> tuple[Array, tuple[Array, Array, Array]]:
            mean = self.student.answers(actor.arrays, self.student.scale, x)
            u = mean + self._half * jnp.exp(actor.log_sd) * jax.random.normal(key, mean.shape)
            cut = jnp.clip(u, task.low, task.high)
            cost = 0.5 * ((x - goal.target)**2 @ goal.state + cut**2 @ goal.control)
            return jax.vmap(self._step)(jnp.concatenate([x, cut], 1), params), (x, u, cost)

        last, (x, u, cost) = jax.lax.scan(period, starts, jax.random.split(key, task.horizon))
        end = 0.5 * (last - goal.target)**2 @ goal.terminal
        return Batch(x, u, cost.at[-1].add(end)), last

    def _updated(self, actor: Actor, batch: Batch, scale: Any) -> tuple[Actor, Array]:
        o, flat = self.o, ravel_pytree(actor)
        x, u = batch.x.reshape(-1, batch.x.shape[-1]), batch.u.reshape(-1, batch.u.shape[-1])
        f = (features(self._task.angles, batch.x)[..., np.array(self._task.seen)] - scale[0]) / scale[1]
        gain = advantages(f, batch.cost, o.discount, o.trace).ravel()

        def normal(p: Array) -> tuple[Array, Array]:
            own = flat[1](p)
            return self.student.answers(own.arrays, scale, x) / self._half, own.log_sd

        def log_density(p: Array) -> Array:
            mean, log_sd = normal(p)
            return -(0.5 * ((u / self._half - mean) / jnp.exp(log_sd))**2 + log_sd).sum(-1)

        before, old = log_density(flat[0]), normal(flat[0])
        surrogate = lambda p: (jnp.exp(log_density(p) - before) * gain).mean()
        kl = lambda p: normal_kl(*old, *normal(p)).mean()
        product = lambda v: jax.jvp(jax.grad(kl), (flat[0],), (v,))[1] + o.damping * v
        natural = cg(product, jax.grad(surrogate)(flat[0]), maxiter=o.conjugate)[0]
        whole = natural * jnp.sqrt(2 * o.kl / jnp.maximum(1e-300, natural @ product(natural)))
        tries = flat[0] + LENGTHS[:, None] * whole
        good = jax.lax.map(lambda p: (kl(p) <= o.kl) & (surrogate(p) > 0), tries)
        at = jnp.argmax(good)  # the longest that serves
        return flat[1](jnp.where(good.any(), tries[at], flat[0])), jnp.where(good.any(), kl(tries[at]), 0.0)

    def run(self, draw: Callable[[int], tuple[Numbers, Numbers]], updates: int, seed: int) -> list[float]:
        """Mean cost of the episodes before each update; draw(n) gives parameters (n, np) and starts (n, nx)."""
        costs = []
        for i in range(updates):
            batch, _ = self._rollouts(self.actor, *draw(self.o.episodes), jax.random.fold_in(jax.random.key(seed), i))
            costs.append(float(batch.cost.sum(0).mean()))
            self.actor, self.last_kl = self._update(self.actor, batch, self.student.scale)
        self.student.arrays = self.actor.arrays
        return costs
