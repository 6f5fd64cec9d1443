"""What an inference leaves: a table, infer.json for the page, and posterior.json for a robot."""
from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from .infer import METHODS
from .mixture import fit_mixture
from .problem import Array, Problem
from .result import Inferred, effective, quantile, resampled

SAMPLES = 512


def _number(value: float) -> float | None:
    """JSON has no NaN; six digits are more than any result is known to."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def _rows(result: Inferred) -> list[dict[str, Any]]:
    """Each parameter before and after."""
    p, rows, learnt = result.problem, [], iter(range(result.problem.dimension))
    before, after, coverage = p.to_params(prior_draws(p)), result.params, result.coverage()
    for i, prior in enumerate(p.priors):
        mean = float(result.weight @ after[:, i])
        row: dict[str, Any] = {"name": prior.name, "unit": prior.unit, "fixed": prior.kind == "fixed", "mean": mean}
        rows.append(row)
        if row["fixed"]:
            continue
        j, equal = next(learnt), np.ones(len(before))
        low, median, high = (quantile(after[:, i], result.weight, q) for q in (0.05, 0.5, 0.95))
        row |= {"sd": float(np.sqrt(result.weight @ (after[:, i] - mean) ** 2)), "median": median,
                "interval_90": [low, high],
                "prior": {"interval_90": [quantile(before[:, i], equal, q) for q in (0.05, 0.95)]}}
        if coverage is not None:
            row["held_out_coverage_90"] = float(coverage[j])
    return rows


def prior_draws(problem: Problem) -> Array:
    return problem.draw(np.random.default_rng([problem.seed, 7]), SAMPLES)


def text(result: Inferred, seconds: float) -> str:
    o, p = result.options, result.problem
    lines = [f"{p.name} by {o.method}, summary {o.summary}: {result.simulations} simulations of {len(p.first)} pieces, "
             f"{len(p.measured)} periods, {seconds:.3g} s", "",
             f"  {'parameter':26} {'prior 5 .. 95 %':>21} {'mean':>10} {'sd':>9} {'90 % interval':>21}"]
    for row in _rows(result):
        if row["fixed"]:
            lines.append(f"  {row['name']:26} {'known':>21} {row['mean']:10.4g}")
            continue
        between = ["{:.4g} .. {:.4g}".format(*r["interval_90"]) for r in (row["prior"], row)]
        lines.append(f"  {row['name']:26} {between[0]:>21} {row['mean']:10.4g} {row['sd']:9.2g} {between[1]:>21}")
    lines.append(f"  effective sample size {effective(result.weight):.0f}; mind: {METHODS[o.method].caveat}")
    if result.ranks is not None:
        held = ", ".join(f"{c:.0%}" for c in result.coverage())  # type: ignore[union-attr]
        lines.append(f"  calibration: 90 % intervals hold {held} of {len(result.ranks)} draws held out near the logs")
    return "\n".join(lines) + "\n"


def document(result: Inferred, seconds: float) -> dict[str, Any]:
    """infer.json, which `python -m tiller_tools.infer_report` draws."""
    o, p, method = result.options, result.problem, METHODS[result.options.method]
    learnt = [i for i, prior in enumerate(p.priors) if prior.kind != "fixed"]

    def samples(v: Array) -> list[list[float | None]]:
        return [[_number(row[i]) for i in learnt] for row in p.to_params(v)]

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: rounded(one) for key, one in value.items()}
        if isinstance(value, (list, np.ndarray)):
            return [rounded(one) for one in value]
        return _number(value) if isinstance(value, float) else value

    return {"tiller": __version__, "simulator": p.name, "simulator_file": p.told.get("simulator_file", ""),
            "command": p.told.get("command", []), "period_s": p.told.get("period_s"),
            "method": {"name": o.method, "citation": method.citation, "caveat": method.caveat}, "summary": o.summary,
            "simulations": result.simulations, "failed": result.failed, "pieces": len(p.first),
            "periods": len(p.measured), "seconds": _number(seconds),
            "effective_samples": _number(effective(result.weight)), "warnings": result.warnings,
            "logs": p.told.get("logs", []), "parameters": rounded(_rows(result)), "rounds": rounded(result.rounds),
            "held_out": 0 if result.ranks is None else len(result.ranks),
            "samples": samples(resampled(result.v, result.weight, SAMPLES)), "prior_samples": samples(prior_draws(p))}


def posterior(result: Inferred) -> dict[str, Any]:
    """posterior.json (docs/guide/episodes.md#the-file), for [posterior] prior_file or tiller run --posterior."""
    p = result.problem
    mixture = fit_mixture(resampled(result.v, result.weight, SAMPLES), np.ones(SAMPLES), p.low, p.high)
    parts = zip(mixture.weight / mixture.weight.sum(), mixture.mean, mixture.covariance)
    return {"format": "tiller posterior", "version": 1, "model": p.told.get("model", p.name),
            "parameters": [{"name": prior.name, "coordinate": "logarithm" if prior.is_logarithm else "value"}
                           for prior in p.learnt],
            "mixture": [{"weight": float(w), "mean": mean.tolist(), "covariance": (0.5 * (c + c.T)).tolist()}
                        for w, mean, c in parts],
            # no method here knows of a noise scale or an exponent
            "source": {"robot": p.name, "created_by": f"tiller {__version__}", "episodes": 0,
                       "transitions": len(p.measured), "particles": SAMPLES,
                       "effective_samples": effective(result.weight), "noise_scale": 1, "exponent": 1}}


def write_json(path: Path, value: dict[str, Any]) -> None:
    """Replaces the whole file, so that a reader never sees half of one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    with open(beside, "w", encoding="utf-8") as file:
        json.dump(value, file, indent=1, allow_nan=False)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
