"""Batch Markov chains (emcee) on exported episodes: mean and deviation of the posterior, one line of JSON an episode.

    mcmc_peer.py EPISODES... [--sigma S] [--episodes N]

32 walkers, the package's default stretch move; begun in a small ball around the best of some prior draws, climbed
uphill; a third thrown away. The density is that of episodes.py: all data at once, noise marginalised as tiller does it.
Nothing is shared with tiller but the equations.
"""

import argparse
import json
import time

import emcee
import numpy as np
from scipy.optimize import minimize

import episodes as ep

WALKERS, STEPS = 32, 4500


def climb(episode, rng):
    draws = ep.draw_prior(episode.task, 500, rng)
    value = ep.log_posterior(episode, draws)
    best = max((minimize(lambda p: -ep.log_posterior(episode, p)[0], draws[i], method="Nelder-Mead",
                         options={"xatol": 1e-7, "fatol": 1e-4, "maxiter": 2000})
                for i in np.argsort(value)[-3:]), key=lambda r: -r.fun)
    return best.x


def sample(episode):
    rng = np.random.default_rng(episode.seed)
    begin = time.process_time()
    mode = climb(episode, rng)
    start = mode * (1 + 1e-4 * rng.standard_normal((WALKERS, len(mode))))
    start = np.clip(start, np.array(episode.task.low) + 1e-9, np.array(episode.task.high) - 1e-9)
    np.random.seed(episode.seed)  # emcee draws from numpy's own stream
    sampler = emcee.EnsembleSampler(WALKERS, len(mode), lambda p: ep.log_posterior(episode, p), vectorize=True)
    sampler.run_mcmc(start, STEPS)
    chain = sampler.get_chain(discard=STEPS // 3, flat=True)
    return {"task": episode.task.name, "sigma": episode.sigma, "seed": episode.seed, "mean": chain.mean(0).tolist(),
            "sd": chain.std(0).tolist(), "exact_mean": episode.exact["mean"].tolist(),
            "exact_sd": np.sqrt(np.diag(episode.exact["covariance"])).tolist(),
            "correlated_steps": float(np.max(sampler.get_autocorr_time(quiet=True))), "draws": len(chain),
            "seconds": time.process_time() - begin}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("episodes", nargs="+")
    parser.add_argument("--sigma", type=float, default=0.03)
    parser.add_argument("--episodes", dest="count", type=int, default=5)
    args = parser.parse_args()
    every = [e for folder in args.episodes for e in ep.read(folder) if e.sigma == args.sigma]
    for name in ep.TASKS:
        for episode in [e for e in every if e.task.name == name][: args.count]:
            print(json.dumps(sample(episode)), flush=True)


main()
