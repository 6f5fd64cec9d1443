# section: local; needs the extra labs
"""Linear models of few samples with a prior and without, a controller that fits one anew in each period, and guided
policies: python bench/learned/local_rows.py [--part samples|online|network|guided] [--seeds N] [--first SEED]

    samples   repeats of one motion on the ODE plant of a robot file, by commands that wander the same way in each
              repeat plus white ones of a tenth of the range, from the file's start. The plant's parameters are drawn
              from the file's priors by the seed. For each of 20 periods a model is fitted to N repeats, and its
              one-step error is measured on 40 other repeats: RMS over periods, repeats and states, each state's error
              in deviations of the state's change.
                  physics   the model's derivative, at parameters that fit the same repeats, worth 20 samples
                  mixture   a prior worth 5 samples from a mixture of 6 normals fitted to 10 runs of other commands
                  none      least squares
              Figure: how many samples least squares needs for the error that the prior gives with 4 (N from a grid up
              to 80, between its points by the logarithm), over 4.
    online    a plant that breaks at half of the run, held at its target by a short LQR: on the model alone, and on the
              model that is fitted in each period. Figure: cost after the break, the model's over the fitted one's.
    network   the robot file's task from its start by iLQR over a receding horizon of 4 s, on a plant drawn by the seed
              whose motors have lost a fifth of their gain: on the model, on the model that is adapted, on a network
              that 30 runs of other plants have taught (motors whole), and on the network that is adapted. Figure: cost.
    guided    tiller policy --method guided with its defaults but for seconds: cost of the first laws on the plant, of
              the best network, and what a network that holds the middle of the limits costs.

Seeds 1 to 10 are scored (guided: 1 to 3); settings were chosen on seeds from 1000 on. Every seed is a line of --csv,
written when it is done: a run that was cut goes on."""
from __future__ import annotations

import argparse
import csv
import statistics
import sys
from pathlib import Path

import numpy as np

from tiller import _core
from tiller.labs.policies.adaptive import AdaptiveIlqr, AdaptiveLqr, AdaptiveOptions
from tiller.labs.policies.guided import GuidedOptions, GuidedResult, guided_search
from tiller.labs.policies.local import Data, fit_mixture, fit_step, prior_of_mixture, prior_of_model
from tiller.labs.policies.neural_physics import earlier_runs, network_physics
from tiller.labs.policies.physics import Model
from tiller.labs.policies.plant import PlantTrials, measured_deviation
from tiller.labs.policies.starts import conditions_of, family_of, goal_of
from tiller.labs.policies.task import make_task

ROOT = Path(__file__).resolve().parents[2]
PERIODS, TESTS, EARLIER, FEW, PERIOD_S = 20, 40, 10, 4, 0.05
GRID = (4, 6, 8, 12, 16, 20, 24, 32, 40, 60, 80)


def robot_of(name):
    return _core.Robot.from_toml(str(ROOT / "robots" / f"{name}.toml"))


# ---- samples ------------------------------------------------------------------------------------------


def wander(robot, path, repeat):
    """Three sines, the same for all repeats of a motion, and white noise."""
    low, high = robot.input_low, robot.input_high
    phase = 6.28 * np.random.default_rng([path, 200]).random((len(low), 3))
    own = np.random.default_rng([repeat, 201])

    def controller(x, k):
        shape = np.sin(0.25 * np.arange(1, 4) * k + phase).sum(1) / 6
        share = 0.5 * shape + 0.1 * own.standard_normal(len(low))
        return np.clip(0.5 * (low + high) + (high - low) * share, low, high)
    return controller


class Samples:
    def __init__(self, name, seed):
        self.robot, self.seed = robot_of(name), seed
        self.nx, self.model = len(self.robot.states), Model(self.robot, PERIOD_S)
        self.sd = measured_deviation(self.robot, PERIOD_S)
        run = PlantTrials(self.robot, PERIOD_S, PERIODS, self.sd, self.robot.initial_state, 1e-4 * np.eye(self.nx),
                          seed, plant_seed=seed)
        one = lambda which, path, s: run(wander(self.robot, path, seed * 100000 + which * 10000 + s), which * 1000 + s)
        self.motion = [one(1, seed * 10, s) for s in range(GRID[-1] + TESTS)]
        earlier = [one(2, seed * 100000 + 20000 + s, s) for s in range(EARLIER)]
        self.mixture = fit_mixture(np.concatenate([self.rows(earlier, k) for k in range(PERIODS)]), 6, 30, seed)

    @staticmethod
    def rows(trials, k):
        return np.array([np.concatenate([t.measured[k], t.command[k], t.measured[k + 1]]) for t in trials])

    def priors(self, kind, count):
        data = [self.rows(self.motion[:count], k) for k in range(PERIODS)]
        if kind == "none":
            return [None] * PERIODS
        if kind == "mixture":
            return [prior_of_mixture(self.mixture, d, 5.0) for d in data]
        variance, nx = self.sd**2, self.nx
        moments, made = list(map(Data.of, data)), []
        params = self.model.fit(np.concatenate(data), variance)
        next_states, slopes, _ = map(np.asarray, self.model.expand(np.array([d.mean[:-nx] for d in moments]), params))
        for d, after, slope in zip(moments, next_states, slopes, strict=True):
            at = d.mean[:-nx]
            made.append(prior_of_model(at, after, slope, np.diag(np.diag(d.covariance)[:-nx] + 1e-8), variance,
                                       np.full(nx, 1e-8), 20.0))  # offsets show in few samples, slopes in many
        return made

    def error(self, count, kind):
        off, change = np.zeros(self.nx), np.zeros(self.nx)
        for k, prior in enumerate(self.priors(kind, count)):
            tests = self.rows(self.motion[GRID[-1]:], k)
            step = fit_step(Data.of(self.rows(self.motion[:count], k)), prior, self.nx, 1e-10)
            z, after = tests[:, :-self.nx], tests[:, -self.nx:]
            off += ((z @ step.slope.T + step.offset - after)**2).sum(0)
            change += ((after - z[:, :self.nx])**2).sum(0)
        return float(np.sqrt((off / change).mean()))


def needed(by_grid, error):
    """Samples that least squares needs for an error; the grid's end where it never gets there."""
    for i, now in enumerate(by_grid):
        if now <= error:
            if i == 0:
                return GRID[0]
            share = np.log(by_grid[i - 1] / error) / np.log(by_grid[i - 1] / now)
            return GRID[i - 1] * (GRID[i] / GRID[i - 1])**share
    return GRID[-1]


def sample_figures(name, seed):
    samples = Samples(name, seed)
    none = [samples.error(count, "none") for count in GRID]
    physics, mixture = samples.error(FEW, "physics"), samples.error(FEW, "mixture")
    return [needed(none, physics) / FEW, needed(none, mixture) / FEW, physics, mixture, none[0], none[-1]]


# ---- online -------------------------------------------------------------------------------------------

#         robot            gain of the motors after the break, share of the limit that is added, target, weights
BREAKS = {"two_link_arm": (0.5, -0.15, (0.6, 0.7, 0, 0), (100, 100, 1, 1)),
          "cart_pole": (0.5, 0.08, (0, 0, 0, 0), (10, 100, 1, 1)),
          "pendulum": (0.6, 0.1, (np.pi, 0), (100, 1))}
FAST_S, TICKS = 0.02, 400


def break_cost(name, seed, adapt):
    """Mean cost of the states after the break; a period's is cut at 100 times that of a tenth of a unit, so that one
    fall does not count for all seeds."""
    robot, (gain, share, target, weight) = robot_of(name), BREAKS[name]
    target, weight, low, high = np.array(target, float), np.array(weight, float), robot.input_low, robot.input_high
    run = PlantTrials(robot, FAST_S, TICKS, measured_deviation(robot, 0.1), target, 1e-4 * np.eye(len(target)), seed,
                      plant_seed=seed)
    physics = Model(robot, FAST_S).physics()
    controller = AdaptiveLqr(physics, AdaptiveOptions(target, low, high, weight, 0.01 / high**2,
                                                      measured_deviation(robot, 0.1), adapt=adapt))

    def loop(x, k):
        u = controller(x, k)
        return u if k < TICKS // 2 else np.clip(gain * u + share * high, low, high)

    off = run(loop, 0).truth[TICKS // 2:] - target
    return float(np.minimum(weight.max(), (off**2) @ weight).mean())


def break_figures(name, seed):
    frozen, fitted = break_cost(name, seed, False), break_cost(name, seed, True)
    return [frozen / fitted, frozen, fitted]


# ---- network ------------------------------------------------------------------------------------------

GAIN, HORIZON = 0.8, 40


def network_figures(name, seed):
    robot = robot_of(name)
    task, noise = make_task(robot, 0.1, 4.0), measured_deviation(robot, 0.1)
    goal = goal_of(robot, task)
    run = PlantTrials(robot, 0.1, task.horizon, noise, task.start_mean, task.start_covariance, seed, plant_seed=seed)
    costs, network = [], network_physics(task, earlier_runs(robot, task, noise, 30, seed), seed)
    for physics in (Model(robot, 0.1).physics(), network):
        for adapt in (False, True):
            o = AdaptiveOptions(goal.target, task.low, task.high, goal.state, goal.control, noise, horizon=HORIZON,
                                adapt=adapt)
            controller = AdaptiveIlqr(physics, o)
            trial = run(lambda x, k, c=controller: GAIN * c(x, k), 0)
            costs.append(float(goal.of(trial.truth, trial.command)))
    return costs


# ---- guided -------------------------------------------------------------------------------------------

SECONDS = {"pendulum": 4.0, "cart_pole": 4.0, "planar_quadrotor": 3.0}


def guided_figures(name, seed):
    robot = robot_of(name)
    task = make_task(robot, 0.1, SECONDS[name])
    goal, conditions, result = goal_of(robot, task), conditions_of(robot, task, 4, seed), GuidedResult()

    def after(step, index):
        print(f"{name}, seed {seed}, iteration {index + 1}: {step.local_cost:.4g} by the local laws, "
              f"{step.policy_cost:.4g} by the network; divergence {step.divergence:.2g}, apart {step.apart}",
              file=sys.stderr, flush=True)

    guided_search(task, goal, conditions, measured_deviation(robot, 0.1), GuidedOptions(seed=seed), after, result,
                  family_of(robot, task))
    still = [c.run(lambda x, k: 0.5 * (task.low + task.high), 0) for c in conditions]
    return [float(np.mean([goal.of(t.truth, t.command) for t in still])), result.steps[0].local_cost,
            min(s.local_cost for s in result.steps), result.steps[result.best].policy_cost, result.best + 1]


# ---- the program --------------------------------------------------------------------------------------


PARTS = {"samples": (sample_figures, ("pendulum", "cart_pole", "two_link_arm"), 10,
                     "samples saved (physics, mixture), errors with 4 (physics, mixture, none), none with 80"),
         "online": (break_figures, tuple(BREAKS), 10, "cost after the break: model alone over fitted, alone, fitted"),
         "network": (network_figures, ("pendulum", "cart_pole"), 10,
                     "cost: model alone, adapted; network alone, adapted"),
         "guided": (guided_figures, tuple(SECONDS), 3, "cost: still, first laws, best laws, best network; its round")}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=PARTS)
    parser.add_argument("--robot")
    parser.add_argument("--seeds", type=int, default=0)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--csv", type=Path, default=ROOT / "build/local_rows.csv")
    parser.add_argument("--quick", action="store_true", help="two seeds; of guided one")
    a = parser.parse_args()
    a.csv.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if a.csv.exists():
        with open(a.csv, encoding="utf-8") as file:
            done = {tuple(r[:3]): list(map(float, r[3:])) for r in csv.reader(file)}
    for part in [a.part] if a.part else PARTS:
        figures, robots, count, what = PARTS[part]
        for name in [a.robot] if a.robot else robots:
            print(f"== {part}, {name}: {what}")
            lines = []
            for seed in range(a.first, a.first + (a.seeds or (min(2, count - 2) if a.quick else count))):
                key = (part, name, str(seed))
                if key not in done:
                    done[key] = figures(name, seed)
                    with open(a.csv, "a", encoding="utf-8") as file:
                        file.write(",".join([*key, *(f"{v:.9g}" for v in done[key])]) + "\n")
                lines.append(done[key])
                print(f"  seed {seed}: " + " ".join(f"{v:.3g}" for v in done[key]), flush=True)
            medians = [statistics.median(column) for column in zip(*lines, strict=True)]
            print("  median: " + " ".join(f"{v:.3g}" for v in medians), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
