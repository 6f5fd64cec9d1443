"""learn(): what `tiller imitate` does once the demonstrations are read."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np

from . import network
from .adversarial import Adversarial, AdversarialOptions, fit_policy
from .cost import Cost, make_cost, motion_features, rollout_features, whole_cost
from .expand import expand, sides
from .expansion import FREE, GIVEN
from .iq import IqOptions, fit_iq
from .matching import Matched, match
from .maxent import Fit, Target, Weight, fit_weights
from .plan import Planner
from .problem import Demonstration, ImitationError, Motion, Numbers, Problem
from .robot_text import number, suggestion, weights, with_numbers

MOST_REPLAYED = 6
POLICY_METHODS = ("adversarial", "wasserstein", "iq_learn")


@dataclass
class Options:
    method: str = "maxent"
    keep: list[str] = field(default_factory=list)
    targets: list[str] = field(default_factory=list)
    scale: str = ""
    horizon: int = -1  # periods; 0: whole; -1: the planner's, and 60 of a policy's rollouts
    every: int = 0
    rounds: int = 40
    iterations: int = 400
    seed: int = 1


@dataclass
class Replayed:
    demonstration: Demonstration
    before: Motion  # by the robot file's weights; of a policy by cloning
    after: Motion   # by what is learnt
    cost_demonstrated: float
    cost_after: float
    distance_before: float = 0.0
    distance_after: float = 0.0


@dataclass
class Imitated:
    kept: dict[str, float] = field(default_factory=dict)
    fit: Fit = field(default_factory=Fit)
    matched: Matched = field(default_factory=Matched)
    acting: Adversarial | None = None
    seen: list[Motion] = field(default_factory=list)
    horizon: int = 0
    every: int = 1
    replayed: list[Replayed] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    text: str = ""  # the robot file with the learnt numbers; of a policy as it was


Progress = Callable[[str], None] | None


def choose(problem: Problem, o: Options) -> tuple[dict[str, float], dict[str, float]]:
    """Weights that are learnt, and that are kept: the input weight that fixes the scale, and what is named."""
    learnt = weights(problem.text)
    known = list(learnt)
    first = next((key for key in known if key.startswith("cost.input_weight.")), None)
    if first is None:
        raise ImitationError("cost.input_weight: no input has one, so that nothing fixes the scale of the cost; write "
                             "one above 0")
    kept = {}
    for option, key in [*(("--keep", k) for k in o.keep), ("--scale", o.scale or first)]:
        if key not in known:
            raise ImitationError(f"{option} {key}: is no weight above 0 of the robot file; {suggestion(key, known)}")
        if key in learnt:
            kept[key] = learnt.pop(key)
    if not learnt:
        raise ImitationError("cost: every weight above 0 is kept; leave one to be learnt: " + ", ".join(known))
    return learnt, kept


def target_of(problem: Problem, learnt: Sequence[str], state: str) -> Target:
    if state not in problem.states:
        raise ImitationError(f"--target {state}: is no state; {suggestion(state, problem.states)}")
    key, at = f"cost.target.{state}", problem.states.index(state)
    value = number(problem.text, key)
    if value is None:
        raise ImitationError(f"{key}: is no number in the file; write the one that the search is to begin at")
    paths = (f"cost.state_weight.{state}", f"cost.terminal_weight.{state}")
    of = tuple(list(learnt).index(p) if p in learnt else -1 for p in paths)
    kept = tuple(number(problem.text, p) or 0.0 for p in paths)
    if not any(kept):
        raise ImitationError(f"{key}: the state has no weight, so that its target says nothing; give it a state_weight")
    there = np.zeros(len(problem.states))
    there[at] = value
    unit = max(float(np.abs(problem.scene.difference(d.motion.states, there)[:, at]).max())
               for d in problem.demonstrations)
    return Target(at, key, value, max(unit, 1e-6), (of[0], of[1]), (kept[0], kept[1]))


def spread_of(problem: Problem) -> Numbers:
    """(nx) RMS of the demonstrated states from the first one."""
    first = problem.demonstrations[0].motion.states[0]
    off = np.concatenate([np.asarray(problem.scene.difference(d.motion.states, first))
                          for d in problem.demonstrations])
    return np.sqrt((off**2).mean(0))


def distance(problem: Problem, a: Motion, b: Motion, spread: Numbers) -> float:
    off = np.asarray(problem.scene.difference(a.states, b.states))[:, spread > 0] / spread[spread > 0]
    return float(np.sqrt((off**2).mean())) if off.size else 0.0


def _judged_every(problem: Problem, horizon: int) -> int:
    """Of about 400 inputs a curve is as well known as of all."""
    return max(1, sum(max(0, d.motion.steps - horizon + 1) for d in problem.demonstrations) // 400)


def _replay(problem: Problem, cost: Cost, learnt_text: str, result: Imitated) -> None:
    spread = spread_of(problem)
    rates = np.array([number(learnt_text, f"cost.input_rate_weight.{i}") or r
                      for i, r in zip(problem.inputs, problem.rate_weight, strict=True)])
    before = Planner(problem.scene, whole_cost(problem, problem.text, problem.rate_weight))
    after = Planner(problem.scene, whole_cost(problem, learnt_text, rates))
    one = np.ones(1)
    for d in problem.demonstrations[:MOST_REPLAYED]:
        was, now = (p.replay(one, d.motion, result.horizon) for p in (before, after))
        costs = (float(motion_features(after.cost, d.motion)[0]),
                 float(rollout_features(after.cost, jnp.asarray(now.states[0]), jnp.asarray(now.inputs),
                                        jnp.asarray(now.inputs[0]))[0]))
        result.replayed.append(Replayed(d, was, now, *costs, distance(problem, was, d.motion, spread),
                                        distance(problem, now, d.motion, spread)))


def odd_motions(fit: Fit, demonstrations: Sequence[Demonstration]) -> list[str]:
    """Demonstrations that are no optimum of any such cost: far more surprising than the others, or off in the same
    direction for long, where an optimum followed with noise is off at random."""
    told, usual = [], np.nanmedian(fit.surprise)
    for d, surprise, persistence in zip(demonstrations, fit.surprise, fit.persistence, strict=True):
        if surprise > 4 * max(usual, 1e-12) and len(demonstrations) > 2:
            told.append(f"{d.path}: is {np.sqrt(surprise / usual):.1f} times as far from an optimum of the learnt cost "
                        "as the usual demonstration; leave it out and compare the weights")
        elif persistence > 0.8:
            told.append(f"{d.path}: differs from an optimum of the learnt cost in one direction for long (correlation "
                        f"{persistence:.2f} from an input to the next); no cost of this form was followed there, or "
                        "the plan had not converged")
    return told


def _cost(problem: Problem, o: Options, result: Imitated, progress: Progress) -> None:
    learnt, result.kept = choose(problem, o)
    if o.targets and o.method != "maxent":
        raise ImitationError("--target: is learnt by --method maxent alone; leave it out, or take that method")
    if problem.timed and result.horizon:
        raise ImitationError("cost.reference: depends on the time since the task began, which plans of a receding "
                             "horizon do not know here; give --horizon whole, or take the reference out of a copy")
    targets = [target_of(problem, list(learnt), state) for state in o.targets]
    cost = make_cost(problem, learnt)
    result.every = o.every or _judged_every(problem, result.horizon)
    motions = [expand(problem.scene, cost, jnp.asarray(d.motion.states), jnp.asarray(d.motion.inputs),
                      targets=[t.state for t in targets]) for d in problem.demonstrations]
    for d, e in zip(problem.demonstrations, motions, strict=True):
        d.limited = float(((e.side != FREE) & (e.side != GIVEN)).mean())
    start = np.array(list(learnt.values()))
    if o.method == "matching":
        result.matched = match(problem.scene, cost, [d.motion for d in problem.demonstrations], start, o.rounds,
                               result.horizon, (lambda share: progress(f"planning {share:4.0%}")) if progress else None)
        acts = result.matched.demonstrated[1:] > 0
        result.fit.weights = [Weight(key, file, float(value) if a else file, varies=bool(a)) for key, file, value, a
                              in zip(learnt, start, result.matched.value, acts, strict=True)]
    else:
        result.fit = fit_weights(motions, list(learnt), list(learnt.values()), result.horizon, result.every, targets, progress=(
            lambda i, value: progress(f"step {i}, {value:.1f} nats")) if progress else None)
        result.warnings += odd_motions(result.fit, problem.demonstrations)
    values = {w.key: w.value for w in result.fit.weights if w.varies}
    result.text = with_numbers(problem.text, values | {t.target.key: t.value for t in result.fit.targets})
    if progress:
        progress("replaying")
    _replay(problem, cost, result.text, result)


def _policy(problem: Problem, o: Options, result: Imitated, progress: Progress) -> None:
    scene, demonstrations = problem.scene, problem.demonstrations
    motions = [d.motion for d in demonstrations]
    result.horizon = min(result.horizon, max(m.steps for m in motions))
    told = (lambda share: progress(f"learning {share:4.0%}")) if progress else None
    if o.method == "iq_learn":
        fit = fit_iq(scene, motions, IqOptions(seed=o.seed, iterations=o.iterations, steps=result.horizon), told)
    else:
        fit = fit_policy(scene, motions, AdversarialOptions(wasserstein=o.method == "wasserstein", seed=o.seed,
                                                            iterations=o.iterations, steps=result.horizon), told)
    result.acting, spread, cost = fit, spread_of(problem), whole_cost(problem, problem.text, problem.rate_weight)
    for d in demonstrations:
        u = jnp.asarray(d.motion.inputs)
        d.limited = float((sides(scene, u, u[0], 1e-3) != FREE).mean())
    for d in demonstrations[:MOST_REPLAYED]:
        was, now = (Motion(*map(np.asarray, network.roll(scene, p, d.motion.states[0], d.motion.steps)))
                    for p in (fit.cloned, fit.policy))
        result.replayed.append(Replayed(d, was, now, float(motion_features(cost, d.motion)[0]),
                                        float(motion_features(cost, now)[0]), distance(problem, was, d.motion, spread),
                                        distance(problem, now, d.motion, spread)))
    result.seen = motions + [r.after for r in result.replayed if np.isfinite(r.after.states).all()]
    result.text = problem.text
    odd = [r for r in result.replayed if not r.distance_after <= 1]
    if odd:
        worst = max(odd, key=lambda r: np.nan_to_num(r.distance_after, nan=np.inf))
        result.warnings.append(
            f"the policy does something else than {len(odd)} of {len(result.replayed)} demonstrations show, on "
            f"{worst.demonstration.path} by {worst.distance_after:.1f} of their spread; it is not fit for the robot "
            "(more demonstrations, --iterations, --horizon)")


def learn(problem: Problem, o: Options, progress: Progress = None) -> Imitated:
    """Learns and replays. Raises ImitationError."""
    result = Imitated(warnings=list(problem.warnings))
    if o.method in POLICY_METHODS:
        for name, low, high in zip(problem.inputs, problem.scene.low, problem.scene.high, strict=True):
            if not (np.isfinite(low) and np.isfinite(high)):
                raise ImitationError(f"limits.{name}: a policy commands a share of the range; give low and high")
        result.horizon = o.horizon if o.horizon > 0 else 60
        _policy(problem, o, result, progress)
    else:
        result.horizon = o.horizon if o.horizon >= 0 else problem.horizon
        _cost(problem, o, result, progress)
    return result
