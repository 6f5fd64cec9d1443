"""Neural posterior estimation (sbi) on the pendulum and the cart-pole of the accuracy benchmark.

    sbi_peer.py EPISODES... [--tests N] [--quick]

EPISODES: folders that `bench_accuracy --export` wrote; the first N of a task and noise level are its tests. One line of
JSON for every task, noise level, density estimator and number of simulations.

Settings are the package's defaults (batch 200, learning rate 5e-4, a tenth held out for validation, stop after 20
epochs without gain, z-scores); estimators its mixture density network and its neural spline flow. What an episode is
summarised by is near sufficient: each rate's change regressed on the terms that its equation of motion has, the
coefficients, and the logarithms of residual deviation and of each coefficient's deviation. Simulations are at the
test's noise level: the estimator is told sigma, which tiller's posterior has to find out. One training answers any
number of episodes.
"""

import argparse
import json
import time
import warnings

import numpy as np
import torch
from sbi.inference import NPE
from sbi.utils import BoxUniform

import episodes as ep

warnings.filterwarnings("ignore")
SIGMAS = (0.03, 0.3)


def terms(task, x, u):
    """Regressors of the rates' changes: (terms, ...)."""
    if task.name == "pendulum":
        return np.stack([u, np.sin(x[..., 0]), x[..., 1]])
    s, c, w2 = np.sin(x[..., 1]), np.cos(x[..., 1]), x[..., 3] ** 2
    return np.stack([u, s * w2, s * c, u * c, s * c * w2, s, u * c * c, s * c * c * w2])


def summaries(task, state, inputs):
    """(n, statistics) of episodes: state (n, ticks + 1, nx), inputs (n, ticks)."""
    rows = []
    half = task.states // 2
    regressors = np.moveaxis(terms(task, state[:, :-1], inputs), 0, -1)  # (n, ticks, terms)
    change = np.diff(state[:, :, half:], axis=1) / ep.PERIOD
    count = regressors.shape[-1]
    for a, b in zip(regressors, change):
        normal = a.T @ a
        normal += 1e-9 * np.trace(normal) / count * np.eye(count)
        inverse = np.linalg.inv(normal)
        coefficients = inverse @ (a.T @ b)
        deviation = np.sqrt(np.mean((b - a @ coefficients) ** 2, axis=0)) + 1e-12
        rows.append(np.concatenate([coefficients.ravel(), np.log(deviation), 0.5 * np.log(np.diag(inverse))]))
    return np.clip(np.nan_to_num(rows, nan=0.0, posinf=1e6, neginf=-1e6), -1e6, 1e6)


def tensor(values):
    return torch.as_tensor(np.asarray(values), dtype=torch.float32)


def train(task, estimator, theta, x):
    inference = NPE(prior=BoxUniform(tensor(task.low), tensor(task.high)), density_estimator=estimator,
                    show_progress_bars=False)
    inference.append_simulations(tensor(theta), tensor(x)).train()
    return inference.build_posterior()


def judge(posterior, task, tests):
    """Log density at the truth, ranks of the truth, CPU seconds an episode."""
    begin = time.process_time()
    log_density, ranks = [], []
    for e in tests:
        x = tensor(summaries(task, e.state[None], e.input[None])[0])
        log_density.append(float(posterior.log_prob(tensor(e.truth)[None], x=x)[0]))
        draws = posterior.sample((400,), x=x, show_progress_bars=False).numpy()
        ranks.append(np.mean(draws < e.truth, axis=0))
    return np.array(log_density), np.array(ranks), (time.process_time() - begin) / len(tests)


def combination(task, sigma, simulations, tests):
    """Trains both estimators on the same simulations and judges them; prints a line for each."""
    begin = time.process_time()
    rng = np.random.default_rng(simulations)
    theta = ep.draw_prior(task, simulations, rng)
    x = summaries(task, *ep.simulate(task, sigma, theta, rng))
    simulated = time.process_time() - begin
    for estimator in ("mdn", "nsf"):
        torch.manual_seed(1)
        begin = time.process_time()
        posterior = train(task, estimator, theta, x)
        trained = time.process_time() - begin
        log_density, ranks, each = judge(posterior, task, tests)
        print("\n" + json.dumps({
            "task": task.name, "sigma": sigma, "estimator": estimator, "simulations": simulations, "tests": len(tests),
            "log_density": float(np.mean(log_density)), "median_log_density": float(np.median(log_density)),
            "exact": float(np.mean([e.exact["log_density"] for e in tests])),
            "coverage": np.mean((ranks > 0.05) & (ranks < 0.95), axis=0).tolist(),
            "simulate_s": simulated, "train_s": trained, "episode_s": each}), flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("episodes", nargs="+")
    parser.add_argument("--tests", type=int, default=50)
    parser.add_argument("--quick", action="store_true", help="the pendulum by 1,000 simulations alone")
    args = parser.parse_args()
    torch.set_num_threads(1)
    every = [e for folder in args.episodes for e in ep.read(folder)]
    names = ("pendulum",) if args.quick else ("pendulum", "cart-pole")
    for simulations in (1000,) if args.quick else (1000, 10000):
        for name in names:
            for sigma in (0.03,) if args.quick else SIGMAS:
                tests = [e for e in every if e.task.name == name and e.sigma == sigma][: args.tests]
                if tests:
                    combination(ep.TASKS[name], sigma, simulations, tests)


main()
