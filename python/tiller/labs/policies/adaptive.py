"""An LQR, or an iLQR, of a short horizon on a model that is fitted anew in each period."""
from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from .guide import Goal, descend, follow
from .minimise import Numbers
from .moments import Array
from .physics import Physics


@dataclass
class AdaptiveOptions:
    target: Numbers  # (nx)
    low: Numbers  # (nu)
    high: Numbers
    state_weight: Numbers  # (nx) a period, and at the end
    input_weight: Numbers  # (nu)
    noise: Numbers  # (nx) deviation of what is measured of a state
    offset_sd: Numbers  # (nx) of a constant change a period that the model lacks
    memory: float = 30.0  # periods after which a transition counts 1/e
    slope_sd: float = 0.02  # of the model's slope by states, in shares of it
    gain_sd: float = 0.5  # of its slope by commands
    horizon: int = 40  # periods of the plan
    adapt: bool = True  # False: the model alone


def offset_deviation(physics: Physics, target: Numbers, low: Numbers, high: Numbers) -> Numbers:
    """(nx) A constant change a period: a tenth of what the whole range of the commands makes at the target."""
    at = np.concatenate([target, np.clip(np.zeros(len(low)), low, high)])
    slope = np.asarray(physics(at)[1])[:, len(target):]
    return 0.1 * np.abs(slope) @ (high - low) + 1e-6


class AdaptiveLqr:
    """Model predictive control after Fu, Levine and Abbeel, IROS 2016. What the model leaves of the last transitions is
    regressed on [x; u] and a constant. In the source's form, a covariance with a prior, noise that is measured passes
    for slopes where the loop excites little, and an unstable plant falls. Here the noise is known and the slopes have
    deviations of their own, so that data which cannot tell a slope from the model's leave that as it is. Cost a
    period: O(memory (nx + nu)^2)."""

    def __init__(self, physics: Physics, o: AdaptiveOptions) -> None:
        self._physics, self.o = jax.jit(physics), o
        self._rows: list[tuple[Numbers, Numbers, Numbers]] = []  # z, what the model leaves, slope
        self._last = np.clip(np.zeros(len(o.low)), o.low, o.high)
        self._before: tuple[Numbers, Numbers] | None = None

    def __call__(self, x: Numbers, _: int) -> Numbers:
        """The command of a period, after what the period before has taught."""
        if self._before is not None:
            self.learn(*self._before, x)
        self._before = x.copy(), self.command(x)
        return self._before[1]

    def learn(self, x: Numbers, u: Numbers, after: Numbers) -> None:
        z = np.concatenate([x, u])
        expected, slope = map(np.asarray, self._physics(z))
        self._rows.append((z, after - expected, slope))
        del self._rows[:-int(4 * self.o.memory)]

    def model(self, x: Numbers, u: Numbers) -> tuple[Numbers, Numbers]:
        """Slope (nx, nz) and offset (nx) about the present."""
        z = np.concatenate([x, u])
        after, slope = map(np.asarray, self._physics(z))
        change, constant = self._left(z, slope)
        slope, after = slope + change, after + constant
        return slope, after - slope @ z

    def _left(self, z: Numbers, slope: Numbers) -> tuple[Numbers, Numbers]:
        """What the model lacks about z, by the last transitions: of its slope (nx, nz), and a constant (nx)."""
        o, nx = self.o, len(slope)
        if not o.adapt or not self._rows:
            return np.zeros_like(slope), np.zeros(nx)
        at, left, slopes = (np.array(rows) for rows in zip(*self._rows, strict=True))
        kept = np.exp(-np.arange(len(at))[::-1] / o.memory)
        row = np.hstack([at - z, np.ones((len(at), 1))])
        change, constant = np.empty_like(slope), np.empty(nx)
        share = np.where(np.arange(len(z)) < nx, o.slope_sd, o.gain_sd)
        for i in range(nx):
            # of both measurements, before and after the period
            variance = o.noise[i]**2 + np.mean(slopes[:, i, :nx]**2, 0) @ o.noise**2 + 1e-12
            sd = np.append(np.maximum(1e-6, share * np.abs(slope[i])), o.offset_sd[i])
            bend = (row * kept[:, None]).T @ row / variance + np.diag(1 / sd**2)
            found = np.linalg.solve(bend, (row * kept[:, None]).T @ left[:, i] / variance)
            change[i], constant[i] = found[:-1], found[-1]
        return change, constant

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
    """The same model over a horizon, by iLQR from the plan before: it goes far, keeps the limits, and its model may be
    a network's. What the last transitions leave is taken for the same all along the plan."""

    def __init__(self, physics: Physics, o: AdaptiveOptions, sweeps: int = 3) -> None:
        super().__init__(physics, o)
        self._plan = np.tile(self._last, (o.horizon, 1))
        goal = Goal(o.target, o.state_weight, o.state_weight, o.input_weight, o.low, o.high)

        def planned(x: Array, u: Array, about: Array, change: Array, constant: Array) -> Array:
            def corrected(z: Array) -> tuple[Array, Array]:
                after, slope = physics(z)
                return after + constant + change @ (z - about), slope + change
            states = follow(corrected, goal, x, u)
            motion = states, u, goal.of(states, u)
            for _ in range(sweeps):
                motion = descend(corrected, goal, *motion)
            return motion[1]

        self._planned = jax.jit(planned)

    def command(self, x: Numbers) -> Numbers:
        z = np.concatenate([x, self._last])
        change, constant = self._left(z, np.asarray(self._physics(z)[1]))
        before = np.concatenate([self._plan[1:], self._plan[-1:]])
        self._plan = np.asarray(self._planned(jnp.asarray(x), before, z, change, constant))
        self._last = self._plan[0]
        return self._last
