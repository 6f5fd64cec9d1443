"""What `tiller infer` can be asked for; nothing here imports JAX."""
from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass
class Options:
    method: str = "bayes_sim"
    summary: str = "linear"
    simulations: int = 5000  # parameter vectors in all
    rounds: int = 5  # of bayes_sim
    components: int = 3  # of its mixture
    density: str = "mixture"  # of bayes_sim
    accept: float = 0.01  # share that abc and abc_regression keep, and that sets mcmc_abc's tolerance
    particles: int = 200  # of smc_abc; chains of mcmc_abc
    epsilon: float = float("nan")  # tolerance of abc and abc_regression, in the place of the share


class Method(NamedTuple):
    function: str  # module.function of this package: (Problem, Options, Simulations) -> Inferred
    help: str
    citation: str
    caveat: str


METHODS = {
    "bayes_sim": Method("neural.run", "a mixture-density network that simulations teach, in rounds around the logs",
                        "Ramos, Possas, Fox, RSS 2019; Possas et al., IROS 2020: Online BayesSim",
                        "as good as the network: compare with smc_abc where much depends on the width"),
    "smc_abc": Method("abc.smc", "a population whose tolerance falls, corrected by regression at the end",
                      "Toni et al., J. R. Soc. Interface 2009; Beaumont et al., Biometrika 2009",
                      "wider than the posterior by what the last tolerance lets in"),
    "mcmc_abc": Method("mcmc.run", "chains that stay within a tolerance, corrected by regression at the end",
                       "Marjoram et al., PNAS 2003; Wegmann, Leuenberger, Excoffier, Genetics 2009",
                       "wider than the posterior by what the tolerance lets in; draws of a chain resemble each other"),
    "abc": Method("abc.rejection", "the draws from the prior that come nearest",
                  "Pritchard et al., Mol. Biol. Evol. 1999", "wider than the posterior by what the tolerance lets in"),
    "abc_regression": Method("abc.regression", "the same, corrected by local-linear regression",
                             "Beaumont, Zhang, Balding, Genetics 2002",
                             "the correction is linear within the tolerance"),
}

SUMMARY_NAMES = ("linear", "cross_correlation", "recurrent")
DENSITY_NAMES = ("mixture", "fourier")
