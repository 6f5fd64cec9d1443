"""IBIS of `particles` on the pendulum of the accuracy benchmark: CPU time of every tick of an episode.

    ibis_peer.py EPISODES

1,024 particles either way: standard IBIS (N = 1024), and the waste-free one that the package prefers (128 chains of 8);
default moves and threshold. The model is told the noise's true deviations, which tiller's posterior has to find out:
this favours the peer. It is written as the package's manual does (logpyt alone, so that moves go through the ticks one
by one); beside it stands the same with the likelihood of all ticks overridden by one numpy expression.
"""

import sys
import time
import warnings

import numpy as np
import particles
from particles import distributions
from particles.smc_samplers import IBIS, StaticModel

import episodes as ep
from rounds import take_part

warnings.filterwarnings("ignore")


class Pendulum(StaticModel):
    def __init__(self, episode):
        task, x, u = episode.task, episode.state, episode.input
        low, high = dict(zip(task.parameters, task.low)), dict(zip(task.parameters, task.high))
        prior = distributions.StructDist({p: distributions.Uniform(low[p], high[p]) for p in task.parameters})
        change = np.diff(x, axis=0)
        self.torque = u - 0.02 * x[:-1, 1]
        self.pull = ep.GRAVITY * np.sin(x[:-1, 0])
        self.angle = change[:, 0] - ep.PERIOD * x[:-1, 1]
        self.rate = change[:, 1]
        self.gain = 0.5 / (episode.sigma * np.array(task.step_rms)) ** 2
        super().__init__(data=change, prior=prior)

    def logpyt(self, theta, t):
        length = theta["length_m"]
        turn = ep.PERIOD * (self.torque[t] / (theta["mass_kg"] * length * length) - self.pull[t] / length)
        return -self.gain[1] * (self.rate[t] - turn) ** 2 - self.gain[0] * (self.angle[t] - ep.PERIOD * turn) ** 2


class WholePendulum(Pendulum):
    def loglik(self, theta, t=None):
        last = self.T if t is None else t + 1
        length = theta["length_m"]
        turn = ep.PERIOD * (np.outer(self.torque[:last], 1 / (theta["mass_kg"] * length * length)) -
                            np.outer(self.pull[:last], 1 / length))
        return -(self.gain[1] * np.square(self.rate[:last, None] - turn).sum(0) +
                 self.gain[0] * np.square(self.angle[:last, None] - ep.PERIOD * turn).sum(0))


def run(kind, waste_free, episode, times=None):
    """The final particles and weights; CPU seconds of each tick into `times`."""
    np.random.seed(1)
    if waste_free:
        smc = particles.SMC(fk=IBIS(kind(episode), len_chain=8), N=128, verbose=False)
    else:
        smc = particles.SMC(fk=IBIS(kind(episode), wastefree=False), N=1024, verbose=False)
    while True:
        begin = time.process_time()
        try:
            next(smc)
        except StopIteration:
            return smc
        if times is not None:
            times.append(time.process_time() - begin)


def facts(kind, waste_free, episode):
    smc = run(kind, waste_free, episode)
    names = episode.task.parameters
    mean = np.array([np.average(smc.X.theta[p], weights=smc.W) for p in names])
    sd = np.sqrt([np.average((smc.X.theta[p] - m) ** 2, weights=smc.W) for p, m in zip(names, mean)])
    return {"mean": mean.tolist(), "sd": sd.tolist(), "truth": episode.truth.tolist(),
            "exact_mean": episode.exact["mean"].tolist(),
            "exact_sd": np.sqrt(np.diag(episode.exact["covariance"])).tolist(), "particles": len(smc.W)}


def main():
    episode = next(e for e in ep.read(sys.argv[1]) if e.task.name == "pendulum" and e.sigma == 0.03)
    contenders = {}
    for name, *how in (("particles IBIS", Pendulum, False), ("particles IBIS, waste-free", Pendulum, True),
                       ("particles IBIS, waste-free, vectorised", WholePendulum, True)):
        times = []

        def median(how=how, times=times):
            times.clear()
            run(*how, episode, times)
            return float(np.median(times))

        contenders[f"{name}/median"] = (median, facts(*how, episode))
        contenders[f"{name}/worst"] = (lambda times=times: max(times), {})
    take_part(contenders)


main()
