"""How far simulated rollouts are from the logs: error by error, or as distributions."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import convolve1d

from ..problem import Array
from .logs import Logs

DIRECTIONS = 32


class Residual:
    """Of states (rows, nx, n): mean over rows of w1 sum |W e| + w2 sum (W e)^2 (Chebotar et al., ICRA 2019, their D,
    with the mean in the place of their sum: weights do not depend on a cost's scale). e is filtered over a rollout's
    periods by a normal of `smoothing_steps`; W is displacement_scale() or 1."""

    def __init__(self, logs: Logs, weight_l1: float, weight_l2: float, scale: bool, smoothing_steps: float) -> None:
        self.logs, self.weight_l1, self.weight_l2 = logs, weight_l1, weight_l2
        self.scale = logs.displacement_scale() if scale else np.ones(len(logs.angle))
        self.known = logs.known
        self.rows = int(self.known.all(axis=1).sum())
        reach = np.arange(-np.ceil(3 * smoothing_steps), np.ceil(3 * smoothing_steps) + 1)
        self.taps = np.exp(-0.5 * (reach / smoothing_steps) ** 2) if smoothing_steps > 0 else np.ones(1)
        self.first = np.flatnonzero(np.diff(logs.rollout, prepend=-1))

    def _filtered(self, error: Array) -> Array:
        """Means weighted by the taps, over what is known."""
        for part, known in zip(np.split(error, self.first[1:]), np.split(self.known, self.first[1:])):
            share = convolve1d(known.astype(float), self.taps, axis=0, mode="constant")[..., None]
            part[:] = convolve1d(part, self.taps, axis=0, mode="constant") / np.where(share > 0, share, 1.0)
        return error

    def __call__(self, states: Array) -> Array:
        error = self.scale[:, None] * self.logs.errors(states)
        error[~self.known] = 0.0
        if len(self.taps) > 1:
            error = self._filtered(error)
            error[~self.known] = 0.0
        total = self.weight_l2 * np.einsum("txn,txn->n", error, error)
        if self.weight_l1 > 0:
            total = total + self.weight_l1 * np.abs(error).sum(axis=(0, 1))
        return np.asarray(total / self.rows)


def directions(count: int, dimension: int) -> Array:
    """Unit vectors (count, dimension), uniform on the sphere, the same at every call."""
    z = np.random.default_rng([0, count, dimension]).normal(size=(count, dimension))
    return np.asarray(z / np.linalg.norm(z, axis=1, keepdims=True))


def sorted_distance(a: Array, b: Array) -> Array:
    """Wasserstein-1 of as many numbers each, along the last axis: on a line the sorted pairing is one of the best."""
    return np.asarray(np.abs(np.sort(a, axis=-1) - np.sort(b, axis=-1)).mean(axis=-1))


class SlicedWasserstein:
    """Mean over directions of the Wasserstein-1 distance of projected points (Rabin, Peyre, Delon, Bernot, SSVM 2011),
    of states (rows, nx, n). A point is a period: displacement from the rollout's start, that start, the input; without
    start and input a model could swap the answers to two inputs unseen. Simulated displacements get the noise that the
    robot file states, the same for every candidate: else one would have to move more to be spread as the logs are. Rows
    at which a state is not known are left out. Cost: DIRECTIONS sorts of the rows for each candidate."""

    def __init__(self, logs: Logs, scale: bool) -> None:
        self.logs, self.rows = logs, logs.known.all(axis=1)
        nx, start = len(logs.angle), logs.start[self.rows]
        moved, context = logs.moved[self.rows], np.concatenate([start, logs.inputs[self.rows]], axis=1)
        square = np.concatenate([(moved**2).mean(axis=0), context.var(axis=0)])
        self.scale = np.where(square > 0, 1 / np.sqrt(np.where(square > 0, square, 1.0)), 0.0) if scale \
            else np.ones(len(square))
        time_s = logs.period[self.rows, None] * logs.period_s
        sd = np.sqrt(logs.process_sd**2 * time_s + logs.start_sd[self.rows] ** 2 + logs.state_sd[self.rows] ** 2)
        self.noise = self.scale[:nx] * sd * np.random.default_rng(0).normal(size=sd.shape)
        direction = directions(DIRECTIONS, len(square))
        self.of_state, self.context = direction[:, :nx], direction[:, nx:] @ (context * self.scale[nx:]).T
        self.logged = np.sort(self.context + self.of_state @ (moved * self.scale[:nx]).T, axis=-1)

    def __call__(self, states: Array) -> Array:
        moved = self.logs.wrapped(states - self.logs.start[..., None])[self.rows]
        moved = moved * self.scale[:self.noise.shape[1], None] + self.noise[..., None]
        distance = np.zeros(states.shape[2])
        for state, context, logged in zip(self.of_state, self.context, self.logged):
            distance += sorted_distance(context + np.einsum("x,txn->nt", state, moved), logged)
        return np.where(np.isfinite(moved).all(axis=(0, 1)), distance / DIRECTIONS, np.inf)


Discrepancy = Callable[[Array], Array]
