"""A policy without a critic beside it: IQ-Learn (Garg, Chakraborty, Cundy, Song and Ermon, NeurIPS 2021).

One soft Q function is learnt, whose own reward r = Q(x, u) - discount V(x') is large where was demonstrated:

    max over Q   mean r - 1/(4 alpha) mean r^2 (both sides) - mean of V(x) - discount V(x')      V = E[Q - T log pi]

with the first mean over the demonstrations, and the policy always the one that makes V largest. r^2 is the paper's
divergence chi^2. The policy is Gaussian around the network's answer while it learns. As in the authors' scripts
the policy learns at a tenth of Q's rate, V(x') is of a Q that follows slowly, and the policy's transitions are kept.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from .adversarial import Adversarial, play
from .network import HIDDEN, Seen, clone, pairs, split
from .problem import Array, Motion, Scene


@dataclass(frozen=True)
class IqOptions:
    iterations: int = 400
    rollouts: int = 16       # of an iteration, from states around the demonstrated ones
    steps: int = 60          # periods of a rollout
    updates: int = 5         # of an iteration: Q, then the policy
    batch: int = 128         # transitions of each side
    answers: int = 4         # of the policy at a state, for V
    discount: float = 0.97
    alpha: float = 0.5
    temperature: float = 0.01
    first_sd: float = 0.1    # of the policy's noise, in half ranges
    spread: float = 0.5      # of the rollouts' starts, in deviations of the demonstrated states
    rate: float = 1e-3       # of Q; falls to a twentieth
    policy_rate: float = 1e-4
    follow: float = 0.02     # of an update, of the Q of V(x')
    kept: int = 400          # iterations whose transitions are kept
    seed: int = 1


class _State(NamedTuple):
    q: Any
    later_q: Any
    actor: Any  # the policy's weights, and the logarithm of its noise
    q_adam: Any
    actor_adam: Any
    average: Any
    kept: tuple[Array, Array, Array]  # transitions of the policy
    played: Array                     # iterations


class _Learner:
    def __init__(self, scene: Scene, motions: Sequence[Motion], options: IqOptions, fixed: Any) -> None:
        self.scene, self.o, self.fixed = scene, options, fixed
        states, inputs = pairs(motions)
        self.shown = tuple(map(jnp.asarray, (states, inputs, np.concatenate([m.states[1:] for m in motions]))))
        self.state_sd = jnp.asarray(states.std(0))
        self.half = jnp.asarray(0.5 * (scene.high - scene.low))
        self.seen = Seen(scene, motions)
        many = options.iterations * options.updates
        self.q_adam, self.actor_adam = (
            optax.chain(optax.clip_by_global_norm(10.0), optax.adam(optax.linear_schedule(rate, 0.05 * rate, many)))
            for rate in (options.rate, options.policy_rate))

    def q(self, q: Any, x: Array, u: Array) -> Array:
        return q(self.seen(x, u))[0]

    def value(self, q: Any, actor: Any, x: Array, key: Array) -> Array:
        """V at a state, by `answers` draws of the policy."""
        weights, log_sd = actor
        noise = jax.random.normal(key, (self.o.answers, self.scene.nu))
        u = eqx.combine(weights, self.fixed)(x) + self.half * jnp.exp(log_sd) * noise
        log_density = -log_sd.sum() - 0.5 * (noise**2).sum(-1)
        worth = jax.vmap(lambda one: self.q(q, x, one))(jnp.clip(u, self.scene.low, self.scene.high))
        return (worth - self.o.temperature * log_density).mean()

    def values(self, q: Any, actor: Any, x: Array, key: Array) -> Array:
        return jax.vmap(lambda one, k: self.value(q, actor, one, k))(x, jax.random.split(key, len(x)))

    def loss(self, learnt: Any, later_q: Any, still: Any, actor: Any, shown: Any, made: Any, key: Array) -> Array:
        q, n = eqx.combine(learnt, still), len(shown[0])
        x, u, after = (jnp.concatenate(both) for both in zip(shown, made, strict=True))
        before, then = jax.random.split(key)
        later = self.o.discount * self.values(eqx.combine(later_q, still), actor, after, then)
        reward = jax.vmap(lambda a, b: self.q(q, a, b))(x, u) - later
        return ((self.values(q, actor, x, before) - later).mean() - reward[:n].mean()
                + (reward**2).mean() / (4 * self.o.alpha))

    def update(self, carry: Any, key: Array, still: Any, kept: Any, many: Array) -> tuple[Any, None]:
        q, later_q, actor, q_adam, actor_adam = carry
        k = jax.random.split(key, 4)
        shown, made = (tuple(part[rows] for part in side) for side, rows in (
            (side, jax.random.randint(one, (self.o.batch,), 0, count))
            for side, count, one in ((self.shown, len(self.shown[0]), k[0]), (kept, many, k[1]))))
        slopes = jax.grad(self.loss)(q, later_q, still, actor, shown, made, k[2])
        change, q_adam = self.q_adam.update(slopes, q_adam)
        q = eqx.apply_updates(q, change)
        later_q = jax.tree.map(lambda a, b: a + self.o.follow * (b - a), later_q, q)
        x = jnp.concatenate([shown[0], made[0]])
        slopes = jax.grad(lambda a: -self.values(eqx.combine(q, still), a, x, k[3]).mean())(actor)
        change, actor_adam = self.actor_adam.update(slopes, actor_adam)
        weights, log_sd = eqx.apply_updates(actor, change)
        return (q, later_q, (weights, jnp.clip(log_sd, -5.0, 0.0)), q_adam, actor_adam), None

    def rollouts(self, actor: Any, key: Array) -> tuple[Array, Array, Array]:
        """Transitions of the policy with its noise, from demonstrated states that are moved."""
        weights, log_sd = actor
        policy, k = jax.vmap(eqx.combine(weights, self.fixed)), jax.random.split(key, 3)
        start = self.shown[0][jax.random.randint(k[0], (self.o.rollouts,), 0, len(self.shown[0]))]
        start = start + self.o.spread * self.state_sd * jax.random.normal(k[1], start.shape)

        def period(x: Array, one: Array) -> tuple[Array, tuple[Array, Array, Array]]:
            u = policy(x) + self.half * jnp.exp(log_sd) * jax.random.normal(one, (len(x), self.scene.nu))
            u = jnp.clip(u, self.scene.low, self.scene.high)
            after = self.scene.step(x, u)
            after = jnp.where(jnp.isfinite(after).all(-1, keepdims=True), after, x)
            return after, (x, u, after)

        made = jax.lax.scan(period, start, jax.random.split(k[2], self.o.steps))[1]
        return tuple(part.reshape(-1, part.shape[-1]) for part in made)

    def start(self, q: Any, weights: Any) -> _State:
        learnt, many = eqx.filter(q, eqx.is_inexact_array), self.o.kept * self.o.rollouts * self.o.steps
        actor = (weights, jnp.full(self.scene.nu, np.log(self.o.first_sd)))
        kept = tuple(jnp.zeros((many, part.shape[-1])) for part in self.shown)
        return _State(q, learnt, actor, self.q_adam.init(learnt), self.actor_adam.init(actor), weights, kept,
                      jnp.array(0))

    def round(self, s: _State, key: Array) -> tuple[_State, Array]:
        by, then = jax.random.split(key)
        made = self.rollouts(s.actor, by)
        kept = tuple(jax.lax.dynamic_update_slice(all_of, part, (s.played % self.o.kept * len(part), 0))
                     for all_of, part in zip(s.kept, made, strict=True))
        many = jnp.minimum(s.played + 1, self.o.kept) * len(made[0])
        learnt, still = eqx.partition(s.q, eqx.is_inexact_array)
        carry = (learnt, s.later_q, s.actor, s.q_adam, s.actor_adam)
        carry, _ = jax.lax.scan(lambda c, k: self.update(c, k, still, kept, many), carry,
                                jax.random.split(then, self.o.updates))
        q, actor = eqx.combine(carry[0], still), carry[2]
        average = jax.tree.map(lambda a, w: a + 0.02 * (w - a), s.average, actor[0])
        worth = [jax.vmap(lambda a, b: self.q(q, a, b))(x, u).mean() for x, u, _ in (self.shown, made)]
        return _State(q, carry[1], actor, carry[3], carry[4], average, kept, s.played + 1), worth[0] - worth[1]


def fit_iq(scene: Scene, motions: Sequence[Motion], options: IqOptions,
           progress: Callable[[float], None] | None = None) -> Adversarial:
    """Begins at behaviour cloning and gives the running average of the weights. Same seed, same policy. Ctrl-C ends it
    with what was reached. `gap` is the mean of Q over the demonstrations less that over rollouts."""
    key_policy, key_q, key = jax.random.split(jax.random.key(options.seed), 3)
    cloned = clone(scene, motions, key_policy)
    weights, fixed = split(cloned)
    learner = _Learner(scene, motions, options, fixed)
    q = eqx.nn.MLP(learner.seen.size, 1, HIDDEN, 2, jax.nn.tanh, key=key_q)
    state, gap = play(learner.round, learner.start(q, weights), key, options.iterations, progress)
    return Adversarial(eqx.combine(state.average, fixed), cloned, gap)
