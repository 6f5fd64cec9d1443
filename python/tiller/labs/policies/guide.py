"""First motions for guided search: iLQR on the robot file's model, from many guesses side by side."""
from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .minimise import Numbers
from .moments import Array
from .physics import Physics

GUESSES, KNOT = 24, 5  # of random commands, each held for so many periods
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


def _followed(physics: Physics, goal: Goal, x: Array, u: Array, gain: Array, wish: Array,
              length: Array) -> tuple[Array, Array]:
    def period(now: Array, at: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        x_then, u_then, k, w = at
        command = jnp.clip(u_then + length * w + k @ (now - x_then), goal.low, goal.high)
        after, _ = physics(jnp.concatenate([now, command]))
        return after, (after, command)

    _, (states, commands) = jax.lax.scan(period, x[0], (x[:-1], u, gain, wish))
    return jnp.concatenate([x[:1], states]), commands


def _policy(physics: Physics, goal: Goal, x: Array, u: Array) -> tuple[Array, Array]:
    """Gain and wish (T, ...) of the Riccati sweep; a command that is pressed against a limit has neither."""
    nx = x.shape[1]
    slopes = jax.vmap(physics)(jnp.concatenate([x[:-1], u], 1))[1]

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
    return jax.lax.scan(back, end, (slopes, x[:-1], u), reverse=True)[1]


def _guesses(goal: Goal, horizon: int, seed: int) -> Numbers:
    """(GUESSES, T, nu) from none to all of the range."""
    rng, nu = np.random.default_rng([seed, 94]), len(goal.low)
    share = rng.random((GUESSES, -(-horizon // KNOT), nu)) * np.linspace(0, 1, GUESSES)[:, None, None]
    middle = np.clip(0, goal.low, goal.high)
    side = np.where(rng.random(share.shape) < 0.5, goal.high - middle, goal.low - middle)
    return np.repeat(middle + share * side, KNOT, 1)[:, :horizon]


def best_motions(physics: Physics, goal: Goal, starts: Numbers, horizon: int,
                 seed: int) -> tuple[Numbers, Numbers, Numbers]:
    """States (n, T + 1, nx), commands (n, T, nu) and gains (n, T, nu, nx) of the cheapest of GUESSES descents from each
    start (n, nx). The gains are those without limits: `goal` may leave them room. Cost: ITERATIONS x GUESSES x LENGTHS
    x n rollouts, twice, at most."""
    count, nu, nx = len(starts), len(goal.low), starts.shape[1]
    still = jnp.zeros((horizon, nu, nx))

    @jax.jit
    def begin(start: Array, u: Array) -> tuple[Array, Array, Array]:
        def one(start: Array, u: Array) -> Array:
            return _followed(physics, goal, jnp.tile(start, (horizon + 1, 1)), u, still, jnp.zeros_like(u), 0.0)[0]
        x = jax.vmap(one)(start, u)
        return x, u, jax.vmap(goal.of)(x, u)

    @jax.jit
    def better(x: Array, u: Array, cost: Array) -> tuple[Array, Array, Array]:
        def one(x: Array, u: Array, cost: Array) -> tuple[Array, Array, Array]:
            gain, wish = _policy(physics, goal, x, u)
            xs, us = jax.vmap(lambda s: _followed(physics, goal, x, u, gain, wish, s))(0.5 ** jnp.arange(LENGTHS))
            costs = jax.vmap(goal.of)(xs, us)
            costs = jnp.where(jnp.isfinite(costs), costs, jnp.inf)
            at = jnp.argmin(costs)
            good = costs[at] < cost
            return jnp.where(good, xs[at], x), jnp.where(good, us[at], u), jnp.where(good, costs[at], cost)
        return jax.vmap(one)(x, u, cost)

    guesses = np.tile(_guesses(goal, horizon, seed), (count, 1, 1))
    for _ in range(2):  # then from what was best of any start too: starts are near each other
        x, u, cost = begin(np.repeat(starts, GUESSES, 0), guesses)
        for _ in range(ITERATIONS):
            before = cost
            x, u, cost = better(x, u, cost)
            if np.all(np.asarray(before - cost) <= DONE * np.asarray(cost)):
                break
        total = np.where(np.isfinite(cost), cost, np.inf)
        guesses = np.array(u)
        guesses[::GUESSES] = u[int(total.argmin())]
    least = total.reshape(count, GUESSES).argmin(1) + GUESSES * np.arange(count)
    free = goal._replace(low=np.full(nu, -np.inf), high=np.full(nu, np.inf))
    gain, _ = jax.jit(jax.vmap(lambda x, u: _policy(physics, free, x, u)))(x[least], u[least])
    return np.asarray(x[least]), np.asarray(u[least]), np.asarray(gain)
