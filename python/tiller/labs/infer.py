"""infer(): the parameters of a black box from logs, without a likelihood (docs/theory/likelihood_free.md)."""
from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from .doubts import add_doubts
from .options import METHODS, Options
from .problem import InferenceError, Problem, Simulations
from .result import Inferred

__all__ = ["METHODS", "infer"]


def infer(problem: Problem, options: Options | None = None,
          progress: Callable[[float], None] | None = None) -> Inferred:
    """Runs options.method and looks for doubts. Raises InferenceError. The same problem on the same machine gives the
    same bits. `progress` is told the share of the simulations that is done."""
    o = options or Options()
    if o.method not in METHODS:
        raise InferenceError(f"no method is called {o.method}; choose one of {', '.join(METHODS)}")
    if o.method != "bayes_sim" and (o.summary == "recurrent" or o.density != "mixture"):
        raise InferenceError(f"{o.method} trains no network; leave --summary recurrent and --density out, or choose "
                             "--method bayes_sim")
    if o.summary == "recurrent" and o.density != "mixture":
        raise InferenceError("--summary recurrent has a network of its own; leave --density out")
    simulations = Simulations(problem, (lambda n: progress(n / o.simulations)) if progress else None)
    module, function = METHODS[o.method].function.split(".")
    result: Inferred = getattr(import_module(f".{module}", __package__), function)(problem, o, simulations)
    result.simulations, result.failed = simulations.total, simulations.failed
    result.warnings = simulations.warnings() + result.warnings
    add_doubts(problem, result)
    return result
