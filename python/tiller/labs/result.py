"""What every method is asked for and gives."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .mixture import Mixture
from .options import Options
from .problem import Array, Problem


def normalised(weight: Array) -> Array:
    return weight / weight.sum()


def effective(weight: Array) -> float:
    return float(weight.sum() ** 2 / (weight**2).sum())


def resampled(v: Array, weight: Array, count: int) -> Array:
    """Systematic: equally weighted ones."""
    at = np.searchsorted(np.cumsum(normalised(weight)), (np.arange(count) + 0.5) / count)
    return v[np.minimum(at, len(v) - 1)]


def quantile(values: Array, weight: Array, q: float) -> float:
    order = np.argsort(values)
    at = np.searchsorted(np.cumsum(weight[order]), q * weight.sum())
    return float(values[order[min(at, len(order) - 1)]])


@dataclass
class Inferred:
    """Weighted coordinates v (n, d), how the rounds went, and sentences for the user."""
    problem: Problem
    options: Options
    v: Array = field(default_factory=lambda: np.empty((0, 0)))
    weight: Array = field(default_factory=lambda: np.empty(0))
    rounds: list[dict[str, Any]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    simulations: int = 0
    failed: int = 0
    normal: Mixture | None = None  # that v are draws of, where the method has one
    ranks: Array | None = None  # (m, d) of draws held out, uniform where the method is calibrated; None: not looked at

    @property
    def params(self) -> Array:
        return self.problem.to_params(self.v)

    def add_round(self, v: Array, weight: Array, discrepancy: float, best: float = float("nan")) -> None:
        """`discrepancy`: the density's loss on draws kept back, or ABC's tolerance; `best`: the smallest distance."""
        rows, w = self.problem.to_params(v), normalised(weight)
        mean = w @ rows
        self.rounds.append({"mean": mean, "sd": np.sqrt(w @ (rows - mean) ** 2), "effective_samples": effective(w),
                            "discrepancy": discrepancy, "smallest_discrepancy": best})

    def coverage(self) -> Array | None:
        """Share of held-out draws whose 90 % interval holds them, per learnt parameter."""
        if self.ranks is None:
            return None
        return np.asarray(((self.ranks > 0.05) & (self.ranks < 0.95)).mean(axis=0))
