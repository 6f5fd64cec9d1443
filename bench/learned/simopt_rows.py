# section: simopt; needs the extra labs
"""SimOpt's alternation with the plant: python bench/learned/simopt_rows.py [--robot NAME] [--seeds N] [--first SEED]

`tiller policy --method simopt` with its defaults on a robot file's task, whose plant is drawn from the file's priors by
the seed. Figures by iteration: cost on the models and on the plant, and how far the models' mean is from the plant's
parameters, in deviations of the prior (root mean square). Seeds 1 to 10 are scored; settings were chosen on seeds from
1000 on. Every seed is a line of --csv, written when it is done."""
from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

from tiller import _core
from tiller.labs.policies.physics import Model
from tiller.labs.policies.plant import PlantTrials, measured_deviation
from tiller.labs.policies.sim_to_real import Priors, SimToReal, SimToRealOptions, SimToRealResult
from tiller.labs.policies.starts import goal_of
from tiller.labs.policies.task import make_task

ROOT = Path(__file__).resolve().parents[2]
SECONDS = {"pendulum": 4.0}


def figures(name, seed, iterations):
    """A row (model's cost, plant's, error) an iteration."""
    robot = _core.Robot.from_toml(str(ROOT / "robots" / f"{name}.toml"))
    task, noise = make_task(robot, 0.1, SECONDS[name]), measured_deviation(robot, 0.1)
    run = PlantTrials(robot, 0.1, task.horizon, noise, task.start_mean, task.start_covariance, seed, plant_seed=seed)
    bounds = [(p.get("low", -np.inf), p.get("high", np.inf)) for p in robot.priors.values()]
    priors = Priors(_core.draw_params(robot, seed, 4096), *np.array(bounds, float).reshape(-1, 2).T)
    truth, free = np.array(_core.Plant(robot, seed).true_params), priors.free
    rows = []

    def after(step, index):
        error = ((step.mean - truth) / priors.draws.std(0).clip(1e-12))[free]
        rows.append([step.model_cost, step.plant_cost, float(np.sqrt((error**2).mean()))])
        print(f"{name}, seed {seed}, iteration {index + 1}: cost {rows[-1][0]:.4g} on the models, {rows[-1][1]:.4g} on "
              f"the plant, error {rows[-1][2]:.3g}", file=sys.stderr, flush=True)

    o = SimToRealOptions(iterations, seed=seed)
    SimToReal(task, goal_of(robot, task), Model(robot, 0.1).step, priors, run, noise, o).run(after, SimToRealResult())
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=SECONDS, default="pendulum")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument("--csv", type=Path, default=ROOT / "build/simopt_rows.csv")
    parser.add_argument("--quick", action="store_true", help="one seed, two iterations")
    a = parser.parse_args()
    a.csv.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if a.csv.exists():
        with open(a.csv, encoding="utf-8") as file:
            done = {tuple(r[:3]): np.array(r[3:], float).reshape(-1, 3) for r in csv.reader(file)}
    iterations, all_ = 2 if a.quick else a.iterations, []
    for seed in range(a.first, a.first + (1 if a.quick else a.seeds)):
        key = (a.robot, str(seed), str(iterations))
        if key not in done:
            done[key] = np.array(figures(a.robot, seed, iterations))
            with open(a.csv, "a", encoding="utf-8") as file:
                file.write(",".join([*key, *(f"{v:.9g}" for v in done[key].ravel())]) + "\n")
        all_.append(done[key])
        print(f"  seed {seed}: " + "; ".join(f"{m:.4g} {p:.4g} {e:.2g}" for m, p, e in done[key]), flush=True)
    print("  medians by iteration (models, plant, error): " + "; ".join(
        f"{m:.4g} {p:.4g} {e:.2g}" for m, p, e in np.median(all_, 0)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
