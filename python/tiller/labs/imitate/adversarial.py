"""A policy whose rollouts a critic cannot tell from the demonstrations: GAIL (Ho and Ermon, NIPS 2016) and its
Wasserstein form, with the policy's gradient through the robot's model (Baram and others, ICML 2017)."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from .network import HIDDEN, Policy, Seen, clone, pairs, split
from .problem import Array, Motion, Scene


@dataclass(frozen=True)
class AdversarialOptions:
    wasserstein: bool = False
    iterations: int = 400
    batch: int = 16          # rollouts from demonstrated states, in each iteration
    elsewhere: int = 16      # rollouts from starts around those, which the critic does not see
    spread: float = 1.0      # of these starts, over the deviation of the demonstrated ones
    steps: int = 60          # periods of a rollout
    critic_steps: int = 5    # of each iteration; of a Wasserstein critic twice as many
    policy_rate: float = 1e-3
    critic_rate: float = 3e-3
    penalty: float = 10.0    # of the critic's slopes (Gulrajani and others 2017); GAIL's is a two-hundredth
    noise: float = 0.1       # on both sides' samples, in their deviations
    longest: float = 10.0    # of an adjoint, over the periods that it comes from
    seed: int = 1


@dataclass
class Adversarial:
    policy: Policy
    cloned: Policy
    gap: list[float] = field(default_factory=list)  # mean of the critic over demonstrations less that over rollouts


class _State(NamedTuple):
    weights: Any
    critic: Any
    policy_adam: Any
    critic_adam: Any
    average: Any


@jax.custom_vjp
def _limited(x: Array, scale: Array, longest: Array) -> Array:
    """x, whose adjoint is cut to a length: those of an unstable motion grow without bound."""
    return x


def _limited_forward(x: Array, scale: Array, longest: Array) -> tuple[Array, tuple[Array, Array]]:
    return x, (scale, longest)


def _limited_backward(kept: tuple[Array, Array], by: Array) -> tuple[Array, None, None]:
    scale, longest = kept
    by = jnp.where(jnp.isfinite(by), by, 0.0)
    length = jnp.linalg.norm(by * scale, axis=-1, keepdims=True)
    return by * jnp.minimum(1.0, longest / jnp.maximum(length, 1e-300)), None, None


_limited.defvjp(_limited_forward, _limited_backward)


class _Game:
    def __init__(self, scene: Scene, motions: Sequence[Motion], options: AdversarialOptions, cloned: Policy) -> None:
        self.scene, self.o = scene, options
        self.steps = min([options.steps, *(m.steps for m in motions)])
        states, _ = pairs(motions)
        self.state_sd = jnp.asarray(np.where(states.std(0) > 1e-9, states.std(0), 1.0))
        self.seen = Seen(scene, motions)
        longest = max(m.steps for m in motions)
        self.states = jnp.stack([jnp.pad(m.states, ((0, longest - m.steps), (0, 0))) for m in motions])
        self.inputs = jnp.stack([jnp.pad(m.inputs, ((0, longest - m.steps), (0, 0))) for m in motions])
        self.last = jnp.array([m.steps - self.steps for m in motions])
        _, self.fixed = split(cloned)
        decay = optax.linear_schedule(options.policy_rate, 0.05 * options.policy_rate, options.iterations)
        self.policy_adam = optax.chain(optax.clip_by_global_norm(10.0), optax.adam(decay, b1=0.8))
        self.critic_adam = optax.adam(options.critic_rate, b1=0.5)

    def starts(self, key: Array) -> tuple[Array, Array]:
        """Demonstrated states, and what was demonstrated from there on: an expert's rollouts are then the
        demonstrations."""
        of, when = jax.random.split(key)
        motion = jax.random.randint(of, (self.o.batch,), 0, len(self.last))
        first = jax.random.randint(when, (self.o.batch,), 0, self.last[motion] + 1)
        rows = first[:, None] + jnp.arange(self.steps)
        return self.states[motion, first], self.seen(self.states[motion[:, None], rows],
                                                     self.inputs[motion[:, None], rows])

    def around(self, key: Array) -> Array:
        """Starts around those demonstrated: the critic's slopes lead from there to what was shown."""
        of, by = jax.random.split(key)
        begin = self.states[jax.random.randint(of, (self.o.elsewhere,), 0, len(self.last)), 0]
        spread = jnp.maximum(jnp.std(self.states[:, 0], 0), 0.1 * self.state_sd)
        return begin + self.o.spread * spread * jax.random.normal(by, begin.shape)

    def rollouts(self, weights: Any, start: Array) -> Array:
        """(periods, rollouts, seen)."""
        policy = jax.vmap(eqx.combine(weights, self.fixed))
        periods_left = jnp.arange(self.steps, 0, -1.0)

        def period(x: Array, left: Array) -> tuple[Array, Array]:
            x = _limited(x, self.state_sd, self.o.longest * left)
            u = policy(x)
            return self.scene.step(x, u), self.seen(x, u)

        return jax.lax.scan(period, start, periods_left)[1]

    def critic_loss(self, critic: Any, shown: Array, made: Array, between: Array) -> Array:
        of = jax.vmap(critic)
        slope = jnp.linalg.norm(jax.vmap(jax.grad(lambda z: critic(z)[0]))(between) + 1e-12, axis=-1)
        if self.o.wasserstein:
            return of(made).mean() - of(shown).mean() + self.o.penalty * ((slope - 1)**2).mean()
        return (jax.nn.softplus(-of(shown)).mean() + jax.nn.softplus(of(made)).mean()
                + self.o.penalty / 200 * (slope**2).mean())

    def improve_critic(self, carry: Any, key: Array, shown: Array, made: Array) -> tuple[Any, None]:
        critic, state = carry
        k = jax.random.split(key, 5)
        draw = [rows[jax.random.randint(k[i], (128,), 0, len(rows))] for i, rows in enumerate((shown, made))]
        draw = [rows + self.o.noise * jax.random.normal(k[2 + i], rows.shape) for i, rows in enumerate(draw)]
        between = draw[0] + jax.random.uniform(k[4], (128, 1)) * (draw[1] - draw[0])
        learnt, fixed = eqx.partition(critic, eqx.is_inexact_array)
        slopes = jax.grad(lambda c: self.critic_loss(eqx.combine(c, fixed), draw[0], draw[1], between))(learnt)
        updates, state = self.critic_adam.update(slopes, state)
        return (eqx.apply_updates(critic, updates), state), None

    def policy_loss(self, weights: Any, critic: Any, start: Array) -> Array:
        of = jax.vmap(jax.vmap(critic))(self.rollouts(weights, start))
        return -of.mean() if self.o.wasserstein else jax.nn.softplus(-of).mean()

    def round(self, s: _State, key: Array) -> tuple[_State, Array]:
        keys = jax.random.split(key, 3)
        start, shown = self.starts(keys[0])
        made = self.rollouts(s.weights, start)
        shown, flat = shown.reshape(-1, shown.shape[-1]), made.reshape(-1, made.shape[-1])
        flat = jnp.where(jnp.isfinite(flat), flat, 20.0)
        count = self.o.critic_steps * (2 if self.o.wasserstein else 1)
        learnt, fixed = eqx.partition(s.critic, eqx.is_array)
        carry = jax.lax.scan(
            lambda c, k: (lambda new: ((eqx.filter(new[0], eqx.is_array), new[1]), None))(
                self.improve_critic((eqx.combine(c[0], fixed), c[1]), k, shown, flat)[0]),
            (learnt, s.critic_adam), jax.random.split(keys[1], count))[0]
        critic = eqx.combine(carry[0], fixed)
        start = jnp.concatenate([start, self.around(keys[2])]) if self.o.elsewhere else start
        slopes = jax.grad(self.policy_loss)(s.weights, critic, start)
        finite = jnp.all(jnp.array([jnp.isfinite(g).all() for g in jax.tree.leaves(slopes)]))
        slopes = jax.tree.map(lambda g: jnp.where(finite, g, 0.0), slopes)
        updates, adam = self.policy_adam.update(slopes, s.policy_adam)
        weights = eqx.apply_updates(s.weights, updates)
        average = jax.tree.map(lambda a, w: a + 0.02 * (w - a), s.average, weights)
        gap = jax.vmap(critic)(shown).mean() - jax.vmap(critic)(flat).mean()
        return _State(weights, critic, adam, carry[1], average), gap


def play(one_round: Any, state: Any, key: Array, iterations: int,
         progress: Callable[[float], None] | None) -> tuple[Any, list[float]]:
    """Rounds (state, key) -> (state, gap). Ctrl-C ends them with what was reached."""
    step, gap = eqx.filter_jit(one_round), []
    try:
        for i in range(iterations):
            state, apart = step(state, jax.random.fold_in(key, i))
            gap.append(float(apart))
            if progress:
                progress((i + 1) / iterations)
    except KeyboardInterrupt:
        if not gap:
            raise
    return state, gap


def fit_policy(scene: Scene, motions: Sequence[Motion], options: AdversarialOptions,
               progress: Callable[[float], None] | None = None) -> Adversarial:
    """Begins at behaviour cloning; the policy that is returned is the running average of the weights, for the two sides
    circle around the equilibrium. Same seed, same policy. Ctrl-C ends it with what was reached."""
    key_policy, key_critic, key = jax.random.split(jax.random.key(options.seed), 3)
    cloned = clone(scene, motions, key_policy)
    game = _Game(scene, motions, options, cloned)
    critic = eqx.nn.MLP(game.seen.size, 1, HIDDEN, 2, jax.nn.tanh, key=key_critic)
    weights, fixed = split(cloned)
    state = _State(weights, critic, game.policy_adam.init(weights),
                   game.critic_adam.init(eqx.filter(critic, eqx.is_inexact_array)), weights)
    state, gap = play(game.round, state, key, options.iterations, progress)
    return Adversarial(eqx.combine(state.average, fixed), cloned, gap)
