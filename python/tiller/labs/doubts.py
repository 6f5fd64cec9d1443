"""Reasons to doubt a result, as sentences for the user."""
from __future__ import annotations

import numpy as np

from .problem import Array, InferenceError, Problem, Simulations
from .result import Inferred, quantile, resampled

CHECKED = 40  # draws that are simulated once more
UNLIKE = 4.0  # of a channel, in deviations of its simulations
AS_WIDE, AS_CENTRED = 0.9, 0.3  # of the prior's deviation
LAYER = 0.02  # of the prior's range, next to a bound
ZONE, SHARE, RISE = 0.02, 0.3, 0.4  # of the prior next to a bound; of the posterior in it; its median over its 90 %
TAIL = 0.005  # of the prior
ERRORS = 3.0  # standard errors of a coverage
OFF = 0.05  # of a coverage: .85 are intervals an eighth too narrow; one network is narrower than their average


def _edge(problem: Problem, result: Inferred, j: int) -> str:
    """Whether a posterior piles up at a bound of its prior, or lies in its tails."""
    prior, v, law = problem.learnt[j], result.v[:, j], problem.learnt[j].law()
    for side, bound, u in (("lower", problem.low[j], ZONE), ("upper", problem.high[j], 1 - ZONE)):
        distance = np.abs(v - bound)
        if not np.isfinite(bound) or result.weight[distance < abs(law.ppf(u) - bound)].sum() <= SHARE:
            continue
        if quantile(distance, result.weight, 0.5) <= RISE * quantile(distance, result.weight, 0.9):
            return f"{prior.name} at its {side} bound {prior.from_coordinate(bound):.4g}: widen the prior"
    if prior.kind == "uniform" or problem.mixture is not None:
        return ""
    median = quantile(v, result.weight, 0.5)
    for word, u, beyond in (("below", TAIL, median < law.ppf(TAIL)), ("above", 1 - TAIL, median > law.ppf(1 - TAIL))):
        if beyond:
            return (f"{prior.name} {word} {prior.from_coordinate(law.ppf(u)):.4g}, beyond 99.5 % of its prior: widen "
                    "the prior")
    return ""


def _uninformed(problem: Problem, result: Inferred, j: int) -> str:
    mean = float(result.weight @ result.v[:, j])
    sd, law = float(np.sqrt(result.weight @ (result.v[:, j] - mean) ** 2)), problem.learnt[j].law()
    # a joint prior is what earlier logs told: that another log adds little to it is no doubt
    if problem.mixture is not None or sd < AS_WIDE * law.std() or abs(mean - law.mean()) > AS_CENTRED * law.std():
        return ""
    return (f"{problem.learnt[j].name}: as wide as its prior ({sd / law.std():.2f} of the deviation): seen through the "
            f"summary {result.options.summary}, the logs tell nothing of it; try another --summary, or logs in which "
            "it acts")


def _miscalibrated(problem: Problem, result: Inferred, j: int) -> str:
    coverage = result.coverage()
    if coverage is None or result.ranks is None:
        return ""
    error = np.sqrt(0.9 * 0.1 / len(result.ranks))
    if abs(coverage[j] - 0.9) <= max(OFF, ERRORS * error):
        return ""
    how = ("too narrow: raise --simulations" if coverage[j] < 0.9 else
           "wider than need be: raise --simulations for a sharper answer")
    return (f"{problem.learnt[j].name}: 90 % intervals hold {coverage[j]:.0%} of {len(result.ranks)} draws that were "
            f"held out; the interval is likely {how}")


def _layer(problem: Problem, result: Inferred, j: int) -> str:
    """Where nothing fits, the posterior is a thin layer at a bound, which need not rise towards it."""
    low, high, mean = problem.low[j], problem.high[j], float(result.weight @ result.v[:, j])
    if not np.isfinite(high - low) or LAYER < (mean - low) / (high - low) < 1 - LAYER:
        return ""
    prior = problem.learnt[j]
    bound = prior.from_coordinate(low if mean < 0.5 * (low + high) else high)
    return f"{prior.name} at the edge of its prior, {bound:.4g}: the prior may leave the truth out; widen it"


def unlikeness(y: Array, observed: Array) -> Array:
    """Of each channel, the logs' distance from the simulations' mean over their deviation, root mean square."""
    distance = ((observed - y.mean(axis=0)) ** 2).sum(axis=0)
    # a channel without any noise: rounding is no doubt
    variance = y.var(axis=0, ddof=1).sum(axis=0) + 1e-18 * (observed**2).sum(axis=0) + 1e-300
    return np.asarray(np.sqrt(distance / variance))


def add_doubts(problem: Problem, result: Inferred) -> None:
    """Simulates a few draws of the posterior once more (a posterior predictive check: Gelman, Meng, Stern 1996)."""
    for ask in (_edge, _uninformed, _miscalibrated):
        result.warnings += [text for j in range(problem.dimension) if (text := ask(problem, result, j))]
    again = Simulations(problem, purpose=9)
    try:
        _, y = again.run(resampled(result.v, result.weight, CHECKED))
    except InferenceError:
        return  # all failed: that some do is told already
    finally:
        result.simulations += again.total
    if len(y) < CHECKED // 2:
        return
    far = unlikeness(y, problem.measured)
    found = [f"{name}: the logs lie {f:.1f} deviations from what the posterior's simulations show (1 is expected): the "
             "simulator explains them poorly; compare units, signs and times, the noise in the file, and what the "
             "simulator leaves out" for name, f in zip(problem.measurements, far) if f > UNLIKE]
    if found:
        result.warnings += found + [text for j in range(problem.dimension) if (text := _layer(problem, result, j))]
