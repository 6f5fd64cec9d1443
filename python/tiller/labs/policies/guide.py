"""iLQR on the robot file's model, from many guesses side by side: guided search's first motions, and its teacher."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .minimise import Numbers
from .moments import Array
from .physics import Physics

GUESSES, KNOT, FEW = 192, 5, 12  # random commands, each held for so many periods; the best that are followed
SWEEPS, LENGTHS = 80, 10  # step lengths 1, 1/2, ... side by side
ROWS = 96  # motions side by side
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


Motion = tuple[Array, Array]


class Motions(NamedTuple):
    x: Numbers  # (n, T + 1, nx)
    u: Numbers  # (n, T, nu)
    cost: Numbers  # (n)

    def of(self, which: Any) -> Motions:
        return Motions(self.x[which], self.u[which], self.cost[which])

    @classmethod
    def joined(cls, parts: list[Motions]) -> Motions:
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _in_rows(function: Callable[..., Any], *arrays: Numbers) -> list[Numbers]:
    """What a program of ROWS rows gives for any number of them."""
    n = len(arrays[0])
    wide = [np.concatenate([a, np.repeat(a[-1:], -n % ROWS, 0)]) for a in arrays]
    parts = [function(*(a[i:i + ROWS] for a in wide)) for i in range(0, len(wide[0]), ROWS)]
    return [np.concatenate(column)[:n] for column in zip(*parts, strict=True)]


def track(physics: Physics, goal: Goal, start: Array, x: Array, u: Array, gain: Array, more: Array) -> Motion:
    """From a start, u + more with feedback from x (T + 1, nx), within the limits: states and commands."""
    def period(now: Array, at: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        x_then, u_then, k = at
        command = jnp.clip(u_then + k @ (now - x_then), goal.low, goal.high)
        after, _ = physics(jnp.concatenate([now, command]))
        return after, (after, command)

    _, (states, commands) = jax.lax.scan(period, start, (x[:-1], u + more, gain))
    return jnp.concatenate([start[None], states]), commands


def sweep(physics: Physics, goal: Goal, x: Array, u: Array) -> tuple[Array, Array]:
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


def follow(physics: Physics, goal: Goal, start: Array, u: Array) -> Array:
    """States (T + 1, nx) under commands (T, nu)."""
    nothing = jnp.zeros((len(u), len(goal.low), len(start)))
    return track(physics, goal, start, jnp.tile(start, (len(u) + 1, 1)), u, nothing, jnp.zeros_like(u))[0]


def descend(physics: Physics, goal: Goal, x: Array, u: Array, cost: Array) -> tuple[Array, Array, Array]:
    """A sweep of iLQR from a motion and its cost: the cheapest of some lengths, or the same again."""
    gain, wish = sweep(physics, goal, x, u)
    xs, us = jax.vmap(lambda s: track(physics, goal, x[0], x, u, gain, s * wish))(0.5 ** jnp.arange(LENGTHS))
    costs = jax.vmap(goal.of)(xs, us)
    costs = jnp.where(jnp.isfinite(costs), costs, jnp.inf)
    at = jnp.argmin(costs)
    good = costs[at] < cost
    return jnp.where(good, xs[at], x), jnp.where(good, us[at], u), jnp.where(good, costs[at], cost)


def random_commands(goal: Goal, count: int, horizon: int, rng: np.random.Generator) -> Numbers:
    """(count, T, nu) from none to all of the range, each held for KNOT periods."""
    share = rng.random((count, -(-horizon // KNOT), len(goal.low))) * np.linspace(0, 1, count)[:, None, None]
    middle = np.clip(0, goal.low, goal.high)
    side = np.where(rng.random(share.shape) < 0.5, goal.high - middle, goal.low - middle)
    return np.repeat(middle + share * side, KNOT, 1)[:, :horizon]


class Guide:
    """iLQR from many starts and guesses side by side, on a model at parameters that may change: compiled once."""

    def __init__(self, physics: Callable[[Any], Physics]) -> None:
        many = lambda f, rows: jax.jit(jax.vmap(f, (None, None, *[0] * rows)))
        self._begin = many(lambda p, goal, start, u: follow(physics(p), goal, start, u), 2)
        self._cost = jax.jit(jax.vmap(lambda goal, x, u: goal.of(x, u), (None, 0, 0)))
        self._better = many(lambda p, goal, x, u, cost: descend(physics(p), goal, x, u, cost), 3)
        self._gains = many(lambda p, goal, x, u: sweep(physics(p), goal, x, u)[:1], 2)
        self._track = many(lambda p, goal, start, x, u, gain: track(
            physics(p), goal, start, x, u, gain, jnp.zeros_like(u))[1:], 4)

    def descended(self, params: Any, goal: Goal, starts: Numbers, u: Numbers, sweeps: int) -> Motions:
        """From each of the starts (n, nx) under its own commands (n, T, nu)."""
        def some(starts: Numbers, u: Numbers) -> Motions:
            x = self._begin(params, goal, starts, u)
            cost = self._cost(goal, x, u)
            for _ in range(sweeps):
                before = cost
                x, u, cost = self._better(params, goal, x, u, cost)
                if np.all(np.asarray(before - cost) <= DONE * np.asarray(cost)):
                    break
            return Motions(np.asarray(x), np.asarray(u), np.where(np.isfinite(cost), cost, np.inf))
        return Motions(*_in_rows(some, starts, np.clip(u, goal.low, goal.high)))

    def motions(self, params: Any, goal: Goal, starts: Numbers, guesses: Numbers, sweeps: int) -> Motions:
        """From starts (n, nx) the cheapest of what guesses (n, g, T, nu) descend to."""
        n, g = guesses.shape[:2]
        wide = guesses.reshape(n * g, *guesses.shape[2:])
        found = self.descended(params, goal, np.repeat(starts, g, 0), wide, sweeps)
        return found.of(found.cost.reshape(n, g).argmin(1) + g * np.arange(n))

    def gains(self, params: Any, goal: Goal, of: Motions) -> Numbers:
        """(n, T, nu, nx): none where a command is pressed against a limit of `goal`."""
        return _in_rows(lambda x, u: self._gains(params, goal, x, u), of.x, of.u)[0]

    def tracked(self, params: Any, goal: Goal, starts: Numbers, of: Motions, gains: Numbers) -> Numbers:
        """Commands (n, T, nu) by which starts (n, nx) follow motions from elsewhere: an unstable one, given as commands
        alone, is lost on the way."""
        return _in_rows(lambda *rows: self._track(params, goal, *rows), starts, of.x, of.u, gains)[0]

    def best(self, params: Any, goal: Goal, starts: Numbers, horizon: int, seed: int) -> Motions:
        """From each start the cheapest of random guesses from the middle one, and of what the FEW best of these become
        when each start follows them: starts are near each other."""
        rng, middle = np.random.default_rng([seed, 94]), starts[len(starts) // 2][None]
        first = self.descended(params, goal, np.repeat(middle, GUESSES, 0),
                               random_commands(goal, GUESSES, horizon, rng), SWEEPS)
        few = first.of(np.argsort(first.cost)[:FEW])
        gains, n = self.gains(params, unlimited(goal), few), len(starts)
        which, wide = np.tile(np.arange(len(few.u)), n), np.repeat(starts, len(few.u), 0)
        guesses = self.tracked(params, goal, wide, few.of(which), gains[which])
        return self.motions(params, goal, starts, guesses.reshape(n, -1, *guesses.shape[1:]), SWEEPS)


def unlimited(goal: Goal) -> Goal:
    return goal._replace(low=np.full_like(goal.low, -np.inf), high=np.full_like(goal.high, np.inf))
