"""Policies with parameters to search, what they answer, and the file that the runtime reads."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .minimise import Numbers
from .moments import Array, Bumps, Moments, Normal, bump_moments, bump_values, squash
from .task import Task, features

TARGET_NOISE = 0.01  # of what the bumps pass near, beside a signal of one
RANGE_OF_WAVE = 0.7  # sine and cosine vary by so much over a turn


class Linear(NamedTuple):
    """v = weight f + bias."""
    weight: Array  # (nu, features seen)
    bias: Array  # (nu)

    def of_normal(self) -> Callable[[Normal], Moments]:
        """v at features that are normal."""
        return lambda f: Moments(self.weight @ f.mean + self.bias, self.weight @ f.covariance @ self.weight.T,
                                 self.weight.T)

    def of_values(self) -> Callable[[Array], Array]:
        """v (nu) at features."""
        return lambda f: self.weight @ f + self.bias

    def network(self) -> dict[str, Any]:
        rows = np.concatenate([np.asarray(self.bias)[:, None], self.weight], 1)
        return {"kind": "tanh", "hidden": [0, 0], "weights": rows.ravel().tolist()}


class Bells(NamedTuple):
    """Gaussian bumps that pass near their targets; all commands share points and lengths, as the runtime's networks
    do."""
    points: Array  # (n, features seen)
    log_length: Array  # (features seen)
    targets: Array  # (nu, n)

    def bumps(self) -> Bumps:
        """beta = (K + 0.01^2 I)^-1 targets."""
        z = self.points / jnp.exp(self.log_length)
        k = jnp.exp(-0.5 * ((z[:, None] - z)**2).sum(-1))
        beta = jnp.linalg.solve(k + TARGET_NOISE**2 * jnp.eye(len(z)), self.targets.T).T
        outputs = len(self.targets)
        return Bumps(self.points, jnp.tile(self.log_length, (outputs, 1)), jnp.zeros(outputs), beta)

    def of_normal(self) -> Callable[[Normal], Moments]:
        """v at features that are normal. The system of equations is solved here, once for a whole forecast."""
        b = self.bumps()
        return lambda f: bump_moments(b, f)

    def of_values(self) -> Callable[[Array], Array]:
        """v (nu) at features."""
        b = self.bumps()
        return lambda f: bump_values(b, f)[0]

    def network(self) -> dict[str, Any]:
        outputs = np.pad(np.asarray(self.bumps().beta), ((0, 0), (1, 0)))  # no bias
        numbers = np.concatenate([np.exp(-np.asarray(self.log_length)), np.ravel(self.points), outputs.ravel()])
        return {"kind": "gaussian", "hidden": [len(self.points), 0], "weights": numbers.tolist()}


Feedback = Linear | Bells


def make_feedback(task: Task, kind: str, bumps: int, f: Normal, deviation: float, seed: list[int]) -> Feedback:
    """Where a search begins. linear: weights of a tenth of `deviation`. rbf: points from the features' distribution f,
    targets of `deviation`."""
    rng, seen = np.random.default_rng(seed), len(task.seen)
    if kind == "linear":
        return Linear(0.1 * deviation * rng.standard_normal((task.nu, seen)),
                      0.1 * deviation * rng.standard_normal(task.nu))
    values, vectors = np.linalg.eigh(f.covariance)
    points = f.mean + rng.standard_normal((bumps, seen)) @ (vectors * np.sqrt(np.maximum(0, values))).T
    length = np.where([name in task.states for name in task.seen_names], 1.0, RANGE_OF_WAVE)
    return Bells(points, np.log(length), deviation * rng.standard_normal((task.nu, bumps)))


def command(task: Task, policy: Feedback) -> Callable[[Array], Array]:
    """(nu) at a state (nx)."""
    values, seen = policy.of_values(), np.array(task.seen)
    return lambda x: squash(values(features(task.angles, x)[seen]), task.low, task.high)


def document(task: Task, network: dict[str, Any], squashed_by: str) -> dict[str, Any]:
    """The file that the planner `policy` takes in (docs/reference/networks.md); what stands behind the network is for
    those who have no robot file at hand."""
    def listed(values: Numbers) -> list[float]:
        return [float(v) for v in values]
    return {"format": "tiller policy", "version": 1, "reads": ["state"], "squash": squashed_by, "input_low": [],
            "input_high": [], "network": {"kind": network["kind"], "inputs": task.seen_names, "outputs": task.commands,
                                          "members": 1, "hidden": network["hidden"], "weights": network["weights"]},
            "period_s": task.period_s, "states": task.states, "angles": [task.states[i] for i in task.angles],
            "low": listed(task.low), "high": listed(task.high)}
