"""Weights at which plans spend no more of any feature than the demonstrations do (Syed and Schapire, NIPS 2007)."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np

from .cost import Cost, motion_features, rollout_features
from .game import multiplicative_weights
from .plan import Planner
from .problem import Motion, Numbers, Scene


@dataclass
class Matched:
    value: Numbers = field(default_factory=lambda: np.zeros(0))  # (learnt) relative to what is kept
    demonstrated: Numbers = field(default_factory=lambda: np.zeros(0))  # (learnt + 1) mean features; first: kept
    made: Numbers = field(default_factory=lambda: np.zeros(0))          # the same of the mixture of plans
    excess: float = np.nan  # the largest relative excess of a feature
    bound: float = np.nan   # what no weights are below


def match(scene: Scene, cost: Cost, motions: Sequence[Motion], start: Numbers, rounds: int, horizon: int,
          progress: Callable[[float], None] | None = None) -> Matched:
    """Features over the demonstrations' mean; one of which they have none has no say. Weights stay within a factor of a
    million of `start` (learnt). `rounds` plans of every demonstration."""
    planner, done = Planner(scene, cost), 0
    demonstrated = np.mean([motion_features(cost, m) for m in motions], 0)
    scale = np.where(demonstrated > 1e-9 * demonstrated.max(), demonstrated, 1e9 * demonstrated.max())

    def relative(w: Numbers) -> Numbers:
        return np.clip(w[1:] / max(w[0], 1e-300), 1e-6 * start, 1e6 * start)

    def plan(w: Numbers) -> Numbers:
        nonlocal done
        coefficient = np.append(1.0, relative(w))
        plans = [planner.replay(coefficient, m, horizon) for m in motions]
        done += 1
        if progress:
            progress(done / rounds)
        return np.mean([np.asarray(rollout_features(cost, jnp.asarray(p.states[0]), jnp.asarray(p.inputs),
                                                    jnp.asarray(p.inputs[0]))) for p in plans], 0)

    e = multiplicative_weights(demonstrated, plan, scale, rounds)
    return Matched(relative(e.weight), demonstrated, e.mixture, e.value, e.bound)
