# section: policies; needs the extra labs
"""Policy search with moment matching on the two first tasks of the PILCO papers (Deisenroth and Rasmussen 2011;
Deisenroth, Fox, Rasmussen 2015), on ODE plants: python bench/learned/policies_rows.py [--task NAME] [--seeds N]

    pendulum    a rod of 1 kg and 1 m with friction 0.01 Nms and 2.5 Nm at its hinge, which cannot lift it; 0.1 s
                periods, 4 s a trial. The ODE plant is a ball: 3/4 of the mass at 2/3 of the length has the rod's
                inertia and weight about the hinge.
    cart_pole   cart and rod of 0.5 kg each, rod 0.6 m, friction 0.1 Ns/m, 10 N; 0.1 s periods, 2.5 s a trial

    matched     the pendulum again, without its cost: six demonstrations by iLQR's motion with its gains on the plant
                and random commands of a twentieth of the range, whose states are to be repeated (--match)

Every state is measured with white noise (0.01 m, m/s, rad, rad/s), the start is drawn anew for each trial, and the
costs are the papers': saturating in the distance of the rod's tip from where it shall be, of width 0.5 m and 0.25 m.
Data begin with one trial of random commands, which counts. Solved at trial n: in trial n the tip stays within 8 cm of
the target for the last 0.5 s; a task whose states are shown, where the trial is at most twice as far from the
demonstrations' mean as they are themselves. The seed decides random commands, starts, noise and the policy's first
parameters; seeds 1 to 10 are scored, settings were chosen on seeds from 1000 on. Every seed is a line of --csv, written
when it is done."""
from __future__ import annotations

import argparse
import contextlib
import csv
import dataclasses
import statistics
import sys
import time
from pathlib import Path

import numpy as np

from tiller import _core
from tiller.labs.policies.guide import Goal, Guide
from tiller.labs.policies.physics import Model
from tiller.labs.policies.pilco import pilco
from tiller.labs.policies.plant import PlantTrials
from tiller.labs.policies.search import SearchOptions, SearchResult, on_plant
from tiller.labs.policies.shown import shown_by
from tiller.labs.policies.task import make_task

ROOT = Path(__file__).resolve().parents[2]
PENDULUM = """[robot]
name = "rod"
[model]
name = "pendulum"
period_s = 0.1
substeps = 8
[parameters]
mass_kg = 0.75
length_m = 0.6666666666666667
damping_Nms = 0.01
[measurement]
angle_rad = { sd = 0.01 }
[noise]
process_sd = { rate_rad_s = 0.02 }
[start]
sd = { angle_rad = 0.1, rate_rad_s = 0.1 }
[planner]
kind = "cem"
horizon = 20
[cost]
target = { angle_rad = 3.141592653589793 }
state_weight = { angle_rad = 1.0 }
[limits]
torque_Nm = { low = -2.5, high = 2.5, safe = 0 }
[sim]
plant = "pendulum"
parameters = { mass_kg = 0.75, length_m = 0.6666666666666667, damping_Nms = 0.01 }
sensors.angle_rad = { sd = 0.01 }
"""
CART_POLE = """[robot]
name = "cart-pole"
[model]
name = "cart_pole"
period_s = 0.1
substeps = 8
[parameters]
cart_mass_kg = 0.5
pole_mass_kg = 0.5
half_length_m = 0.3
[measurement]
position_m = { sd = 0.01 }
angle_rad = { sd = 0.01 }
[noise]
process_sd = { velocity_m_s = 0.02, rate_rad_s = 0.02 }
[start]
state = { angle_rad = 3.141592653589793 }
sd = { position_m = 0.1, angle_rad = 0.1, velocity_m_s = 0.1, rate_rad_s = 0.1 }
[planner]
kind = "cem"
horizon = 20
[cost]
target = { position_m = 0, angle_rad = 0 }
state_weight = { position_m = 1.0, angle_rad = 1.0 }
[limits]
force_N = { low = -10, high = 10, safe = 0 }
[sim]
plant = "cart_pole"
parameters = { cart_mass_kg = 0.5, pole_mass_kg = 0.5, half_length_m = 0.3, cart_friction_Ns_m = 0.1 }
sensors.position_m = { sd = 0.01 }
sensors.angle_rad = { sd = 0.01 }
"""


@dataclasses.dataclass
class Paper:
    text: str
    seconds: float
    length_m: float
    width_m: float
    trials: int  # with the first random one
    bumps: int
    cart: bool

    def distance(self, x):
        """(...) of the tip from upright over the origin, at true states (..., nx)."""
        angle = x[..., 1] if self.cart else x[..., 0] - np.pi
        across = (x[..., 0] if self.cart else 0) + self.length_m * np.sin(angle)
        return np.hypot(across, self.length_m * (1 - np.cos(angle)))


PAPERS = {"pendulum": Paper(PENDULUM, 4.0, 1.0, 0.5, 8, 20, False),
          "cart_pole": Paper(CART_POLE, 2.5, 0.6, 0.25, 10, 30, True),
          "matched": Paper(PENDULUM, 4.0, 1.0, 0.5, 8, 20, False)}
WITHIN_M = 0.08


class Solved(Exception):
    """Ends a search: what is asked for is the trial."""


def tip_cost(paper, task):
    """The papers': the tip's squared distance is quadratic in position, sine and cosine."""
    rows = np.zeros((2, len(task.target)))
    rows[0, 0] = float(paper.cart)
    rows[0, task.nx] = rows[1, task.nx + 1] = paper.length_m
    return dataclasses.replace(task, weight=rows.T @ rows / paper.width_m**2)


def demonstrations(robot, task, run):
    """(6, horizon + 1, nx) true states."""
    goal = Goal(robot.target, np.array([4.0, 0.05]), np.array([50.0, 2.0]), np.array([0.01]), 0.8 * task.low,
                0.8 * task.high)
    guide, model = Guide(Model(robot, task.period_s).physics), robot.prior_centre
    motion = guide.best(model, goal, task.start_mean[None], task.horizon, 1)
    gain = guide.gains(model, goal._replace(low=task.low - 1e9, high=task.high + 1e9), motion)[0]
    rng = np.random.default_rng(7)

    def controller(x, k):
        noise = 0.05 * (task.high - task.low) * rng.standard_normal(task.nu)
        return np.clip(motion.u[0, k] + gain[k] @ (x - motion.x[0, k]) + noise, task.low, task.high)
    return np.array([run(controller, 500 + i).truth for i in range(6)])


def search(name, seed, trials, restarts):
    """solved at, last cost, CPU seconds, of each trial the largest distance of the last 0.5 s, or from the shown."""
    paper, path = PAPERS[name], ROOT / "build" / f"policies_{name}.toml"
    path.write_text(paper.text, encoding="utf-8")
    robot = _core.Robot.from_toml(str(path))
    task = tip_cost(paper, make_task(robot, 0.1, paper.seconds))
    run = PlantTrials(robot, 0.1, task.horizon, np.full(task.nx, 0.01), task.start_mean, task.start_covariance, seed)
    far, begun, within = [], time.process_time(), WITHIN_M
    if name == "matched":
        task, within = dataclasses.replace(task, shown=shown_by(demonstrations(robot, task, run))), 2.0

    def after(step, index):
        far.append(float(paper.distance(step.trial.truth[-6:]).max()) if task.shown is None else
                   step.cost / (0.5 * task.nx * task.horizon))
        print(f"{name}, seed {seed}, trial {index + 1}: predicted {step.predicted:.2f}, cost {step.cost:.2f}, "
              f"{far[-1]:.3f} of {within}, {step.seconds:.1f} s", file=sys.stderr, flush=True)
        if far[-1] < within:
            raise Solved

    result = SearchResult()
    o = SearchOptions(trials - 1, bumps=paper.bumps, restarts=restarts, seed=seed)
    with contextlib.suppress(Solved):
        pilco(task, on_plant(task, run, seed), o, after, result)
    solved = len(far) if far[-1] < within else 0
    return [solved, result.steps[-1].cost, time.process_time() - begun, " ".join(f"{m:.3g}" for m in far)]


def report(name, rows):
    print(f"== {name}, {len(rows)} seeds")
    for row in rows:
        print(f"  seed {row[0]}: solved at trial {row[1]}, last cost {row[2]:.2f}, {row[3]:.0f} CPU s; by trial "
              f"{row[4]}")
    paper, at = PAPERS[name], [row[1] or 99 for row in rows]
    share = sum(n <= paper.trials for n in at) / len(at)
    met = "met" if share == 1 else "short"
    print(f"  solved within {paper.trials} trials, share of seeds {share:8.2f}   goal 1: {met}")
    print(f"  trial at which it is solved, median  {statistics.median(at):8.1f}")
    print(f"  CPU time a seed                      {statistics.mean(row[3] for row in rows):8.0f} s", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=PAPERS)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--trials", type=int, default=0, help="0: as many as the goal allows")
    parser.add_argument("--restarts", type=int, default=1)
    parser.add_argument("--csv", type=Path, default=ROOT / "build/policies_rows.csv")
    parser.add_argument("--quick", action="store_true", help="one seed of the pendulum")
    a = parser.parse_args()
    a.csv.parent.mkdir(parents=True, exist_ok=True)
    for name in ["pendulum"] if a.quick else [a.task] if a.task else PAPERS:
        rows = {}
        if a.csv.exists():
            with open(a.csv, encoding="utf-8") as file:
                rows = {int(r[1]): [int(r[1]), int(r[2]), float(r[3]), float(r[4]), r[5]] for r in csv.reader(file)
                        if r[0] == name and len(r) == 6}
        wanted = range(a.first, a.first + (1 if a.quick else a.seeds))
        for seed in wanted:
            if seed not in rows:
                found = search(name, seed, a.trials or PAPERS[name].trials, a.restarts)
                rows[seed] = [seed, *found]
                with open(a.csv, "a", encoding="utf-8") as file:
                    file.write(",".join(map(str, [name, *rows[seed]])) + "\n")
        report(name, [rows[seed] for seed in wanted])
    return 0


if __name__ == "__main__":
    sys.exit(main())
