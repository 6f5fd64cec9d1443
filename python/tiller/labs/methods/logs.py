"""The logs as rollouts of one length, and what candidates do in them."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..problem import Array

TURN = 2 * np.pi


@dataclass
class Logs:
    """A row for each period of each rollout."""
    rollout: npt.NDArray[np.int64]  # (rows) which one
    period: Array  # (rows) since its start, 1 at its first end
    inputs: Array  # (rows, nu)
    start: Array  # (rows, nx) logged where the rollout begins
    start_sd: Array  # (rows, nx) what the sensors' noise leaves of doubt in it
    state: Array  # (rows, nx) logged at the period's end; NaN: not known
    state_sd: Array  # (rows, nx)
    angle: npt.NDArray[np.bool_]  # (nx) which states are
    process_sd: Array  # (nx) over the root of a second
    period_s: float
    lanes: int
    simulate: Callable[[Array], Array]  # params (n <= lanes, np) -> states (rows, nx, lanes)

    @classmethod
    def of_table(cls, table: Array, inputs: int, angle: list[bool], process_sd: list[float], period_s: float,
                 lanes: int, simulate: Callable[[Array], Array]) -> Logs:
        """From the columns rollout, period, inputs, then start, its doubt, state, its doubt."""
        whole, nx = table[:, 2 + inputs:], len(angle)
        start, start_sd, state, state_sd = (np.ascontiguousarray(whole[:, k * nx:(k + 1) * nx]) for k in range(4))
        return cls(table[:, 0].astype(np.int64), table[:, 1], table[:, 2:2 + inputs], start, start_sd, state, state_sd,
                   np.array(angle, bool), np.array(process_sd, float), period_s, lanes, simulate)

    def blocks(self, params: Array) -> Iterator[tuple[slice, Array]]:
        """Which of the candidates, and their states (rows, nx, n)."""
        for first in range(0, len(params), self.lanes):
            some = slice(first, min(first + self.lanes, len(params)))
            yield some, self.simulate(params[some])[:, :, :some.stop - first]

    def evaluated(self, params: Array, value: Callable[[Array], Array]) -> Array:
        """value(states (rows, nx, n)) -> (n) of all candidates (count, np)."""
        with np.errstate(invalid="ignore", over="ignore"):  # of candidates that diverge
            return np.concatenate([value(states) for _, states in self.blocks(params)])

    def wrapped(self, off: Array) -> Array:
        """Differences of states (rows, nx, ...), of angles the short way round."""
        if self.angle.any():
            off[:, self.angle] -= TURN * np.round(off[:, self.angle] / TURN)
        return off

    def errors(self, states: Array) -> Array:
        """Simulated less logged, (rows, nx, n); NaN where not known."""
        return self.wrapped(states - self.state[..., None])

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """(rows, nx)"""
        return np.isfinite(self.state)

    @property
    def moved(self) -> Array:
        """Logged displacements from a rollout's start, (rows, nx)."""
        return self.wrapped(self.state - self.start)

    def variance(self) -> Array:
        """(rows, nx) Of a period's change: process noise and the doubt at both ends. No less than (a thousandth of the
        changes' root mean square)^2: a state without noise would have all the say."""
        square, known = self.moved**2, self.known
        mean = np.sum(square, axis=0, where=known) / np.maximum(known.sum(axis=0), 1)
        noise = self.process_sd**2 * self.period_s + self.start_sd**2 + self.state_sd**2
        return np.maximum(noise, np.maximum(1e-6 * mean, 1e-300))

    def displacement_scale(self) -> Array:
        """(nx) One over the root mean square of `moved`; 0: the state stands still."""
        known = self.known
        square = np.sum(self.moved**2, axis=0, where=known)
        return np.where(square > 0, np.sqrt(known.sum(axis=0) / np.where(square > 0, square, 1.0)), 0.0)
