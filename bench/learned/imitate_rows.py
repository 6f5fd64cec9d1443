# section: imitate; needs the extra labs
"""Costs and policies from demonstrations: python bench/learned/imitate_rows.py [--part NAME] [--seeds N] [--first SEED]

    weights      cart-pole and two-link arm with the shipped files' input rate weights: five demonstrations of 100
                 periods under a cost whose weights are drawn half to twice the file's, followed with white noise of 2 %
                 of the inputs' RMS; the robot file's noise on positions, speeds not measured, logs read by `tiller data
                 imitate`. Learnt: Q, S and R but the first, and Qf. Error: the largest of Q and R (and of S).
    occupancy    a process of two actions that slips, whose least total variation is the slip: by the game and, for a
                 reward that may be any function, by one linear program.
    transport    of 30 points to 30 in the plane: linear program, dual, Sinkhorn.
    adversarial  cart-pole, five demonstrations of 150 periods of an expert that balances; return over the expert's from
                 24 other starts, mean of exp(-1/2 (position / 0.5 m)^2 - 1/2 (angle / 0.25 rad)^2).
    experts      the same over 1, 4, 11 and 25 demonstrations, as the panels of the GAIL paper.

Seeds 1 to 20 (policies: 1 to 10) are scored; settings were chosen on seeds from 1000 on. Every seed is a line of --csv,
written when it is done: a run that was cut goes on.
"""
from __future__ import annotations

import argparse
import csv
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

import tiller
import tiller.jax
from tiller.labs.imitate import network
from tiller.labs.imitate.adversarial import AdversarialOptions, fit_policy
from tiller.labs.imitate.cost import make_cost, rollout_features, whole_cost
from tiller.labs.imitate.expand import expand
from tiller.labs.imitate.game import total_variation
from tiller.labs.imitate.iq import IqOptions, fit_iq
from tiller.labs.imitate.maxent import fit_weights
from tiller.labs.imitate.plan import Planner
from tiller.labs.imitate.problem import Motion, Problem, read_problem
from tiller.labs.imitate.process import FiniteProcess
from tiller.labs.imitate.robot_text import number, with_numbers
from tiller.labs.imitate.transport import dual, primal, sinkhorn

ROBOTS = pathlib.Path(tiller.__file__).parent / "robots"
# Base weights of the states and of the inputs, how far from the target demonstrations start, target, inputs' change.
WORLDS = {"cart_pole": ((2, 5, 0.5, 0.5), (0.02,), (0.6, 0.4, 0.4, 0.8), (0, 0, 0, 0), (0.001,)),
          "two_link_arm": ((8, 5, 0.3, 0.2), (0.01, 0.02), (0.8, 0.8, 1, 1), (0.6, 0.4, 0, 0), (0.001, 0.001))}
HORIZON = 100


# ---- worlds -------------------------------------------------------------------------------------------


class World:
    """A robot file with a cost of its own; inputs bounded by `limit`; changes of inputs cost as shipped."""

    def __init__(self, robot: str, seed: int, limit: float = 1e4) -> None:
        base, inputs, self.spread, target, change = WORLDS[robot]
        self.rng = np.random.default_rng([7, seed])
        text = (ROBOTS / f"{robot}.toml").read_text(encoding="utf-8")
        one = tiller.Robot.from_toml(robot)
        names, controls = one.states, one.inputs
        q = np.array(base) * 2 ** self.rng.uniform(-1, 1, 4)
        r = np.array(inputs) * 2 ** np.append(0, self.rng.uniform(-1, 1, len(inputs) - 1))
        s = np.array(change) * 2 ** self.rng.uniform(-1, 1, len(change))
        rows = lambda kind, keys, values: {f"cost.{kind}.{k}": float(v) for k, v in zip(keys, values, strict=True)}
        self.truth = {**rows("state_weight", names, q), **rows("terminal_weight", names, 5 * q),
                      **rows("input_weight", controls, r), **rows("input_rate_weight", controls, s)}
        self.start = {**rows("state_weight", names, base), **rows("terminal_weight", names, base),
                      **rows("input_weight", controls, inputs), **rows("input_rate_weight", controls, change)}
        self.kept = f"cost.input_weight.{controls[0]}"
        self.text = self._text(text, names, controls, target, limit)
        self.target = np.array(target, float)

    def _text(self, text, names, controls, target, limit):
        import tomlkit
        document = tomlkit.parse(text)
        table = lambda keys, value: {k: value for k in keys}
        document["cost"] = {"target": dict(zip(names, map(float, target), strict=True)),
                            "state_weight": table(names, 1.0), "terminal_weight": table(names, 1.0),
                            "input_weight": table(controls, 1.0), "input_rate_weight": table(controls, 1.0)}
        document["limits"] = {c: {"low": -limit, "high": limit, "safe": 0} for c in controls}
        document["planner"]["horizon"] = HORIZON
        return tomlkit.dumps(document)

    def written(self, weights):
        return with_numbers(self.text, weights)

    def problem(self, folder, logs=()):
        """Of the true cost; read by tiller, with logs or with one that merely lets it be read."""
        path, robot = folder / "problem.json", folder / "robot.toml"
        robot.write_text(self.written(self.truth), encoding="utf-8")
        subprocess.run([sys.executable, "-m", "tiller", "data", "imitate", str(robot), *map(str, logs), "-o",
                        str(path)], check=True)
        return read_problem(path, str(robot))

    def draw_start(self):
        return self.target + np.array(self.spread) * self.rng.uniform(-1, 1, 4)


def best_motion(planner: Planner, start, steps, nu):
    """Grown from short horizons: from no inputs at all a pole falls and is swung up again."""
    guess = np.zeros((0, nu))
    while len(guess) < steps:
        more = min(25, steps - len(guess))
        guess = planner.best(np.ones(1), start, np.vstack([guess, np.zeros((more, nu))]), np.zeros(nu))[0].inputs
    return planner.best(np.ones(1), start, guess, np.zeros(nu))[0]


def bare_problem(world: World, folder) -> Problem:
    """A log of a resting robot that is pushed a little, so that `tiller data` has something to read."""
    robot = tiller.Robot.from_text(world.written(world.truth), "robot.toml")
    u = 0.01 * np.sin(np.arange(30))[:, None] * np.ones(len(robot.inputs))
    x = tiller.rollout(robot, world.target, u)
    write_log(folder / "rest.csv", robot, x, u, np.zeros(4), np.random.default_rng(0))
    return world.problem(folder, [folder / "rest.csv"])


def write_log(path, robot, states, inputs, sd, rng):
    """Positions with the sensors' noise, and inputs."""
    seen = [robot.states.index(m) for m in robot.measurements]
    rows = np.vstack([inputs, inputs[-1:]])
    with path.open("w", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["time_s", *(robot.states[i] for i in seen), *robot.inputs])
        for k, x in enumerate(states):
            out.writerow([robot.period_s * k, *(x[i] + sd[i] * rng.normal() for i in seen), *rows[k]])


# ---- weights ------------------------------------------------------------------------------------------


def follow(world, planner, problem, start, share):
    """A plan, followed with its own feedback under white noise: the noise of a step is answered by planning anew."""
    scene, nu = problem.scene, len(problem.inputs)
    plan = best_motion(planner, start, HORIZON, nu)
    e = expand(scene, planner.cost, plan.states, plan.inputs, np.zeros(nu))
    from tiller.labs.imitate.expansion import side_by_side, windows_of
    from tiller.labs.imitate.sweep import sweep
    gain = np.asarray(sweep(side_by_side([e]), np.ones(1), windows_of([e], 0, 1)).gain[:, 0])
    sd = share * np.sqrt((plan.inputs**2).mean(0))
    states, inputs, before = [plan.states[0]], [], np.zeros(nu)
    for k in range(HORIZON):
        was = plan.inputs[k - 1] if k else np.zeros(nu)
        off = np.concatenate([np.asarray(scene.difference(states[-1], plan.states[k])), before - was])
        before = plan.inputs[k] + gain[k] @ off + sd * world.rng.normal(size=nu)
        inputs.append(before)
        states.append(np.asarray(scene.step(states[-1], before)))
    return Motion(np.array(states), np.array(inputs))


def recover(robot, seed):
    """Largest error of Q and R, of S, of Qf; excess of replanned cost; share of Q, R and S inside their intervals."""
    world = World(robot, seed)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        problem = bare_problem(world, folder)
        one = tiller.Robot.from_toml(robot)
        sensor = {"cart_pole": (0.0005, 0.00205, 0, 0), "two_link_arm": (0.0005, 0.0005, 0, 0)}[robot]
        planner = Planner(problem.scene, whole_cost(problem, problem.text, problem.rate_weight))
        logs = []
        for d in range(5):
            m = follow(world, planner, problem, world.draw_start(), 0.02)
            logs.append(folder / f"demo{d}.csv")
            write_log(logs[-1], one, m.states, m.inputs, np.array(sensor), world.rng)
        problem = world.problem(folder, logs)
        truth_cost = planner.cost
    learnt = {k: v for k, v in world.start.items() if k != world.kept}
    problem.text = world.written(world.start)
    controls = problem.inputs
    problem.rate_weight = np.array([world.start[f"cost.input_rate_weight.{c}"] for c in controls])
    cost = make_cost(problem, learnt)
    fit = fit_weights([expand(problem.scene, cost, d.motion.states, d.motion.inputs) for d in problem.demonstrations],
                      list(learnt), list(learnt.values()))
    error = {w.key: abs(w.value / world.truth[w.key] - 1) for w in fit.weights}
    of = lambda *kinds: max(v for k, v in error.items() if any(kind in k for kind in kinds))
    inside = [w.low <= world.truth[w.key] <= w.high for w in fit.weights if "terminal" not in w.key]
    text = with_numbers(problem.text, {w.key: w.value for w in fit.weights})
    rates = np.array([number(text, f"cost.input_rate_weight.{c}") for c in controls])
    made = Planner(problem.scene, whole_cost(problem, text, rates))
    spent = np.zeros(2)
    for _ in range(3):
        start, nu = world.draw_start(), len(controls)
        for i, p in enumerate((planner, made)):
            m = best_motion(p, start, HORIZON, nu)
            spent[i] += float(rollout_features(truth_cost, m.states[0], m.inputs, np.zeros(nu))[0])
    return [of(".state_weight", ".input_weight") if len(controls) > 1 else of(".state_weight"),
            of("input_rate"), of("terminal"), spent[1] / spent[0] - 1, float(np.mean(inside))]


# ---- occupancy, transport -----------------------------------------------------------------------------


def occupancy(_):
    """Worst errors over 16 processes of two states and two actions: the game, the program."""
    worst = np.zeros(2)
    for slip in (0.01, 0.1, 0.25, 0.4):
        for discount in (0.0, 0.5, 0.9, 0.99):
            go = np.array([[[1 - slip, slip]] * 2, [[slip, 1 - slip]] * 2])
            process = FiniteProcess(np.array([slip, 1 - slip]), go, discount)
            shown = np.array([0.0, 0.0, 0.0, 1.0])
            values = (total_variation(shown, process.best_occupancy, 1e-12).value,
                      process.least_total_variation(shown)[0])
            worst = np.maximum(worst, np.abs(np.array(values) - slip))
    return list(worst)


def transport(seed):
    """Dual less primal; Sinkhorn's plan over the primal at two entropies."""
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(30, 2)), 0.5 + rng.normal(size=(30, 2))
    cost, even = np.linalg.norm(x[:, None] - y, axis=-1), np.full(30, 1 / 30)
    least = primal(cost, even, even).value
    return [dual(cost, even, even).value - least,
            *(sinkhorn(cost, even, even, epsilon).value / least - 1 for epsilon in (0.1, 0.01))]


# ---- adversarial --------------------------------------------------------------------------------------


def worth(states):
    angle = np.mod(states[..., 1] + np.pi, 2 * np.pi) - np.pi
    return np.exp(-0.5 * ((states[..., 0] / 0.5)**2 + (angle / 0.25)**2))


def compete(seed, experts=5):
    """Return over the expert's: of no input, cloning, GAIL, Wasserstein, IQ-Learn."""
    world = World("cart_pole", seed, 20.0)
    with tempfile.TemporaryDirectory() as name:
        problem = bare_problem(world, pathlib.Path(name))
    planner = Planner(problem.scene, whole_cost(problem, problem.text, problem.rate_weight))
    motions = [best_motion(planner, world.draw_start(), 150, 1) for _ in range(25)][:experts]
    starts = np.array([world.draw_start() for _ in range(24)])
    expert = np.mean([worth(best_motion(planner, s, 150, 1).states[:-1]).mean() for s in starts])

    def of(policy):
        return float(worth(np.asarray(network.roll(problem.scene, policy, starts, 149)[0])).mean() / expert)

    still = np.asarray(tiller.rollout(tiller.Robot.from_text(problem.text, "robot.toml"), starts,
                                      np.zeros((24, 149, 1))))
    fits = [fit_policy(problem.scene, motions, AdversarialOptions(wasserstein=w, seed=seed)) for w in (False, True)]
    fits.append(fit_iq(problem.scene, motions, IqOptions(seed=seed)))
    return [float(worth(still).mean() / expert), of(fits[0].cloned), *(of(f.policy) for f in fits)]


# ---- rows ---------------------------------------------------------------------------------------------

POLICIES = ["no input", "cloning", "GAIL", "Wasserstein", "IQ-Learn"]
PARTS = {"weights-cart_pole": (lambda s: recover("cart_pole", s), 20, ["Q, R", "S", "Qf", "cost", "inside"]),
         "weights-two_link_arm": (lambda s: recover("two_link_arm", s), 20, ["Q, R", "S", "Qf", "cost", "inside"]),
         "occupancy": (occupancy, 1, ["game", "program"]),
         "transport": (transport, 10, ["dual - primal", "sinkhorn .1", "sinkhorn .01"]),
         "adversarial": (compete, 10, POLICIES),
         **{f"experts-{n}": (lambda s, n=n: compete(s, n), 5, POLICIES) for n in (1, 4, 11, 25)}}
GOALS = {("occupancy", 0): ("max", 1e-6), ("occupancy", 1): ("max", 1e-6), ("adversarial", 2): ("min", 0.95),
         ("adversarial", 3): ("min", 0.95), **{(f"weights-{r}", i): ("max", g) for r in WORLDS
                                              for i, g in ((0, 0.05), (3, 0.02))}}


def read(path):
    if not path.exists():
        return {}
    with path.open(encoding="utf-8") as file:
        return {(r[0], int(r[1])): list(map(float, r[2:])) for r in csv.reader(file) if len(r) > 2}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=[*PARTS, "weights", "experts"])
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="one seed of each")
    parser.add_argument("--csv", type=pathlib.Path, default=pathlib.Path("build/imitate_rows.csv"))
    a = parser.parse_args()
    a.csv.parent.mkdir(parents=True, exist_ok=True)
    lines = read(a.csv)
    for part, (work, usual, columns) in PARTS.items():
        if a.part and not part.startswith(a.part):
            continue
        rows = []
        for seed in range(a.first, a.first + (a.seeds or (1 if a.quick else usual))):
            if (part, seed) not in lines:
                lines[part, seed] = work(seed)
                with a.csv.open("a", encoding="utf-8") as file:
                    file.write(",".join([part, str(seed), *(f"{v:.6g}" for v in lines[part, seed])]) + "\n")
            rows.append(lines[part, seed])
            print(part, seed, *(f"{v:.4g}" for v in rows[-1]), flush=True)
        table = np.array(rows)
        for i, column in enumerate(columns):
            least = part.startswith(("adversarial", "experts"))
            goal, worst = GOALS.get((part, i)), table[:, i].min() if least else table[:, i].max()
            verdict = "" if not goal else f"  goal {goal[1]:g}: " + (
                "met" if (worst >= goal[1] if goal[0] == "min" else worst <= goal[1]) else "short")
            print(f"  {part:22} {column:16} median {np.median(table[:, i]):10.4g}  worst {worst:10.4g}{verdict}")


if __name__ == "__main__":
    main()
