"""An LQR, or an iLQR, of a short horizon on a model that is fitted anew in each period."""
from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from .guide import Goal, descend, follow, random_commands
from .minimise import Numbers
from .moments import Array
from .physics import Physics

GUESSES, DESCENTS = 24, 12  # of the first plan; what one descends to, in calls of some sweeps


@dataclass
class AdaptiveOptions:
    target: Numbers  # (nx)
    low: Numbers  # (nu)
    high: Numbers
    state_weight: Numbers  # (nx) a period, and at the end
    input_weight: Numbers  # (nu)
    noise: Numbers  # (nx) deviation of what is measured of a state
    push_sd: float = 0.1  # of a constant push on each motor, in shares of its range
    memory: float = 30.0  # periods after which what the model lacks has faded to 1/e
    gain_sd: float = 0.5  # of a motor's gain, in shares of the model's
    horizon: int = 40  # periods of the plan
    adapt: bool = True  # False: the model alone


class AdaptiveLqr:
    """Model predictive control whose model is adapted in each period, as in Fu, Levine and Abbeel, IROS 2016. What it
    lacks is a push on each motor and a change of its gain, which a Kalman filter estimates beside the state; both fade
    in `memory` periods and may jump by as much, so that a break is found within a few. A regression of the last
    transitions, the source's form, mixes those from before a break with those behind it, and bends the slopes to fit
    both. Cost a period: O((nx + 2 nu)^3)."""

    def __init__(self, physics: Physics, o: AdaptiveOptions) -> None:
        self._physics, self.o = jax.jit(physics), o
        self._rest = np.clip(np.zeros(len(o.low)), o.low, o.high)
        self._last, self._lack = self._rest, np.zeros((2, len(o.low)))  # push and change of the gain, by motor
        self._state: Numbers | None = None
        self._covariance = np.zeros((0, 0))  # of state and lack

    def __call__(self, x: Numbers, _: int) -> Numbers:
        """The command of a period, after what the period before has taught."""
        if self.o.adapt:
            self.learn(x)
        return self.command(x)

    def _acting(self, u: Array, lack: Array) -> Array:
        """The command that the model needs to do as the plant under u."""
        return u + lack[0] + lack[1] * (u - self._rest)

    def learn(self, measured: Numbers) -> None:
        """The filter's step over the last command."""
        o, nx = self.o, len(measured)
        sd = np.concatenate([o.push_sd * (o.high - o.low), np.full(len(o.low), o.gain_sd)])
        if self._state is None:
            self._state, self._covariance = measured, np.diag(np.concatenate([o.noise, sd])**2)
            return
        kept, z = 1 - 1 / o.memory, np.concatenate([self._state, self._acting(self._last, self._lack)])
        after, slope = map(np.asarray, self._physics(z))
        b = slope[:, nx:]
        move = np.block([[slope[:, :nx], b, b * (self._last - self._rest)],
                         [np.zeros((len(sd), nx)), kept * np.eye(len(sd))]])
        jump = np.concatenate([np.full(nx, 1e-12), (1 - kept**2) * sd**2])
        spread = move @ self._covariance @ move.T + np.diag(jump)
        weight = np.linalg.solve(spread[:nx, :nx] + np.diag(o.noise**2), spread[:nx]).T
        off = weight @ (measured - after)
        self._state, self._lack = after + off[:nx], kept * self._lack + off[nx:].reshape(2, -1)
        spread = spread - weight @ spread[:nx]
        self._covariance = 0.5 * (spread + spread.T)

    def model(self, x: Numbers, u: Numbers) -> tuple[Numbers, Numbers]:
        """Slope (nx, nz) and offset (nx) about the present."""
        after, slope = map(np.array, self._physics(np.concatenate([x, self._acting(u, self._lack)])))
        slope[:, len(x):] *= 1 + self._lack[1]
        return slope, after - slope @ np.concatenate([x, u])

    def command(self, x: Numbers) -> Numbers:
        o, nx = self.o, len(x)
        slope, offset = self.model(x, self._last)
        a, b = slope[:, :nx], slope[:, nx:]
        # about the target and the command that holds it best; the drift that is left
        drift = a @ o.target + offset - o.target
        square = b.T @ b
        hold = -np.linalg.solve(square + 1e-9 * (1e-12 + np.trace(square)) * np.eye(len(square)), b.T @ drift)
        hold = np.clip(hold, o.low, o.high)
        drift = drift + b @ hold
        q, r = np.diag(o.state_weight), np.diag(o.input_weight)
        value, by = q, np.zeros(nx)
        for _ in range(o.horizon):
            bend = r + b.T @ value @ b
            gain = -np.linalg.solve(bend, b.T @ value @ a)
            wish = -np.linalg.solve(bend, b.T @ (value @ drift + by))
            closed = a + b @ gain
            by = closed.T @ (by + value @ (b @ wish + drift)) + gain.T @ r @ wish
            value = q + gain.T @ r @ gain + closed.T @ value @ closed
        self._last = np.clip(hold + gain @ (x - o.target) + wish, o.low, o.high)
        return self._last


class AdaptiveIlqr(AdaptiveLqr):
    """The same model over a horizon, by iLQR from the plan before, the first from random ones: it goes far, keeps the
    limits, and its model may be a network's. What the model lacks is taken for the same all along the plan."""

    def __init__(self, physics: Physics, o: AdaptiveOptions, sweeps: int = 3) -> None:
        super().__init__(physics, o)
        self._plan: Numbers | None = None
        self._goal = goal = Goal(o.target, o.state_weight, o.state_weight, o.input_weight, o.low, o.high)

        def planned(x: Array, u: Array, lack: Array) -> tuple[Array, Array]:
            def adapted(z: Array) -> tuple[Array, Array]:
                after, slope = physics(jnp.concatenate([z[:len(x)], self._acting(z[len(x):], lack)]))
                return after, slope * jnp.concatenate([jnp.ones(len(x)), 1 + lack[1]])
            states = follow(adapted, goal, x, u)
            motion = states, u, goal.of(states, u)
            for _ in range(sweeps):
                motion = descend(adapted, goal, *motion)
            return motion[1:]

        self._planned = jax.jit(planned)

    def command(self, x: Numbers) -> Numbers:
        before = self._first(x) if self._plan is None else np.concatenate([self._plan[1:], self._plan[-1:]])
        self._plan = np.asarray(self._planned(x, before, self._lack)[0])
        self._last = self._plan[0]
        return self._last

    def _first(self, x: Numbers) -> Numbers:
        """The cheapest of what random commands descend to."""
        best, least = np.tile(self._rest, (self.o.horizon, 1)), np.inf
        for u in random_commands(self._goal, GUESSES, self.o.horizon, np.random.default_rng(1)):
            for _ in range(DESCENTS):
                u, cost = self._planned(x, u, self._lack)
            if cost < least:
                best, least = np.asarray(u), float(cost)
        return best
