"""Approximate Bayesian computation on single periods: each is simulated from the measured state before it, with noise,
and all of them are told by one number per parameter."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .. import abc, mcmc
from ..options import Options
from ..problem import Array, InferenceError, Problem, Simulations
from ..result import Inferred
from .logs import Logs
from .settings import Settings

SLOPE_STEP = 0.01  # of the prior's deviation
SURVEY = 2048  # draws that tell the prior's medians and deviations


class Estimates:
    """What an auxiliary linear model estimates (Drovandi, Pettitt, Faddy, JRSS C 2011): with D the changes over each
    period, D0 and J the model's at the prior's medians v0, and V their variances, one Gauss-Newton step

        s(D) = v0 + (J' V^-1 J)^-1 J' V^-1 (D - D0)

    It is sufficient where the model is linear in its parameters."""

    def __init__(self, problem: Problem, logs: Logs) -> None:
        self.problem, self.logs = problem, logs
        self.rows = logs.known.all(axis=1)
        prior = problem.draw(np.random.default_rng([problem.seed, 2]), SURVEY)
        self.median, d = np.median(prior, axis=0), problem.dimension
        step = SLOPE_STEP * prior.std(axis=0)
        v = np.concatenate([self.median[None], self.median + np.diag(step), self.median - np.diag(step)])
        states = np.concatenate([s[self.rows] for _, s in logs.blocks(problem.to_params(v))], axis=2)
        self.centre = states[..., 0]
        slope = ((states[..., 1:1 + d] - states[..., 1 + d:]) / (2 * step)).reshape(-1, d)
        self.noise_sd = np.sqrt(logs.process_sd**2 * logs.period_s + logs.start_sd**2 + logs.state_sd**2)[self.rows]
        weighed = slope.T / logs.variance()[self.rows].reshape(-1)
        normal = weighed @ slope
        if not np.isfinite(normal).all():
            raise InferenceError("at the prior's medians the model does not stay finite: none stayed finite there; "
                                 "narrow the priors or raise substeps")
        # what a parameter does not move must not make the others' statistics infinite
        normal += np.diag(1e-9 * (np.diag(normal) + 1e-300) + 1e-300)
        self.gain = np.linalg.solve(normal, weighed)  # (d, rows nx)
        off = logs.wrapped(logs.state[self.rows] - self.centre)
        self.observed = self.median + self.gain @ off.reshape(-1)

    def simulated(self, params: Array, _starts: Array, seeds: npt.NDArray[np.int64]) -> tuple[Array, list[str]]:
        """s of candidates (n, np) as (n, 1, d); NaN where a period was not finite."""
        out = np.empty((len(params), 1, len(self.median)))
        with np.errstate(invalid="ignore", over="ignore"):
            for some, states in self.logs.blocks(params):
                next_state = states[self.rows]
                rng = np.random.default_rng(int(seeds[some.start]))
                noise = self.noise_sd[..., None] * rng.standard_normal(next_state.shape)
                off = (next_state + noise - self.centre[..., None]).reshape(self.gain.shape[1], -1)
                out[some, 0] = self.median + (self.gain @ off).T
        return out, ["a period did not stay finite"] * len(params)


def fit(problem: Problem, logs: Logs, settings: Settings, method: str) -> Inferred:
    estimates = Estimates(problem, logs)
    d = problem.dimension
    told = replace(problem, noise_sd=np.zeros(d), start=np.zeros((1, d)), measured=estimates.observed[None],
                   simulate=estimates.simulated)
    options = Options(method, "given", settings.simulations, accept=settings.accept, epsilon=settings.epsilon)
    run = {"abc": abc.rejection, "abc_regression": abc.regression, "smc_abc": abc.smc, "mcmc_abc": mcmc.run}[method]
    simulations = Simulations(told)
    result = run(told, options, simulations)
    result.simulations, result.failed = simulations.total, simulations.failed
    return result
