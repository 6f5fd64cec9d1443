"""infer(): the parameters of a black box from logs, without a likelihood (docs/theory/likelihood_free.md)."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from . import abc, neural
from .doubts import add_doubts
from .problem import InferenceError, Problem, Simulations
from .result import Inferred, Options


class Method(NamedTuple):
    run: Callable[[Problem, Options, Simulations], Inferred]
    help: str
    citation: str
    caveat: str


METHODS = {
    "bayes_sim": Method(neural.run, "a mixture-density network that simulations teach, in rounds around the logs",
                        "Ramos, Possas, Fox, RSS 2019; Possas et al., IROS 2020: Online BayesSim",
                        "as good as the network: compare with smc_abc where much depends on the width"),
    "smc_abc": Method(abc.smc, "a population whose tolerance falls, corrected by regression at the end",
                      "Toni et al., J. R. Soc. Interface 2009; Beaumont et al., Biometrika 2009",
                      "wider than the posterior by what the last tolerance lets in"),
    "abc": Method(abc.rejection, "the draws from the prior that come nearest",
                  "Pritchard et al., Mol. Biol. Evol. 1999", "wider than the posterior by what the tolerance lets in"),
    "abc_regression": Method(abc.regression, "the same, corrected by local-linear regression",
                             "Beaumont, Zhang, Balding, Genetics 2002",
                             "the correction is linear within the tolerance"),
}


def infer(problem: Problem, options: Options | None = None,
          progress: Callable[[float], None] | None = None) -> Inferred:
    """Runs options.method and looks for doubts. Raises InferenceError. The same problem on the same machine gives the
    same bits. `progress` is told the share of the simulations that is done."""
    o = options or Options()
    if o.method not in METHODS:
        raise InferenceError(f"no method is called {o.method}; choose one of {', '.join(METHODS)}")
    simulations = Simulations(problem, (lambda n: progress(n / o.simulations)) if progress else None)
    result = METHODS[o.method].run(problem, o, simulations)
    result.simulations, result.failed = simulations.total, simulations.failed
    result.warnings = simulations.warnings() + result.warnings
    add_doubts(problem, result)
    return result
