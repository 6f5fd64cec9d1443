"""What a cost does: the best motion by iLQR, and a receding horizon of such plans."""
from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from .cost import Cost, rollout_features
from .expand import expand
from .expansion import Array, Windows
from .problem import Motion, Numbers, Scene
from .sweep import sweep

TRIES = 12         # step lengths 1, 1/2, ... side by side
TOLERANCE = 1e-9   # relative gain of the cost below which a plan is done

Planned = tuple[Array, Array, Array]  # states, inputs, cost


def _rolled(scene: Scene, start: Array, guess: Array, before: Array) -> Planned:
    """Inputs within their limits, of size and of change, from a guess."""
    def period(carry: tuple[Array, Array], u: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        x, earlier = carry
        u = jnp.clip(u, jnp.maximum(scene.low, earlier - scene.most_change),
                     jnp.minimum(scene.high, earlier + scene.most_change))
        after = scene.step(x, u)
        return (after, u), (after, u)

    _, (states, inputs) = jax.lax.scan(period, (start, before), guess)
    return jnp.concatenate([start[None], states]), inputs, jnp.zeros(())


def _followed(scene: Scene, states: Array, inputs: Array, before: Array, gain: Array, wish: Array,
              length: Array) -> tuple[Array, Array]:
    """The policy's feedback around a motion, with `length` of its wish."""
    earlier = jnp.concatenate([before[None], inputs[:-1]])
    rates = gain.shape[-1] > scene.nx

    def period(carry: tuple[Array, Array], at: tuple[Array, ...]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        x, u_before = carry
        x_then, u_then, before_then, k, w = at
        off = scene.difference(x, x_then)
        if rates:
            off = jnp.concatenate([off, u_before - before_then])
        low = jnp.maximum(scene.low, u_before - scene.most_change)
        high = jnp.minimum(scene.high, u_before + scene.most_change)
        u = jnp.clip(u_then + length * w + k @ off, low, high)
        after = scene.step(x, u)
        return (after, u), (after, u)

    _, (x, u) = jax.lax.scan(period, (states[0], before), (states[:-1], inputs, earlier, gain, wish))
    return jnp.concatenate([states[:1], x]), u


class Planner:
    """iLQR under a cost whose groups have given coefficients; compiled once for each horizon. Limits of size and of
    change are kept; of what presses against a limit the feedback is left out."""

    def __init__(self, scene: Scene, cost: Cost) -> None:
        self.scene, self.cost = scene, cost
        self._plan: Callable[..., Planned] = jax.jit(self._iterate, static_argnames="given")

    def value(self, coefficient: Array, start: Array, inputs: Array, before: Array) -> Array:
        return jnp.einsum("g,g...->...", coefficient, rollout_features(self.cost, start, inputs, before))

    def _iterate(self, coefficient: Array, start: Array, guess: Array, before: Array, iterations: Array,
                 given: bool) -> Planned:
        scene, steps = self.scene, guess.shape[0]
        one = Windows(jnp.zeros(1, int), jnp.zeros(1, int), jnp.full(1, steps), True, steps)
        lengths = 0.5 ** jnp.arange(TRIES)

        def better(carry: tuple[Planned, Array, Array]) -> tuple[Planned, Array, Array]:
            (states, inputs, now), count, _ = carry
            e = expand(scene, self.cost, states, inputs, None if given else before, share=1e-12)
            p = sweep(jax.tree.map(lambda a: a[None], e), coefficient, one, planning=True)
            tries = jax.vmap(lambda length: _followed(scene, states, inputs, before, p.gain[:, 0], p.wish[:, 0],
                                                      length))(lengths)
            values = self.value(coefficient, start, tries[1], before)
            values = jnp.where(jnp.isfinite(values) & jnp.isfinite(tries[0]).all((1, 2)), values, jnp.inf)
            best = jnp.argmin(values)
            gained = now - values[best]
            good = gained > 0
            chosen = (jnp.where(good, tries[0][best], states), jnp.where(good, tries[1][best], inputs),
                      jnp.where(good, values[best], now))
            return chosen, count + 1, gained <= TOLERANCE * jnp.abs(now)

        states, inputs, _ = _rolled(scene, start, guess, before)
        first = (states, inputs, self.value(coefficient, start, inputs, before))
        return jax.lax.while_loop(lambda c: (c[1] < iterations) & ~c[2], better,
                                  (first, jnp.zeros((), int), jnp.zeros((), bool)))[0]

    def best(self, coefficient: Numbers, start: Numbers, guess: Numbers, before: Numbers | None = None,
             iterations: int = 100) -> tuple[Motion, float]:
        """`before` None: the first input stays the guess's where changes of inputs cost."""
        states, inputs, value = self._plan(jnp.asarray(coefficient), jnp.asarray(start), jnp.asarray(guess),
                                           jnp.asarray(guess[0] if before is None else before),
                                           jnp.asarray(iterations), before is None)
        return Motion(np.asarray(states), np.asarray(inputs)), float(value)

    def recede(self, coefficient: Numbers, demonstrated: Motion, horizon: int) -> Motion:
        """At each period the best plan of `horizon` periods, its first input. Where changes of inputs cost, the first
        input is the demonstrated one."""
        motion = Motion(demonstrated.states.copy(), demonstrated.inputs.copy())
        first = int(self.cost.has_rates)
        plan = demonstrated.inputs[first:first + horizon]
        plan = np.concatenate([plan, np.repeat(plan[-1:], horizon - len(plan), 0)])
        for k in range(first, demonstrated.steps):
            before = motion.inputs[k - 1] if k else plan[0]
            plan = self.best(coefficient, motion.states[k], plan, before, 200 if k == first else 10)[0].inputs
            motion.inputs[k] = plan[0]
            motion.states[k + 1] = np.asarray(self.scene.step(motion.states[k], plan[0]))
            plan = np.concatenate([plan[1:], plan[-1:]])
        return motion

    def replay(self, coefficient: Numbers, demonstrated: Motion, horizon: int) -> Motion:
        """What the cost does from the demonstration's start: one plan to its end (horizon 0), or a receding one."""
        if horizon:
            return self.recede(coefficient, demonstrated, horizon)
        return self.best(coefficient, demonstrated.states[0], demonstrated.inputs)[0]
