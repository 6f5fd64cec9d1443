"""The policy: u = middle + half (9 sin v + sin 3 v) / 8, v a network's output, as the runtime's `squash = "sine"`."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from .problem import Array, Motion, Numbers, Scene

HIDDEN = 24


class Policy(eqx.Module):
    net: eqx.nn.MLP
    mean: Array  # of what is seen
    sd: Array
    middle: Array
    half: Array
    angles: tuple[bool, ...] = eqx.field(static=True)

    def __call__(self, state: Array) -> Array:
        v = self.net((observed(state, self.angles) - self.mean) / self.sd)
        return self.middle + self.half * (9 * jnp.sin(v) + jnp.sin(3 * v)) / 8


def observed(state: Array, angles: Sequence[bool]) -> Array:
    """Angles as sine and cosine, the rest as it is."""
    parts = [part for i, turns in enumerate(angles)
             for part in ((jnp.sin(state[..., i]), jnp.cos(state[..., i])) if turns else (state[..., i],))]
    return jnp.stack(parts, -1)


def scale_of(rows: Numbers) -> tuple[Array, Array]:
    """Mean and deviation; one for what does not vary."""
    sd = rows.std(0)
    return jnp.asarray(rows.mean(0)), jnp.asarray(np.where(sd > 1e-9, sd, 1.0))


def make_policy(scene: Scene, states: Numbers, key: Array) -> Policy:
    angles = tuple(bool(a) for a in scene.angles)
    seen = np.asarray(observed(jnp.asarray(states), angles))
    net = eqx.nn.MLP(seen.shape[1], scene.nu, HIDDEN, 2, jax.nn.tanh, key=key)
    net = eqx.tree_at(lambda m: m.layers[-1].weight, net, 0.1 * net.layers[-1].weight)
    return Policy(net, *scale_of(seen), jnp.asarray(0.5 * (scene.low + scene.high)),
                  jnp.asarray(0.5 * (scene.high - scene.low)), angles)


def split(policy: Policy) -> tuple[Any, Any]:
    """The weights that are learnt, and the rest."""
    mask = jax.tree.map(lambda _: False, policy)
    mask = eqx.tree_at(lambda p: p.net, mask, jax.tree.map(eqx.is_inexact_array, policy.net))
    return eqx.partition(policy, mask)


def pairs(motions: Sequence[Motion]) -> tuple[Numbers, Numbers]:
    return np.concatenate([m.states[:-1] for m in motions]), np.concatenate([m.inputs for m in motions])


class Seen:
    """What a critic sees of (x, u): states as the policy does, inputs beside them, in deviations of the shown ones."""

    def __init__(self, scene: Scene, motions: Sequence[Motion]) -> None:
        self._angles = scene.angles.tolist()
        states, inputs = map(jnp.asarray, pairs(motions))
        self._mean, self._sd = scale_of(np.asarray(jnp.concatenate([observed(states, self._angles), inputs], -1)))
        self.size = len(self._mean)

    def __call__(self, states: Array, inputs: Array) -> Array:
        raw = jnp.concatenate([observed(states, self._angles), inputs], -1)
        return jnp.clip((raw - self._mean) / self._sd, -20, 20)


def clone(scene: Scene, motions: Sequence[Motion], key: Array, steps: int = 2000) -> Policy:
    """Behaviour cloning: least squares to the demonstrated inputs."""
    states, inputs = map(jnp.asarray, pairs(motions))
    learnt, fixed = split(make_policy(scene, np.asarray(states), key))
    optimiser = optax.adam(optax.cosine_decay_schedule(5e-3, steps, 0.02))

    def loss(weights: Any) -> Array:
        policy = eqx.combine(weights, fixed)
        return jnp.mean(((jax.vmap(policy)(states) - inputs) / policy.half)**2)

    def step(carry: Any, _: Any) -> tuple[Any, None]:
        weights, state = carry
        updates, state = optimiser.update(jax.grad(loss)(weights), state)
        return (optax.apply_updates(weights, updates), state), None

    (learnt, _), _ = jax.jit(lambda w: jax.lax.scan(step, (w, optimiser.init(w)), None, steps))(learnt)
    return eqx.combine(learnt, fixed)


def roll(scene: Scene, policy: Policy, start: Array, steps: int) -> tuple[Array, Array]:
    """States (steps + 1, .., nx) and inputs (steps, .., nu) from start (.., nx)."""
    act = policy if jnp.ndim(start) == 1 else jax.vmap(policy)

    def period(x: Array, _: Any) -> tuple[Array, tuple[Array, Array]]:
        u = act(x)
        after = scene.step(x, u)
        return after, (after, u)

    _, (states, inputs) = jax.lax.scan(period, jnp.asarray(start), None, steps)
    return jnp.concatenate([jnp.asarray(start)[None], states]), inputs


def weights_of(policy: Policy) -> list[float]:
    """In the order of docs/reference/networks.md, the scale of what is seen folded in."""
    flat: list[float] = []
    for i, layer in enumerate(policy.net.layers):
        weight, bias = np.asarray(layer.weight), np.asarray(layer.bias)
        if i == 0:
            weight = weight / np.asarray(policy.sd)
            bias = bias - weight @ np.asarray(policy.mean)
        flat += np.hstack([bias[:, None], weight]).ravel().tolist()
    return flat
