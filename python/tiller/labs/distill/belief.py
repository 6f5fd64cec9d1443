"""What a posterior holds of hidden parameters as it learns, made up: a real one in each episode would cost more."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ... import _core

Array = npt.NDArray[np.float64]
DRAWS = 512  # for a prior's moments
SHORTEST_S, LONGEST_S = 1e-3, 30.0


class Moments(NamedTuple):
    mean: Array  # (np)
    sd: Array  # (np), 0 where the prior is fixed


def prior_moments(robot: _core.Robot) -> Moments:
    draws = _core.draw_params(robot, 1, DRAWS)
    return Moments(draws.mean(0), np.where(np.ptp(draws, axis=0) > 0, draws.std(0), 0.0))


class BeliefCourse:
    """The moments of a Gaussian posterior whose data are worth w / (1 - w) of the prior N(m0, s0^2):

        deviation  s0 sqrt(1 - w)        mean  (1 - w) m0 + w truth + s0 sqrt(w (1 - w)) z,   z ~ N(0, 1) once

    with w = t / (t + tau), tau of each parameter log-uniform in [1e-3, 30] s: some are known at once, others never.
    """

    def __init__(self, robot: _core.Robot, prior: Moments, rng: np.random.Generator) -> None:
        self._prior = prior
        self.truth: Array = _core.draw_params(robot, int(rng.integers(1 << 53)), 1)[0]
        self._off = rng.standard_normal(self.truth.size)
        self._tau_s = SHORTEST_S * (LONGEST_S / SHORTEST_S) ** rng.random(self.truth.size)
        self._quantiles = rng.standard_normal((512, self.truth.size))  # a hypothesis keeps its own all along
        bounds = [(p.get("low", -np.inf), p.get("high", np.inf)) for p in robot.priors.values()]
        self._low, self._high = np.array(bounds, float).reshape(-1, 2).T

    def at(self, time_s: float) -> Moments:
        w = time_s / (time_s + self._tau_s)
        mean = (1 - w) * self._prior.mean + w * self.truth + self._prior.sd * np.sqrt(w * (1 - w)) * self._off
        return Moments(np.clip(mean, self._low, self._high), self._prior.sd * np.sqrt(1 - w))

    def hypotheses(self, now: Moments, count: int) -> Array:
        """(count, np) draws from these moments, within the priors' bounds."""
        return np.clip(now.mean + now.sd * self._quantiles[:count], self._low, self._high)
