"""Whether an encoder that runs eccentrically explains what looks like a force."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from ... import _core
from ..._rollout import rollout
from .data import Array, Ground

HORIZON_S, EVERY_S, MOST = 1.0, 0.5, 60  # of the rollouts that are fitted
WIDEST = 1.0  # slope of the reading's error in the position: beyond, the reading would stand still


@dataclass(frozen=True)
class Eccentricity:
    position: str
    amplitude: float  # rad or m
    ratio: float  # of rollouts' errors in the part to learn from, with over without

    def __str__(self) -> str:
        return f"an encoder of {self.position} that reads {self.amplitude:.3g} too far once a turn"


def _starts(ground: Ground, horizon: int) -> npt.NDArray[np.int64]:
    """Periods that begin a rollout within one log: weight 0 marks where the smoother began anew."""
    weight, every = ground.forces.weight, max(1, round(EVERY_S / ground.document["period_s"]))
    whole = np.lib.stride_tricks.sliding_window_view(weight, horizon + 1).min(1) > 0
    starts = np.flatnonzero(whole)[::every]
    return starts[::max(1, -(-len(starts) // MOST))]


def find_eccentricity(robot: _core.Robot, ground: Ground) -> Eccentricity | None:
    """The encoder whose error a sin q + b cos q, fitted beside the free parameters to rollouts of one second, explains
    most. None where no position is an angle, or no log is long enough. Cost: some tens of batches of rollouts."""
    d, f = ground.document, ground.forces
    horizon = round(HORIZON_S / d["period_s"])
    if len(f.weight) <= horizon or not len(starts := _starts(ground, horizon)):
        return None
    rows = starts[:, None] + np.arange(horizon + 1)
    shown, inputs = f.state.T[rows], f.input.T[rows[:, :-1]]
    free = [i for i, p in enumerate(robot.priors.values()) if p["kind"] != "fixed"]
    centre = robot.prior_centre
    placed = [j for j in d["joints"] if j["position"]]
    at = [d["states"].index(j["position"]) for j in placed]

    def errors(z: Array, q: int, v: int) -> Array:
        """In units of what moves: rollouts from states less the error, plus it, against what was shown."""
        a, b = z[:2]
        start = shown[:, 0].copy()
        # the position whose reading is shown, by Newton from the reading; its slope takes the velocity along
        true = start[:, q].copy()
        for _ in range(8):
            slope = 1 + a * np.cos(true) - b * np.sin(true)
            true -= (true + a * np.sin(true) + b * np.cos(true) - start[:, q]) / np.where(abs(slope) > 0.05, slope, 1)
        start[:, q], start[:, v] = true, start[:, v] / (1 + a * np.cos(true) - b * np.sin(true))
        params = centre.copy()
        params[free] *= np.exp(z[2:])
        way = rollout(robot, start, inputs, np.tile(params, (len(start), 1)), threads=1)[..., at].copy()
        k = at.index(q)
        way[..., k] += a * np.sin(way[..., k]) + b * np.cos(way[..., k])
        off = way - shown[..., at]
        for i, joint in enumerate(placed):
            if joint["angle"]:
                off[..., i] = np.remainder(off[..., i] + np.pi, 2 * np.pi) - np.pi
        return np.clip(np.nan_to_num(off, nan=1e3), -1e3, 1e3).ravel()

    best = None
    for joint in placed:
        if not joint["angle"]:
            continue
        q, v = d["states"].index(joint["position"]), d["states"].index(joint["velocity"])
        width = 0.3 + np.zeros(len(free))
        without = least_squares(lambda z, q=q, v=v: errors(np.concatenate([[0, 0], z]), q, v), np.zeros(len(free)),
                                bounds=(-width, width)) if free else None
        wide = np.concatenate([[0.7 * WIDEST] * 2, width])
        tried = [least_squares(errors, np.concatenate([begin, np.zeros(len(free))]), bounds=(-wide, wide), args=(q, v))
                 for begin in ((0.05, 0.0), (-0.05, 0.0), (0.0, 0.05), (0.0, -0.05))]
        found = min(tried, key=lambda one: float(one.cost))
        cost = float(without.cost) if without is not None else 0.5 * float((errors(np.zeros(2), q, v) ** 2).sum())
        ratio = (float(found.cost) / max(cost, 1e-300)) ** 0.5
        if best is None or ratio < best.ratio:
            best = Eccentricity(joint["position"], float(np.hypot(*found.x[:2])), ratio)
    return best
