"""One period of the plant as a network: what runs of other plants like it had in common, a prior for this one."""
from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ... import _core
from ..forces.data import Samples
from ..forces.ensemble import fit
from .minimise import Numbers
from .moments import Array
from .physics import Physics
from .plant import Controller, PlantTrials, Trial
from .task import Task, features

HIDDEN, STEPS, BATCH, MEMBERS = [32, 32], 6000, 256, 3
RUN, SPEED, WAVES = 40, 0.2, 3  # periods of an earlier run; radians a period of the commands' first wave


def wandering(low: Numbers, high: Numbers, rng: np.random.Generator) -> Controller:
    """Slow waves of random phases that reach over half of the range, and white noise of a tenth of it."""
    rate = SPEED * np.arange(1, WAVES + 1)
    phase = 2 * np.pi * rng.random((len(low), WAVES))

    def command(_: Numbers, k: int) -> Numbers:
        share = np.sin(rate * k + phase).sum(1) / (2 * WAVES) + 0.1 * rng.standard_normal(len(low))
        return np.clip(0.5 * (low + high) + (high - low) * share, low, high)
    return command


def earlier_runs(robot: _core.Robot, task: Task, noise_sd: Numbers, count: int, seed: int) -> list[Trial]:
    """Runs of as many plants, each drawn anew from [sim], from places between the start and the target and beside
    them."""
    trials, away = [], robot.target - task.start_mean
    spread = np.diag((0.1 * np.abs(away) + 10 * np.sqrt(np.diag(task.start_covariance)))**2)
    for i in range(count):
        rng = np.random.default_rng([seed, 89, i])
        run = PlantTrials(robot, task.period_s, RUN, noise_sd, task.start_mean + rng.random() * away, spread, seed,
                          1000 + i, plant_seed=int(rng.integers(1, 1 << 40)))
        trials.append(run(wandering(task.low, task.high, rng), i))
    return trials


def _layers(weights: Numbers, widths: list[int]) -> tuple[list[tuple[Array, Array]], Numbers]:
    """Of one network, and what is left of the weights behind it."""
    out = []
    for m, n in zip(widths, widths[1:], strict=False):
        rows, weights = weights[:n * (m + 1)].reshape(n, m + 1), weights[n * (m + 1):]
        out.append((jnp.asarray(rows[:, 0]), jnp.asarray(rows[:, 1:])))
    return out, weights


def network_physics(task: Task, trials: Sequence[Trial], seed: int) -> Physics:
    """The state's gain over a period by features and commands, fitted to all transitions: the mean of a few networks,
    each stopped by runs that it was not fitted to."""
    before = np.concatenate([t.measured[:-1] for t in trials])
    after = np.concatenate([t.measured[1:] for t in trials])
    u = np.concatenate([t.command for t in trials])
    seen = np.array(task.seen)
    x, y = np.concatenate([np.asarray(features(task.angles, before))[:, seen], u], 1), after - before
    mean, sd, size = x.mean(0), np.maximum(1e-9, x.std(0)), np.maximum(1e-12, y.std(0))
    run = np.repeat(np.arange(float(len(trials))), [len(t.command) for t in trials])
    samples = Samples((x - mean) / sd, y / size, np.ones_like(y), run, mean, sd, size)
    weights, widths = fit(samples, MEMBERS, HIDDEN, STEPS, BATCH, seed), [x.shape[1], *HIDDEN, y.shape[1]]
    members = []
    while len(weights):
        layers, weights = _layers(weights, widths)
        members.append(layers)

    def gain(layers: list[tuple[Array, Array]], row: Array) -> Array:
        for bias, weight in layers[:-1]:
            row = jnp.tanh(weight @ row + bias)
        return layers[-1][1] @ row + layers[-1][0]

    def step(z: Array) -> Array:
        row = jnp.concatenate([features(task.angles, z[:task.nx])[seen], z[task.nx:]])
        return z[:task.nx] + sum(gain(layers, row) for layers in members) / len(members)

    return lambda z: (step(jnp.asarray(z)), jax.jacfwd(step)(jnp.asarray(z)))
