"""Sequential neural posterior estimation (BayesSim: Ramos, Possas, Fox, RSS 2019; Possas et al., IROS 2020), in rounds.

A round: v ~ the prior first, then the posterior so far, widened; simulate; learn the summary and train q(v | s) on the
draws of this round and of those before but the first, whose law p~ is the mixture of their proposals; the posterior is
q(v | s of the logs) p(v) / p~(v). A draw outside of the ellipsoids that hold 99.9 % of the normals of this round's
proposal gets no weight: the networks have seen little there.
"""
from __future__ import annotations

import numpy as np

from .density import Ensemble
from .mixture import Mixture, fit_mixture
from .options import Options
from .problem import Array, InferenceError, Problem, Simulations
from .result import Inferred, effective, normalised, resampled
from .summary import Sequence, make_summary

ANSWERS, FITTED = 4096, 512
WIDER = 2.0  # of a proposal's deviations over the posterior's before it
FEW = ANSWERS / 10  # effective draws after the correction: a few of them have the say
FAR = 6.0  # deviations of the simulations' summaries: no simulation is like the logs


def _corrected(problem: Problem, q: Mixture, proposal: Mixture | None, pooled: Mixture | None,
               rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws of q with weights p / p~; all zero where none has been covered."""
    v = q.draw(rng, ANSWERS)
    log_weight = problem.log_prior(v)
    if proposal is None or pooled is None:
        log_weight = np.where(np.isfinite(log_weight), 0.0, -np.inf)
    else:
        inside = np.isfinite(log_weight) & proposal.covers(v)
        log_weight[~inside] = -np.inf
        log_weight[inside] -= pooled.log_density(v[inside])
    top = log_weight.max()
    if not np.isfinite(top):
        return v, np.zeros(ANSWERS)
    weight = np.exp(log_weight - top)
    # a few draws at the proposal's edge must not have all the say (Ionides, J. Comput. Graph. Stat. 2008)
    return v, np.minimum(weight, weight.mean() * ANSWERS**0.5)


def run(problem: Problem, o: Options, simulations: Simulations) -> Inferred:
    each, d = o.simulations // o.rounds, problem.dimension
    if each < 20 * (d + 1):
        raise InferenceError(f"{o.simulations} simulations in {o.rounds} rounds are too few for {d} parameters; raise "
                             f"--simulations to {20 * (d + 1) * o.rounds}, or lower --rounds")
    result = Inferred(problem, o)
    proposal: Mixture | None = None  # of this round
    pooled: Mixture | None = None  # of all draws that are learnt from
    v_before, y_before = np.empty(0), np.empty(0)
    for index in range(o.rounds):
        rng = np.random.default_rng([problem.seed, 1, index])
        v, y = simulations.run(proposal.draw(rng, each) if proposal else problem.draw(rng, each))
        if len(v) < 20:
            raise InferenceError(f"round {index + 1}: only {len(v)} simulations did not fail; narrow the priors")
        if proposal and pooled:
            v, y, pooled = np.concatenate([v_before, v]), np.concatenate([y_before, y]), pooled.beside(proposal)
        elif proposal:
            pooled = proposal
        v_before, y_before = v, y
        summary = make_summary(o.summary, problem)
        s = summary.learn(v, y)
        observed = summary.of(problem.measured[None])[0]
        networks = Ensemble(s, v, o.components, problem.seed + 1000 * index, o.density,
                            summary.inputs if isinstance(summary, Sequence) else None)
        v, w = _corrected(problem, networks.at(observed), proposal, pooled, rng)
        spread = np.where(s.std(axis=0) > 0, s.std(axis=0), 1.0)
        far = float(np.abs((observed - s.mean(axis=0)) / spread).max())
        if not w.sum() > 0:
            raise InferenceError(
                f"round {index + 1}: the density at the logs lies outside of what was simulated"
                f"{', as do the logs themselves' if far > FAR else ''}; widen the priors, which may leave the truth "
                "out, check that simulator and logs mean the same, or raise --simulations")
        result.add_round(v, w, discrepancy=networks.loss)
        if index + 1 < o.rounds:
            fitted = fit_mixture(resampled(v, w, FITTED), np.ones(FITTED), problem.low, problem.high)
            proposal = fitted.widened(WIDER).over_its_cut(rng)
    if far > FAR:
        result.warnings.append(f"the logs' summary lies {far:.1f} deviations from the centre of the last round's "
                               "simulations: no parameters of the simulator explain the logs")
    if effective(w) < FEW:
        result.warnings.append(f"only {effective(w):.0f} of {ANSWERS} draws count after the correction: "
                               "the posterior may be far too wide; raise --simulations")
    result.v, result.weight = v, normalised(w)
    result.ranks = networks.ranks(problem.seed)
    return result
