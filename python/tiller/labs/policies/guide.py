"""First motions for guided search: iLQR on the robot file's model, from many guesses side by side."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .minimise import Numbers
from .moments import Array

GUESSES, KNOT = 16, 5  # of random commands, each held for so many periods
ITERATIONS, LENGTHS = 80, 10  # step lengths 1, 1/2, ... side by side
DONE = 1e-6  # relative gain


class Goal(NamedTuple):
    """Cost 1/2 (x - target)' Q (x - target) + 1/2 u' R u a period, and the last state's by its own weights; within
    limits. Without angles' turns."""
    target: Numbers  # (nx)
    state: Numbers  # (nx) weights
    terminal: Numbers
    control: Numbers  # (nu), above zero
    low: Numbers
    high: Numbers

    def of(self, x: Array, u: Array) -> Array:
        """Of states (T + 1, nx) and commands (T, nu)."""
        off = x - self.target
        return 0.5 * ((off[:-1]**2 @ self.state).sum() + off[-1]**2 @ self.terminal + (u**2 @ self.control).sum())


def _followed(step: Callable[[Array], Array], goal: Goal, x: Array, u: Array, gain: Array, wish: Array,
              length: Array) -> tuple[Array, Array]:
    def period(now: Array, at: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        x_then, u_then, k, w = at
        command = jnp.clip(u_then + length * w + k @ (now - x_then), goal.low, goal.high)
        after = step(jnp.concatenate([now, command]))
        return after, (after, command)

    _, (states, commands) = jax.lax.scan(period, x[0], (x[:-1], u, gain, wish))
    return jnp.concatenate([x[:1], states]), commands


def _policy(step: Callable[[Array], Array], goal: Goal, x: Array, u: Array) -> tuple[Array, Array]:
    """Gain and wish (T, ...) of the Riccati sweep; a command that is pressed against a limit has neither."""
    nx = x.shape[1]
    slopes = jax.vmap(jax.jacfwd(step))(jnp.concatenate([x[:-1], u], 1))

    def back(carry: tuple[Array, Array], at: tuple[Array, ...]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        value, by = carry
        slope, state, command = at
        a, b = slope[:, :nx], slope[:, nx:]
        q_x, q_u = goal.state * (state - goal.target) + a.T @ by, goal.control * command + b.T @ by
        q_uu, q_ux = jnp.diag(goal.control) + b.T @ value @ b, b.T @ value @ a
        free = ~((command <= goal.low) & (q_u > 0) | (command >= goal.high) & (q_u < 0))
        held = jnp.where(free[:, None] & free, q_uu, jnp.eye(len(q_u)))
        wish = -jnp.linalg.solve(held, jnp.where(free, q_u, 0.0))
        gain = -jnp.linalg.solve(held, jnp.where(free[:, None], q_ux, 0.0))
        value = jnp.diag(goal.state) + a.T @ value @ a + gain.T @ q_uu @ gain + gain.T @ q_ux + q_ux.T @ gain
        by = q_x + gain.T @ (q_u + q_uu @ wish) + q_ux.T @ wish
        return (0.5 * (value + value.T), by), (gain, wish)

    end = jnp.diag(goal.terminal), goal.terminal * (x[-1] - goal.target)
    return jax.lax.scan(back, end, (slopes, x[:-1], u), reverse=True)[1]  # type: ignore[no-any-return]


def best_motion(step: Callable[[Array], Array], goal: Goal, start: Numbers, horizon: int,
                seed: int) -> tuple[Numbers, Numbers, Numbers]:
    """States (T + 1, nx), commands (T, nu) and gains (T, nu, nx) of the cheapest of GUESSES descents. step (nx + nu) ->
    (nx) is a function of JAX. Cost: ITERATIONS x GUESSES x LENGTHS rollouts at most."""
    rng, nu, nx = np.random.default_rng([seed, 94]), len(goal.low), len(start)
    share = rng.random((GUESSES, -(-horizon // KNOT), nu)) * np.linspace(0, 1, GUESSES)[:, None, None]
    middle = np.clip(0, goal.low, goal.high)
    sign = rng.choice([-1, 1], share.shape)
    u = middle + share * np.where(sign > 0, goal.high - middle, goal.low - middle)
    u = np.repeat(u, KNOT, 1)[:, :horizon]
    still = jnp.zeros((horizon, nu, nx))
    follow = lambda x, u, gain, wish, length: _followed(step, goal, x, u, gain, wish, length)

    @jax.jit
    def begin(u: Array) -> tuple[Array, Array, Array]:
        x = jax.vmap(lambda u: follow(jnp.tile(start, (horizon + 1, 1)), u, still, jnp.zeros_like(u), 0.0)[0])(u)
        return x, u, jax.vmap(goal.of)(x, u)

    @jax.jit
    def better(x: Array, u: Array, cost: Array) -> tuple[Array, Array, Array]:
        def one(x: Array, u: Array, cost: Array) -> tuple[Array, Array, Array]:
            gain, wish = _policy(step, goal, x, u)
            xs, us = jax.vmap(lambda s: follow(x, u, gain, wish, s))(0.5 ** jnp.arange(LENGTHS))
            costs = jax.vmap(goal.of)(xs, us)
            costs = jnp.where(jnp.isfinite(costs), costs, jnp.inf)
            at = jnp.argmin(costs)
            good = costs[at] < cost
            return jnp.where(good, xs[at], x), jnp.where(good, us[at], u), jnp.where(good, costs[at], cost)
        return jax.vmap(one)(x, u, cost)

    x, u, cost = begin(u)
    for _ in range(ITERATIONS):
        before = cost
        x, u, cost = better(x, u, cost)
        if np.all(np.asarray(before - cost) <= DONE * np.asarray(cost)):
            break
    at = int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))
    gain, _ = jax.jit(lambda x, u: _policy(step, goal, x, u))(x[at], u[at])
    return np.asarray(x[at]), np.asarray(u[at]), np.asarray(gain)
