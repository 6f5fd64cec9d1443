"""Markov chains without a likelihood (Marjoram, Molitor, Plagnol, Tavare, PNAS 2003)."""
from __future__ import annotations

import numpy as np

from .abc import Distances, adjusted, epanechnikov, length
from .options import Options
from .problem import InferenceError, Problem, Simulations
from .result import Inferred, normalised

PILOT = 0.5  # of the simulations: draws from the prior that set tolerance, starts and steps
STEP = 2.38  # of the covariance's root, over sqrt(d) (Gelman, Roberts, Gilks 1996)
BURN_IN = 0.2  # of the chains


def run(problem: Problem, o: Options, simulations: Simulations) -> Inferred:
    """The tolerance lets in a share `accept` of the pilot, which the chains start from (Wegmann et al., Genetics 2009);
    a step is taken where the simulation is within it, by the ratio of the priors. The end is corrected by
    regression."""
    result, rng, d = Inferred(problem, o), np.random.default_rng([problem.seed, 1]), problem.dimension
    pilot = round(PILOT * o.simulations)
    v, y = simulations.run(problem.draw(rng, pilot))
    distances = Distances(o.summary, problem, v, y)
    kept, least = min(round(o.accept * pilot), len(v)), d + 3
    if kept < least:
        raise InferenceError(f"{kept} draws of the pilot would be kept, and {least} are needed; raise --simulations or "
                             "--accept")
    nearest = np.argsort(length(distances.off), kind="stable")[:kept]
    epsilon = length(distances.off[nearest[-1]])
    result.add_round(v[nearest], np.ones(kept), float(epsilon), float(length(distances.off[nearest[0]])))
    covariance = np.atleast_2d(np.cov(v[nearest].T))
    step = STEP / d**0.5 * np.linalg.cholesky(covariance + 1e-9 * np.diag(np.diag(covariance)))
    at = rng.choice(nearest, min(o.particles, max(1, (o.simulations - pilot) // 10)))
    now, off, log_prior = v[at], distances.off[at], problem.log_prior(v[at])
    steps, all_v, all_off, moved = (o.simulations - pilot) // len(now), [], [], 0
    for _ in range(steps):
        tried = now + rng.normal(size=now.shape) @ step.T
        log_tried = problem.log_prior(tried)
        open_ = np.flatnonzero(np.log(rng.uniform(size=len(now))) < log_tried - log_prior)
        if len(open_):  # what the priors refuse need not be simulated
            good, found = simulations.marked(tried[open_])
            tried_off = (distances.summary.of(found) - distances.observed) / distances.scale
            within = length(tried_off) <= epsilon
            taken = open_[good][within]
            now[taken], off[taken], log_prior[taken] = tried[taken], tried_off[within], log_tried[taken]
            moved += len(taken)
        all_v.append(now.copy())
        all_off.append(off.copy())
    first = int(BURN_IN * steps)
    v, off = np.concatenate(all_v[first:]), np.concatenate(all_off[first:])
    weight = epanechnikov(length(off))
    result.v, result.weight = adjusted(problem, v, off, weight), normalised(weight)
    result.add_round(result.v, result.weight, float(epsilon), float(length(off).min()))
    if moved < 0.05 * steps * len(now):
        result.warnings.append(f"only {moved} of {steps * len(now)} steps of the chains were taken: they may not have "
                               "mixed; raise --accept")
    return result
