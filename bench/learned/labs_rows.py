"""Rows of Table I of Online BayesSim by python -m tiller.labs infer's methods, beside exact posteriors on a grid.

    PYTHONPATH=build/release/python_package python bench/learned/labs_rows.py [--seeds 10] [--task NAME] [--way NAME]

As ./dev bench learned simulator: one episode of 400 transitions, every state measured, sigma .03 of each state's RMS
change, truth from the prior; 2,000 simulations. The tasks are the same, their random numbers are numpy's. A line for
each seed, then the table: loss is the exact posterior's log density at the truth less the method's, both by a Gaussian
kernel of Scott's width."""
import argparse
import time
import tomllib
from pathlib import Path

import numpy as np

import tiller
from tiller import _toml
from tiller.labs import Options, Prior, Problem, infer

ROOT = Path(__file__).resolve().parents[2]
TICKS, SIGMA, SIMULATIONS = 400, 0.03, 2000
WAYS = {"linear": Options(rounds=4), "cross": Options(rounds=4, summary="cross_correlation"),
        "smc": Options(method="smc_abc"), "regression": Options(method="abc_regression", accept=0.05),
        "abc": Options(method="abc", summary="cross_correlation", accept=0.02)}


class Task:
    def __init__(self, file, parameters, step_rms, *, period_s=0.02, start=None, limit=np.inf, amplitude=0.0, hold=8,
                 feedback=None):
        text = tomllib.loads((ROOT / "robots" / f"{file}.toml").read_text(encoding="utf-8"))
        text["model"] |= {"integrator": "semi_implicit_euler", "substeps": 1, "period_s": period_s}
        text["parameters"] = parameters
        for section in ("effects", "sim", "figure", "posterior"):
            text.pop(section, None)
        self.robot = tiller.Robot.from_text(_toml.dumps(text), str(ROOT / "robots" / f"{file}.toml"))
        self.sd = SIGMA * np.array(step_rms)
        self.start = np.zeros(len(step_rms)) if start is None else np.array(start)
        self.limit, self.amplitude, self.hold = limit, amplitude, hold
        self.feedback = np.zeros(len(step_rms)) if feedback is None else np.array(feedback)
        priors = [(name, parameters[name]) for name in self.robot.params]
        self.priors = [Prior(name, "fixed", p) if isinstance(p, float) else
                       Prior(name, "uniform", low=p["uniform"][0], high=p["uniform"][1]) for name, p in priors]

    def steps(self, x, u, params):
        """One period from each state x (T, nx) under u (T, nu), for each parameter vector (n, np): (n, T, nx)."""
        n, t = len(params), len(x)
        found = tiller.rollout(self.robot, np.tile(x, (n, 1)), np.tile(u, (n, 1))[:, None],
                               np.repeat(params, t, axis=0), threads=1)
        return found[:, 1].reshape(n, t, -1)

    def command(self, tick, x, rng):
        if tick % self.hold == 0:
            self.push = self.amplitude * rng.uniform(-1, 1)
        return np.clip([self.push - self.feedback @ x], -self.limit, self.limit)

    def problem(self, seed):
        rng = np.random.default_rng([seed, 300])
        truth = np.array([p.centre if p.kind == "fixed" else rng.uniform(p.low, p.high) for p in self.priors])
        x, u = [self.start], []
        for tick in range(TICKS):
            u.append(self.command(tick, x[-1], rng))
            x.append(self.steps(x[-1][None], u[-1][None], truth[None])[0, 0] + self.sd * rng.normal(size=len(self.sd)))
        x, u = np.array(x), np.array(u)

        def simulate(params, starts, seeds):
            y = self.steps(x[:-1], u, params)
            return y + np.stack([self.sd * np.random.default_rng(int(s)).normal(size=y.shape[1:]) for s in seeds]), [
                ""] * len(y)

        problem = Problem("row", self.priors, [str(i) for i in range(len(self.sd))], np.zeros(len(self.sd)),
                          np.arange(TICKS), x[:-1], u, x[1:], simulate, seed)
        return problem, truth

    def exact(self, problem):
        """Points and weights: a grid that is laid anew around its own mean until it stands."""
        low, high = problem.low, problem.high
        for _ in range(9):
            axes = [np.linspace(a, b, 41 if len(low) == 2 else 401) for a, b in zip(low, high)]
            v = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
            log = np.concatenate([-0.5 * (((self.steps(problem.start, problem.inputs, problem.to_params(part))
                                           - problem.measured) / self.sd) ** 2).sum(axis=(1, 2))
                                  for part in np.array_split(v, 20)])
            w = np.exp(log - log.max())
            w /= w.sum()
            mean = w @ v
            sd = np.maximum(np.sqrt(w @ (v - mean) ** 2), [a[1] - a[0] for a in axes])
            low, high = np.maximum(problem.low, mean - 5 * sd), np.minimum(problem.high, mean + 5 * sd)
        return v, w


class Push(Task):
    """A finger that pushes a box ahead of it, and moves along its face."""

    def command(self, tick, x, rng):
        if tick % self.hold == 0:
            self.push = rng.uniform(-1, 1)
        cosine, sine = np.cos(x[2]), np.sin(x[2])
        aside = 0.06 * self.push - (cosine * (x[4] - x[1]) - sine * (x[3] - x[0]))
        return np.array([0.03 * cosine - aside * sine, 0.03 * sine + aside * cosine])


def tasks():
    both = {"uniform": [0.1, 1.0]}
    return {
        "cart-pole": lambda: Task("cart_pole", {"cart_mass_kg": 1.0, "pole_mass_kg": both, "half_length_m": both},
                                  [0.022, 0.074, 0.122, 0.367], start=[0, np.pi, 0, 0], amplitude=12, limit=20,
                                  feedback=[4, 0, 2, 0]),
        "pendulum": lambda: Task("pendulum", {"mass_kg": both, "length_m": both, "damping_Nms": 0.02}, [0.071, 0.48],
                                 start=[2.5, 0], amplitude=1, limit=2, feedback=[0, 0.05]),
        "push": lambda: Push("pusher_slider", {"friction": {"uniform": [0.1, 0.9]}, "limit_length_m": 0.038,
                                               "half_length_m": 0.05, "half_width_m": 0.05, "pusher_radius_m": 0.01},
                             [0.0013, 0.00088, 0.017, 0.0016, 0.0016], period_s=0.05, start=[0, 0, 0, -0.06, 0]),
    }


def log_kernel_density(points, weight, at, covariance):
    z = np.linalg.solve(np.linalg.cholesky(covariance), (points - at).T)
    log = -0.5 * (z**2).sum(axis=0) - 0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1]
    return np.log(weight @ np.exp(log - log.max())) + log.max()


def judge(points, weight, truth, particles):
    mean = weight @ points
    off = points - mean
    covariance = off.T @ (weight[:, None] * off)
    h = particles ** (-1 / (len(mean) + 4))
    inside = [0.05 < weight @ (points[:, j] < truth[j]) < 0.95 for j in range(len(mean))]
    return log_kernel_density(points, weight, truth, h**2 * covariance), mean, np.sqrt(np.diag(covariance)), inside


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--task", choices=tasks())
    parser.add_argument("--way", choices=WAYS)
    a = parser.parse_args()
    found = {}
    for name, make in tasks().items():
        if a.task not in (None, name):
            continue
        task = make()
        for seed in range(a.first, a.first + a.seeds):
            problem, truth = task.problem(seed)
            at = np.array([t for t, p in zip(truth, problem.priors) if p.kind != "fixed"])
            exact, exact_mean, exact_sd, _ = judge(*task.exact(problem), at, 1024)
            for way in [a.way] if a.way else WAYS:
                begun = time.process_time()
                options = Options(**(WAYS[way].__dict__ | {"simulations": SIMULATIONS}))
                result = infer(problem, options)
                seconds = time.process_time() - begun
                log, mean, sd, inside = judge(result.v, result.weight, at, 1 / (result.weight**2).sum())
                held = np.nan if result.ranks is None else result.coverage().mean()
                line = [exact, exact - log, np.max(np.abs(mean - exact_mean) / exact_sd),
                        np.exp(np.mean(np.log(sd / exact_sd))), np.mean(inside), held, seconds]
                found.setdefault((name, way), []).append(line)
                print(f"{name:10} {way:10} {seed:3}", *(f"{x:8.2f}" for x in line), flush=True)
    print("row        way        seeds   exact | loss: median, mean, error of it, worst | off  sd/exact  inside  "
          "held out  CPU s")
    for (name, way), lines in found.items():
        x = np.array(lines)
        loss = x[:, 1]
        error = loss.std(ddof=1) / len(loss) ** 0.5 if len(loss) > 1 else np.nan
        print(f"{name:10} {way:10} {len(x):5} {x[:, 0].mean():8.2f} | {np.median(loss):6.2f} {loss.mean():6.2f} "
              f"{error:6.2f} {loss.max():6.2f} |", *(f"{c:7.2f}" for c in x[:, 2:6].mean(axis=0)),
              f"{np.median(x[:, 6]):7.1f}")


if __name__ == "__main__":
    main()
