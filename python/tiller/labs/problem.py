"""What is inferred from: priors in their coordinates, pieces of logs, and a simulator of both."""
from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from .mixture import Mixture

Array = npt.NDArray[np.float64]

# (params (n, np), starts (n, pieces, ny), seeds (n)) -> measured (n, periods, ny), and a sentence for each that failed
Simulate = Callable[[Array, Array, npt.NDArray[np.int64]], tuple[Array, list[str]]]


class InferenceError(Exception):
    """Nothing can be inferred; a sentence for the user."""


@dataclass(frozen=True)
class Prior:
    """A parameter's prior. Its coordinate is the logarithm for log_normal (centre: the median; sd: of the logarithm),
    else the value."""
    name: str
    kind: str  # fixed, uniform, normal or log_normal
    centre: float = 0.0  # the value where it is fixed
    sd: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""

    @property
    def is_logarithm(self) -> bool:
        return self.kind == "log_normal"

    def to_coordinate(self, value: Any) -> Any:
        with np.errstate(divide="ignore"):
            return np.log(np.maximum(value, 0.0)) if self.is_logarithm else value

    def from_coordinate(self, v: Any) -> Any:
        return np.exp(v) if self.is_logarithm else v

    def law(self) -> Any:
        """The coordinate's law, a frozen distribution of scipy."""
        low, high = self.to_coordinate(self.low), self.to_coordinate(self.high)
        if self.kind == "uniform":
            return stats.uniform(low, high - low)
        centre = self.to_coordinate(self.centre)
        return stats.truncnorm((low - centre) / self.sd, (high - centre) / self.sd, centre, self.sd)


@dataclass
class Problem:
    """Parameters of a black box from logs. Pieces stand behind each other in `inputs` and `measured`."""
    name: str
    priors: list[Prior]
    measurements: list[str]
    noise_sd: Array  # (ny) of the sensors: added to what is simulated, and drawn at its start
    first: npt.NDArray[np.int64]  # (pieces) row where each begins
    start: Array  # (pieces, ny) measured where it begins
    inputs: Array  # (periods, nu) held over each
    measured: Array  # (periods, ny) at the end of each
    simulate: Simulate
    seed: int = 1
    mixture: Mixture | None = None  # a joint prior in the place of the marginals, cut to their bounds
    told: dict[str, Any] = field(default_factory=dict)  # for the report: model, command, files

    def __post_init__(self) -> None:
        self.learnt = [p for p in self.priors if p.kind != "fixed"]
        if not len(self.measured):
            raise InferenceError("the logs hold no stretch with every value measured; give a log with at least twenty "
                                 "rows in a row")
        if not self.learnt:
            raise InferenceError("every parameter is known; give one a prior")
        self._laws = [p.law() for p in self.learnt]
        self.low = np.array([p.to_coordinate(p.low) for p in self.learnt], float)
        self.high = np.array([p.to_coordinate(p.high) for p in self.learnt], float)
        if self.mixture is not None:
            self.mixture = self.mixture.cut(self.low, self.high)

    @property
    def dimension(self) -> int:
        return len(self.learnt)

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Coordinates (count, d) from the prior."""
        if self.mixture is not None:
            return self.mixture.draw(rng, count)
        return np.stack([law.ppf(rng.uniform(size=count)) for law in self._laws], axis=1)

    def log_prior(self, v: Array) -> Array:
        """Of coordinates (n, d), up to a constant; -infinity outside of the bounds."""
        if self.mixture is not None:
            return self.mixture.log_density(v)
        return np.asarray(sum(law.logpdf(v[:, j]) for j, law in enumerate(self._laws)))

    def to_params(self, v: Array) -> Array:
        """(n, d) -> (n, np), known ones filled in."""
        columns = iter(v.T)
        return np.stack([np.full(len(v), p.centre) if p.kind == "fixed" else p.from_coordinate(next(columns))
                         for p in self.priors], axis=1)

    def changes(self, y: Array) -> Array:
        """From one end of a period to the next, of (..., periods, ny)."""
        before = np.roll(y, 1, axis=-2)
        before[..., self.first, :] = self.start
        return y - before


class Simulations:
    """Simulates coordinates, counts what failed and leaves it out, and adds noise: the sensors' to every value, and to
    the start that a simulation is given, so that the doubt of a measured start is in what it shows."""

    def __init__(self, problem: Problem, progress: Callable[[int], None] | None = None, purpose: int = 0) -> None:
        self.problem, self.progress, self.purpose = problem, progress, purpose
        self.total = self.failed = 0
        self.first_failure = ""

    def run(self, v: Array) -> tuple[Array, Array]:
        """The coordinates that did not fail and what was measured of them: (n, d), (n, periods, ny)."""
        good, y = self.marked(v)
        if len(v) and not good.any():
            raise InferenceError(f"all {len(v)} simulations failed, the first by: {self.first_failure}; try the "
                                 "simulator by hand, or narrow the priors")
        return v[good], y

    def marked(self, v: Array) -> tuple[npt.NDArray[np.bool_], Array]:
        """Which coordinates did not fail, and what was measured of those."""
        p = self.problem
        rng = np.random.default_rng([p.seed, self.purpose, self.total])
        starts = p.start + p.noise_sd * rng.normal(size=(len(v), *p.start.shape))
        y, failures = p.simulate(p.to_params(v), starts, rng.integers(1, 2**32, len(v)))
        y = y + p.noise_sd * rng.normal(size=y.shape)
        good = np.asarray(np.isfinite(y).all(axis=(1, 2)))
        self.total += len(v)
        self.failed += int((~good).sum())
        if not good.all() and not self.first_failure:
            self.first_failure = failures[int(np.argmin(good))] or "not finite"
        if self.progress:
            self.progress(self.total)
        return good, y[good]

    def warnings(self) -> list[str]:
        return [f"{self.failed} of {self.total} simulations failed and count as impossible, the first by: "
                f"{self.first_failure}"] if self.failed else []


def prior_of(told: dict[str, Any]) -> tuple[list[Prior], Mixture | None]:
    """As parameters_json() and mixture_json() of tools/robot/prior_json.hpp write them."""
    priors = [Prior(p["name"], p["kind"], p["numbers"][0] or 0.0, p["numbers"][1] or 0.0,
                    -np.inf if p["numbers"][2] is None else p["numbers"][2],
                    np.inf if p["numbers"][3] is None else p["numbers"][3], p["unit"]) for p in told["parameters"]]
    parts = told.get("prior_mixture")
    return priors, Mixture(*(np.array([c[key] for c in parts], float)
                             for key in ("weight", "mean", "covariance"))) if parts else None


def read_problem(path: str | Path, simulate_with: Callable[[dict[str, Any]], Simulate]) -> Problem:
    """From the file of `tiller data infer`: names, priors, noise, and the logs cut to pieces."""
    told = json.loads(Path(path).read_text(encoding="utf-8"))
    priors, mixture = prior_of(told)
    pieces, ny, nu = told.pop("pieces"), len(told["measurements"]), len(told["inputs"])
    lengths = [len(piece["measured"]) for piece in pieces]
    joined = {key: np.array([row for piece in pieces for row in piece[key]], float) for key in ("inputs", "measured")}
    return Problem(
        name=told["simulator"], priors=priors, measurements=told["measurements"], seed=told["seed"],
        noise_sd=np.array(told["noise_sd"], float), first=np.cumsum([0, *lengths], dtype=np.int64)[:-1],
        start=np.array([piece["start"] for piece in pieces], float).reshape(len(pieces), ny),
        inputs=joined["inputs"].reshape(-1, nu), measured=joined["measured"].reshape(-1, ny),
        simulate=simulate_with(told | {"lengths": lengths, "inputs_by_piece": [p["inputs"] for p in pieces]}),
        mixture=mixture, told=told)
