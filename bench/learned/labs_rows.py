"""Rows of Table I of Online BayesSim by python -m tiller.labs infer's methods, beside exact posteriors on a grid.

    PYTHONPATH=build/release/python_package python bench/learned/labs_rows.py [--seeds 10] [--task NAME] [--way NAME]

One episode of 400 transitions, every state measured, sigma .03 of each state's RMS change, truth from the prior; 2,000
simulations. The hopper is MuJoCo's (pip install mujoco; else it is left out) and starts anew from a crouched pose every
15 periods; 500 simulations. A line of --csv for each seed, written when it is done, so that a run that was cut goes on;
then the table: loss is the exact posterior's log density at the truth less the method's, both by a Gaussian kernel of
Scott's width. Seeds 1 to 10 were looked at on the way to the settings; 11 to 20 score, settings are from 1001 on."""
import argparse
import csv
import importlib.util
import time
import tomllib
from pathlib import Path

import numpy as np

import tiller
from tiller import _toml
from tiller.labs import Options, Prior, Problem, infer

ROOT = Path(__file__).resolve().parents[2]
TICKS, SIGMA, SIMULATIONS = 400, 0.03, 2000
HOPPER_RMS = [0.029, 0.043, 0.24, 0.29, 0.2, 0.26, 0.95, 1.2, 7.6, 8.5, 5.4, 5.7]
WAYS = {"linear": Options(rounds=4), "cross": Options(rounds=4, summary="cross_correlation"),
        "fourier": Options(rounds=4, density="fourier"), "recurrent": Options(rounds=4, summary="recurrent"),
        "smc": Options(method="smc_abc"), "mcmc": Options(method="mcmc_abc", accept=0.05),
        "regression": Options(method="abc_regression", accept=0.05),
        "abc": Options(method="abc", summary="cross_correlation", accept=0.02)}


class Task:
    simulations, points, rounds = SIMULATIONS, 401, 9  # of each way; of the exact grid in one dimension, and laid anew

    def __init__(self, file, parameters, step_rms, *, period_s=0.02, start=None, limit=np.inf, amplitude=0.0, hold=8,
                 feedback=None, effects=()):
        text = tomllib.loads((ROOT / "robots" / f"{file}.toml").read_text(encoding="utf-8"))
        text["model"] |= {"integrator": "semi_implicit_euler", "substeps": 1, "period_s": period_s}
        text["parameters"] = parameters
        for section in ("effects", "sim", "figure", "posterior"):
            text.pop(section, None)
        text["effects"] = [effect | {name: value} for effect, name, value in effects]
        self.robot = tiller.Robot.from_text(_toml.dumps(text), str(ROOT / "robots" / f"{file}.toml"))
        self.sd = SIGMA * np.array(step_rms)
        self.start = np.zeros(len(step_rms)) if start is None else np.array(start)
        self.limit, self.amplitude, self.hold = limit, amplitude, hold
        self.feedback = np.zeros(len(step_rms)) if feedback is None else np.array(feedback)
        given = list(parameters.values()) + [value for _, _, value in effects]
        priors = list(zip(self.robot.params, given, strict=True))
        self.priors = [Prior(name, "fixed", p) if isinstance(p, float) else
                       Prior(name, "uniform", low=p["uniform"][0], high=p["uniform"][1]) for name, p in priors]

    def steps(self, x, u, params):
        """One period from each state x (T, nx) under u (T, nu), for each parameter vector (n, np): (n, T, nx)."""
        n, t = len(params), len(x)
        found = tiller.rollout(self.robot, np.tile(x, (n, 1)), np.tile(u, (n, 1))[:, None],
                               np.repeat(params, t, axis=0), threads=1)
        return found[:, 1].reshape(n, t, -1)

    def begin(self, tick, x, rng):
        """The state that a period begins in, of the one that the period before ended in."""
        return x

    def command(self, tick, x, rng):
        if tick % self.hold == 0:
            self.push = self.amplitude * rng.uniform(-1, 1)
        return np.clip([self.push - self.feedback @ x], -self.limit, self.limit)

    def problem(self, seed):
        rng = np.random.default_rng([seed, 300])
        truth = np.array([p.centre if p.kind == "fixed" else rng.uniform(p.low, p.high) for p in self.priors])
        x, u, after = [], [], [self.start]
        for tick in range(TICKS):
            x.append(self.begin(tick, after[-1], rng))
            u.append(self.command(tick, x[-1], rng))
            after.append(self.steps(x[-1][None], u[-1][None], truth[None])[0, 0]
                         + self.sd * rng.normal(size=len(self.sd)))
        x, u, after = np.array(x), np.array(u), np.array(after[1:])

        def simulate(params, starts, seeds):
            y = self.steps(x, u, params)
            return y + np.stack([self.sd * np.random.default_rng(int(s)).normal(size=y.shape[1:]) for s in seeds]), [
                ""] * len(y)

        problem = Problem("row", self.priors, [str(i) for i in range(len(self.sd))], np.zeros(len(self.sd)),
                          np.arange(TICKS), x, u, after, simulate, seed)
        return problem, truth

    def exact(self, problem):
        """Points and weights: a grid that is laid anew around its own mean until it stands."""
        low, high = problem.low, problem.high
        for _ in range(self.rounds):
            axes = [np.linspace(a, b, 41 if len(low) == 2 else self.points) for a, b in zip(low, high)]
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


class Slide(Task):
    """A puck of known mass that is hit for two periods each second, to and fro, and slides to rest."""

    def command(self, tick, x, rng):
        if tick % 50 == 0:
            self.push = (1 - 2 * (tick // 50 % 2)) * (25 + 10 * rng.uniform(-1, 1))
        return np.array([self.push if tick % 50 < 2 else 0.0])


class Push(Task):
    """A finger that pushes a box ahead of it, and moves along its face."""

    def command(self, tick, x, rng):
        if tick % self.hold == 0:
            self.push = rng.uniform(-1, 1)
        cosine, sine = np.cos(x[2]), np.sin(x[2])
        aside = 0.06 * self.push - (cosine * (x[4] - x[1]) - sine * (x[3] - x[0]))
        return np.array([0.03 * cosine - aside * sine, 0.03 * sine + aside * cosine])


class Hopper(Task):
    """A torso on a leg of three joints that lands, slips and lifts off under torques drawn anew every .06 s."""
    simulations, points, rounds = 500, 81, 4

    def __init__(self):
        import mujoco
        from mujoco import rollout

        self.mujoco, self.rollout = mujoco, rollout
        self.model = mujoco.MjModel.from_xml_path(str(ROOT / "bench/learned/hopper.xml"))
        self.data, self.foot = mujoco.MjData(self.model), self.model.geom("foot").id
        # RMS changes of a period, of seeds 1001 to 1005
        self.sd = SIGMA * np.array(HOPPER_RMS)
        self.start = np.zeros(12)
        self.priors = [Prior("friction", "uniform", low=0.1, high=0.9)]

    def begin(self, tick, x, rng):
        if tick % 15:
            return x
        crouch, speed = 0.2 + 0.3 * rng.uniform(), 2 * rng.uniform() - 1
        pose = np.zeros(12)
        pose[1] = 0.95 * np.cos(crouch) + 0.16 - 1.2 + 0.01 * rng.uniform()
        pose[3:7] = crouch, -2 * crouch, crouch, speed
        return pose

    def command(self, tick, x, rng):
        if tick % 3 == 0:
            self.push = 60 * rng.uniform(-1, 1, 3)
        return self.push

    def steps(self, x, u, params):
        """Ten steps of 2 ms from each state at rest of the solver, by MuJoCo's own loop."""
        full = np.column_stack([np.zeros(len(x)), x])  # time first: mjSTATE_FULLPHYSICS
        held, out = np.repeat(u[:, None], 10, axis=1), []
        for value in params[:, 0]:
            self.model.geom_friction[self.foot, 0] = value
            out.append(self.rollout.rollout(self.model, self.data, full, held)[0][:, -1, 1:])
        return np.array(out)


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
        "slide": lambda: Slide("emps", {"mass_kg": 1.0}, [0.0065, 0.094], effects=[
            ({"kind": "coulomb_friction", "port": "axis"}, "friction_SI", {"uniform": [1.0, 9.0]})]),
        **({"hopper": Hopper} if importlib.util.find_spec("mujoco") else {}),
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


def run(task, way, problem, exact, at):
    exact_log, exact_mean, exact_sd, _ = exact
    begun = time.process_time()
    result = infer(problem, Options(**(WAYS[way].__dict__ | {"simulations": task.simulations})))
    seconds = time.process_time() - begun
    log, mean, sd, inside = judge(result.v, result.weight, at, 1 / (result.weight**2).sum())
    held = np.nan if result.ranks is None else result.coverage().mean()
    return [exact_log, exact_log - log, np.max(np.abs(mean - exact_mean) / exact_sd),
            np.exp(np.mean(np.log(sd / exact_sd))), np.mean(inside), held, seconds]


def read(path):
    if not path.exists():
        return {}
    with path.open(encoding="utf-8") as file:
        return {(r[0], r[1], int(r[2])): list(map(float, r[3:])) for r in csv.reader(file) if len(r) == 10}


def report(lines, names, ways, seeds):
    print("row        way        seeds   exact | loss: median, mean, error of it, worst | off  sd/exact  inside  "
          "held out  CPU s")
    for name in names:
        for way in ways:
            x = np.array([lines[name, way, seed] for seed in seeds if (name, way, seed) in lines])
            loss = x[:, 1]
            error = loss.std(ddof=1) / len(loss) ** 0.5 if len(loss) > 1 else np.nan
            print(f"{name:10} {way:10} {len(x):5} {x[:, 0].mean():8.2f} | {np.median(loss):6.2f} {loss.mean():6.2f} "
                  f"{error:6.2f} {loss.max():6.2f} |", *(f"{c:7.2f}" for c in x[:, 2:6].mean(axis=0)),
                  f"{np.median(x[:, 6]):7.1f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=11)
    parser.add_argument("--task", choices=tasks(), action="append")
    parser.add_argument("--way", choices=WAYS, action="append")
    parser.add_argument("--quick", action="store_true", help="one seed of push, two ways")
    parser.add_argument("--csv", type=Path, default=ROOT / "build/labs_rows.csv")
    a = parser.parse_args()
    if a.quick:
        a.seeds, a.task, a.way = 1, ["push"], ["linear", "mcmc"]
    a.csv.parent.mkdir(parents=True, exist_ok=True)
    lines, names, ways = read(a.csv), a.task or list(tasks()), a.way or list(WAYS)
    seeds = range(a.first, a.first + a.seeds)
    for name in names:
        task = tasks()[name]()
        for seed in seeds:
            missing = [way for way in ways if (name, way, seed) not in lines]
            if not missing:
                continue
            problem, truth = task.problem(seed)
            at = np.array([t for t, p in zip(truth, problem.priors) if p.kind != "fixed"])
            exact = judge(*task.exact(problem), at, 1024)
            for way in missing:
                lines[name, way, seed] = run(task, way, problem, exact, at)
                with a.csv.open("a", encoding="utf-8") as file:
                    file.write(",".join([name, way, str(seed), *(f"{x:.6g}" for x in lines[name, way, seed])]) + "\n")
                print(f"{name:10} {way:10} {seed:3}", *(f"{x:8.2f}" for x in lines[name, way, seed]), flush=True)
    report(lines, names, ways, seeds)


if __name__ == "__main__":
    main()
