"""Demonstrations as a normal distribution a period, and how far a forecast is from them (Englert, Paraschos, Peters,
Deisenroth, ICRA 2013)."""
from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..._command import run as run_tiller
from ..._errors import Error
from .minimise import Numbers
from .moments import Array, Normal

LEAST_SPREAD = 0.05  # of a state's root mean square motion: few demonstrations agree by chance
DOUBT = 0.01  # of the demonstrations' covariance is added to a forecast's: the first periods would outweigh all others


class Shown(NamedTuple):
    """Of the states from the start on."""
    mean: Array  # (horizon + 1, nx)
    covariance: Array  # (horizon + 1, nx, nx)


def shown_by(motions: Numbers) -> Shown:
    """Moments of motions (n, horizon + 1, nx)."""
    mean = motions.mean(0)
    away = motions - mean
    least = LEAST_SPREAD**2 * ((mean - mean[0])**2).mean(0) + 1e-12
    return Shown(mean, np.einsum("nki,nkj->kij", away, away) / max(1, len(motions) - 1) + np.diag(least))


def divergence(shown: Normal, forecast: Normal) -> Array:
    """KL(shown || forecast) of a period, in nats: how badly the forecast explains what was shown."""
    s, p = shown.covariance, forecast.covariance + DOUBT * shown.covariance
    off, n = forecast.mean - shown.mean, len(shown.mean)
    return 0.5 * (jnp.trace(jnp.linalg.solve(p, s)) + off @ jnp.linalg.solve(p, off) - n
                  + jnp.linalg.slogdet(p)[1] - jnp.linalg.slogdet(s)[1])


def distance(shown: Shown, states: Numbers) -> float:
    """Sum over the periods after the first of 1/2 (x - m)' S^-1 (x - m), nats: of a demonstration nx / 2 a period. A
    motion that ended early stays where it is."""
    at = np.minimum(np.arange(1, len(shown.mean)), len(states) - 1)
    off = states[at] - shown.mean[1:]
    return 0.5 * float((off * np.linalg.solve(shown.covariance[1:], off[..., None])[..., 0]).sum())


def read_shown(robot: str, logs: Sequence[str], period_s: float, most_periods: int) -> Shown:
    """From logs, whose states are the filter's estimates; as long as the shortest of them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.json"
        run_tiller(["data", "imitate", robot, *logs, "-o", str(path)])
        told = json.loads(path.read_text(encoding="utf-8"))
    motions = [np.array(one["states"], float) for one in told["demonstrations"]]
    if len(motions) < 2:
        raise Error("--match: one demonstration tells no spread; give the logs of two or more")
    every = period_s / told["period_s"]
    horizon = min(most_periods, int((min(map(len, motions)) - 1) / every))
    at = every * np.arange(horizon + 1)
    return shown_by(np.array([[np.interp(at, np.arange(len(m)), column) for column in m.T] for m in motions])
                    .transpose(0, 2, 1))
