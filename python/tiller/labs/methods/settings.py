"""What a method is asked for, and how its iterations are told."""
from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..options import Options
from ..problem import Array, InferenceError, Problem
from ..result import Inferred

if TYPE_CHECKING:
    from .reps import Weights

NAN = float("nan")


@dataclass
class Settings:
    simulations: int = 10000  # in all; SimOpt spends them in equal parts on its iterations
    iterations: int = 10  # of SimOpt
    kl: float = 1.0  # bound of the divergence of weights from equal ones
    eta: float = NAN  # temperature of reps; NaN: by `kl`
    epsilon: float = NAN  # ABC's tolerance; NaN: by `accept`
    accept: float = 0.01  # share of the simulations that ABC keeps
    discrepancy: str = "residual"  # of SimOpt, or "wasserstein"
    smoothing_steps: float = 0.0  # trajectory_simopt's filter: deviation in periods; 0: none
    weight_l1: float = NAN  # of absolute and of squared errors; NaN: the method's
    weight_l2: float = NAN
    scale: bool | None = None  # each channel over its root mean square in the logs; None: the method's

    @classmethod
    def of_json(cls, told: dict[str, Any]) -> Settings:
        """null: NaN, but for `scale`."""
        given: Any = {f.name: told[f.name] for f in fields(cls)}
        for name, value in given.items():
            given[name] = NAN if value is None and name != "scale" else value
        return cls(**given)

    def result(self, problem: Problem) -> Inferred:
        return Inferred(problem, Options(simulations=self.simulations))

    def count(self, result: Inferred, cost: Array) -> None:
        """Raises InferenceError where too few are finite for the moments of as many coordinates."""
        finite = int(np.isfinite(cost).sum())
        result.simulations += len(cost)
        result.failed += len(cost) - finite
        if finite < result.problem.dimension + 2:
            raise InferenceError(f"only {finite} of {len(cost)} rollouts stayed finite; narrow the priors, shorten the "
                                 "rollouts or raise substeps")

    def add_round(self, result: Inferred, v: Array, weights: Weights, cost: Array) -> None:
        held = weights.weight > 0
        result.add_round(v, weights.weight, float(weights.weight[held] @ cost[held]), float(np.nanmin(cost)))
        result.rounds[-1] |= {"temperature": weights.temperature, "kl": weights.kl}
