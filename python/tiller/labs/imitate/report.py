"""Tables and files of what was learnt."""
from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from .learn import POLICY_METHODS, Imitated, Options
from .network import HIDDEN, observed, weights_of
from .problem import Motion, Numbers, Problem


NAMES = {"adversarial": "adversarial imitation", "wasserstein": "adversarial imitation, Wasserstein",
         "iq_learn": "IQ-Learn"}


def _judgement(varies: bool, identified: bool) -> str:
    if not varies:
        return "never has a slope here: stays"
    return "" if identified else "not identified"


def _interval(low: float, high: float) -> str:
    return f"{low:.4g} .. {high:.4g}" if math.isfinite(low) and math.isfinite(high) else "-"


def _weights(result: Imitated) -> str:
    lines = [f"  {'weight':36} {'file':>12} {'learnt':>12} {'90 % interval':>25}"]
    lines += [f"  {w.key:36} {w.file:12.5g} {w.value:12.5g} "
              f"{_interval(w.low, w.high) if w.varies else '-':>25}  {_judgement(w.varies, w.identified)}"
              for w in result.fit.weights]
    lines += [f"  {t.target.key:36} {t.target.value:12.5g} {t.value:12.5g} {_interval(t.low, t.high):>25}  "
              f"{_judgement(True, t.identified)}" for t in result.fit.targets]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _replays(result: Imitated) -> str:
    text = (f"\n  {'demonstration':32} {'periods':>8} {'at limits':>10} {'its cost':>12} {'cost replanned':>14} "
            f"{'distance (was)':>14}\n")
    for r in result.replayed:
        d = r.demonstration
        text += (f"  {d.path:32} {d.motion.steps:8d} {d.limited:10.0%} {r.cost_demonstrated:12.5g} "
                 f"{r.cost_after:14.5g} {r.distance_after:6.3f} ({r.distance_before:.3f})\n")
    return text + "  distance: RMS of the replanned states from the demonstrated ones, over their spread there\n"


def _likelihood(result: Imitated) -> str:
    fit = result.fit
    text = (f"{fit.inputs} inputs judged, {fit.limited} more at limits\nlog likelihood {fit.log_likelihood:.1f} (the "
            f"file's weights: {fit.before:.1f}); {fit.iterations} iterations"
            f"{'' if fit.converged else ', not converged'}\n")
    for a, b in fit.alike:
        text += (f"{fit.weights[a].key} and {fit.weights[b].key}: the demonstrations tell their ratio to each other "
                 "better than their size\n")
    return text


def _policy(problem: Problem, o: Options, result: Imitated) -> str:
    assert result.acting is not None
    gap = result.acting.gap
    tenth = max(1, len(gap) // 10)
    text = (f"{problem.name}: {len(problem.demonstrations)} demonstrations; "
            f"a policy by {NAMES[o.method]}, {len(gap)} iterations, "
            f"rollouts of {result.horizon} periods\nnetwork: {len(problem.seen)} inputs, {HIDDEN} x {HIDDEN}, "
            f"{len(weights_of(result.acting.policy))} weights\nwhat the critic (of IQ-Learn: Q) still tells apart: "
            f"{np.mean(gap[-tenth:]):.3g} (first tenth of the iterations: {np.mean(gap[:tenth]):.3g})\n"
            f"\n  {'demonstration':32} {'periods':>8} {'at limits':>10} {'distance':>12} {'of cloning':>12}\n")
    for r in result.replayed:
        d = r.demonstration
        text += (f"  {d.path:32} {d.motion.steps:8d} {d.limited:10.0%} {r.distance_after:12.3f} "
                 f"{r.distance_before:12.3f}\n")
    return text + ("  distance: RMS of the states that the policy reaches on the model from the same start, over their "
                   "spread\n  cloning: least squares on the same inputs\n")


def text(problem: Problem, o: Options, result: Imitated) -> str:
    if o.method in POLICY_METHODS:
        return _policy(problem, o, result)
    ahead = f"a horizon of {result.horizon} periods" if result.horizon else "each one plan to its end"
    out = f"{problem.name}: {len(problem.demonstrations)} demonstrations; {ahead}\n"
    out += "".join(f"kept: {key} = {value:g}\n" for key, value in result.kept.items()) + _weights(result)
    if o.method == "matching":
        out += (f"plans spend at most {100 * result.matched.excess:.1f} % more of a feature than the demonstrations "
                f"(no weights: under {100 * result.matched.bound:.1f} %)\n")
    else:
        out += _likelihood(result)
    return out + _replays(result)


# ---- files --------------------------------------------------------------------------------------------


def finite(value: Any) -> Any:
    """JSON has no word for what is not a number."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [finite(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def _motion(problem: Problem, motion: Motion) -> dict[str, Any]:
    return {"states": dict(zip(problem.states, motion.states.T, strict=True)),
            "inputs": dict(zip(problem.inputs, motion.inputs.T, strict=True))}


def document(problem: Problem, o: Options, result: Imitated) -> dict[str, Any]:
    fit, matched = result.fit, result.matched
    policy = policy_document(problem, result)["network"] if result.acting else {"inputs": [], "hidden": [0, 0],
                                                                                "weights": []}
    replayed = [{"path": r.demonstration.path, "first_time_s": r.demonstration.first_time_s,
                 "period_s": problem.period_s, "misfit": r.demonstration.misfit, "at_limits": r.demonstration.limited,
                 "measured": r.demonstration.measured, "demonstrated": _motion(problem, r.demonstration.motion),
                 "before": _motion(problem, r.before), "after": _motion(problem, r.after),
                 "cost_demonstrated": r.cost_demonstrated, "cost_after": r.cost_after,
                 "distance_before": r.distance_before, "distance_after": r.distance_after} for r in result.replayed]
    out = {"robot": problem.name, "method": o.method, "horizon": result.horizon, "every": result.every,
           "inputs": fit.inputs, "inputs_at_limits": fit.limited, "nats": fit.nats,
           "input_noise_sd": dict(zip(problem.inputs, map(float, fit.noise_sd), strict=False)),
           "log_likelihood": fit.log_likelihood, "log_likelihood_before": fit.before, "converged": fit.converged,
           "kept": [{"key": key, "value": value} for key, value in result.kept.items()],
           "weights": [{"key": w.key, "file": w.file, "value": w.value, "interval_90": [w.low, w.high],
                        "log_sd": w.log_sd, "varies": w.varies, "identified": w.identified} for w in fit.weights],
           "targets": [{"key": t.target.key, "file": t.target.value, "value": t.value, "interval_90": [t.low, t.high],
                        "identified": t.identified} for t in fit.targets],
           "alike": [[fit.weights[a].key, fit.weights[b].key] for a, b in fit.alike],
           "surprise": fit.surprise, "persistence": fit.persistence, "units": problem.units,
           "demonstrations": replayed,
           "matching": {"excess": matched.excess, "bound": matched.bound, "demonstrated": matched.demonstrated,
                        "made": matched.made},
           "policy": {"inputs": policy["inputs"], "hidden": policy["hidden"], "weights": len(policy["weights"]),
                      "gap": result.acting.gap if result.acting else []}, "warnings": result.warnings}
    return dict(finite(out))


def _range(problem: Problem, motions: list[Motion]) -> tuple[Numbers, Numbers]:
    rows = np.concatenate([np.asarray(observed(jnp.asarray(m.states), problem.scene.angles.tolist()))
                           for m in motions])
    return rows.min(0), rows.max(0)


def policy_document(problem: Problem, result: Imitated) -> dict[str, Any]:
    """As docs/reference/networks.md has it, watched within what it was shown and does."""
    assert result.acting is not None
    low, high = _range(problem, result.seen)
    return {"format": "tiller policy", "version": 1, "reads": ["state"], "squash": "sine", "input_low": low.tolist(),
            "input_high": high.tolist(),
            "network": {"kind": "tanh", "inputs": problem.seen, "outputs": problem.inputs, "members": 1,
                        "hidden": [HIDDEN, HIDDEN], "weights": weights_of(result.acting.policy)}}


def write_text(path: Path, content: str) -> None:
    """Whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(path.name + ".new")
    draft.write_text(content, encoding="utf-8")
    draft.replace(path)


def write_json(path: Path, content: dict[str, Any]) -> None:
    write_text(path, json.dumps(content, indent=1) + "\n")
