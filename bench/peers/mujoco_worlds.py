"""Machines with a hidden effect, simulated by MuJoCo: the second generator beside the ODE worlds.

    mujoco_worlds.py < cases.jsonl

A case is one line: {"id", "folder", "plant", "kinds": [..], "noise_sd", "excitation", "seed"}. For each, `folder` gets
robot.toml as an honest engineer would write it, log_1.csv .. log_6.csv and sealed/case.json; a line
{"id", "r", "error"} answers. Plants, effects and excitations share no code with the ODE worlds nor with the runtime:
friction is MuJoCo's own constraint, play a second body between two stops, lag MuJoCo's activation. What MuJoCo lacks
acts through qfrc_applied once in every physics step.

r: 1 s rollouts without the effect from the true states under the same commands, RMS deviation in sensor deviations.
The strength is sought for an r that is drawn evenly in its logarithm.
"""

import json
import math
import pathlib
import sys

import mujoco
import numpy as np
from mujoco_machine import PERIOD, PLANTS, Machine, draw_parameters
from mujoco_motion import Excitation, make_effect, ports_of, record, rollout_r, shrink, typical

LOGS = 6
LEAST_R, MOST_R = 0.5, 50.0


def make_case(case):
    dice = np.random.default_rng([case["seed"], *case["id"].encode()])
    plant, noise_sd = case["plant"], case["noise_sd"]
    nominal, truth, priors = draw_parameters(plant, dice)
    bare = Machine(plant, truth, [])
    excitations = [Excitation(plant, nominal, case["excitation"], dice) for _ in range(LOGS)]
    for excitation in excitations:
        shrink(bare, excitation, noise_sd)
    sizes = typical(bare, excitations[0], noise_sd)
    chosen, wanted = [], []
    for kind in case["kinds"]:
        places = ports_of(kind, plant)
        chosen.append((kind, *places[int(dice.integers(len(places)))], dice.random(4)))
        wanted.append(math.exp(dice.uniform(math.log(LEAST_R), math.log(MOST_R))))
    effects = [(k, int(port), seek(bare, plant, truth, nominal, k, port, shape, sizes, excitations[0], noise_sd, r))
               for (k, port, _, shape), r in zip(chosen, wanted)]
    machine = Machine(plant, truth, effects)
    folder = pathlib.Path(case["folder"])
    (folder / "sealed").mkdir(parents=True, exist_ok=True)
    for i, excitation in enumerate(excitations):
        rows, states = record_tame(machine, excitation, noise_sd, sizes, dice)
        if i == 0:
            r = rollout_r(without(bare, plant, truth, effects), machine, rows, states, noise_sd) if effects else 0.0
        write_log(folder / f"log_{i + 1}.csv", PLANTS[plant], rows)
    (folder / "robot.toml").write_text(robot_text(plant, priors, noise_sd, sizes), encoding="utf-8")
    answer = {"plant": plant, "r": r, "noise_sd": noise_sd, "parameters": truth,
              "effects": [{"kind": k, "port": name, "parameters": e}
                          for (k, _, name, _), (_, _, e) in zip(chosen, effects)]}
    (folder / "sealed/case.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")
    return r


def record_tame(machine, excitation, noise_sd, sizes, dice):
    """A run, made smaller until the machine with its effects does not run away."""
    for _ in range(6):
        rows, states = record(machine, excitation, noise_sd, dice)
        if rows is not None and tame(rows, sizes):
            return rows, states
        excitation.size *= 0.75
    raise ValueError("the machine runs away")


def tame(rows, sizes):
    """Whether the motion is about as wide as without the effect: what swings up by itself is another experiment."""
    shown = np.array([row[1] for row in rows])
    return bool(np.all(shown.std(axis=0) < 3 * sizes["position"] + 0.1))


def without(bare, plant, truth, effects):
    """The machine without the effects; of play or a spring the rotor stays, whose mass a fit may add to the plant's."""
    rotors = [("joint_inertia", PLANTS[plant]["motors"][port], {"inertia_SI": e["rotor_inertia_SI"]})
              for kind, port, e in effects if kind in ("backlash", "elastic_joint")]
    return Machine(plant, truth, rotors) if rotors else bare


def seek(bare, plant, truth, nominal, kind, port, shape, sizes, excitation, noise_sd, wanted):
    """Parameters whose r is near `wanted`: halving in the strength's logarithm; the strongest where that is too
    weak."""
    def r_of(s):
        effect = {n: float(v) for n, v in make_effect(kind, port, s, sizes, plant, nominal, shape).items()}
        machine = Machine(plant, truth, [(kind, port, effect)])
        rows, states = record(machine, excitation, noise_sd, np.random.default_rng(1))
        if rows is None or not tame(rows, sizes):
            return effect, 1e9
        return effect, rollout_r(without(bare, plant, truth, machine.effects), machine, rows, states, noise_sd)
    low, high = math.log(1e-3), 0.0
    effect, r = r_of(1.0)
    if r <= wanted:
        return effect
    for _ in range(10):
        middle = 0.5 * (low + high)
        effect, r = r_of(math.exp(middle))
        if abs(math.log(max(r, 1e-9) / wanted)) < 0.1:
            break
        low, high = (middle, high) if r < wanted else (low, middle)
    return effect


# ---- files -----------------------------------------------------------------------------------------


def write_log(path, facts, rows):
    lines = [",".join(["time_s", *facts["states"], *facts["inputs"]])]
    lines += [",".join(f"{x:.9g}" for x in (t, *shown, *command)) for t, shown, command in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def robot_text(plant, priors, noise_sd, sizes):
    facts = PLANTS[plant]
    table = lambda names, values: "{ " + ", ".join(f"{n} = {v:.6g}" for n, v in zip(names, values)) + " }"
    states, rates, inputs = facts["states"], facts["rates"], facts["inputs"]
    lines = ["[robot]", f'name = "{plant}"', "", "[model]", f'name = "{plant}"', f"period_s = {PERIOD}",
             'integrator = "rk4"', "", "[parameters]", *(f"{n} = {p}" for n, p in priors.items())]
    if plant == "pendulum":
        lines.append("damping_Nms = 0")
    lines += ["", "[measurement]", *(f"{n} = {{ sd = {noise_sd:g} }}" for n in states), "", "[noise]",
              "process_sd = " + table(rates, [1e-4] * len(rates)), "", "[start]",
              "state = " + table([*states, *rates], [*facts["rest"], *[0.0] * len(rates)]),
              "sd = " + table([*states, *rates], [0.3] * len(states) + [0.05] * len(rates)), "", "[planner]",
              'kind = "mppi"', "horizon = 60", "knots = 8", "rollouts = 64", "particles = 1", "iterations = 1",
              "noise_sd = " + table(inputs, 0.7 * sizes["input"]), "", "[cost]",
              "target = " + table([*states, *rates], [*facts["rest"], *[0.0] * len(rates)]),
              "state_weight = " + table([*states, *rates], [1.0] * len(states) + [0.05] * len(rates)),
              "terminal_weight = " + table([*states, *rates], [10.0] * len(states) + [0.5] * len(rates)),
              "input_weight = " + table(inputs, [0.01] * len(inputs)), "", "[limits]",
              *(f"{n} = {{ low = {-4 * p:.6g}, high = {4 * p:.6g} }}" for n, p in zip(inputs, sizes["peak"]))]
    return "\n".join(lines) + "\n"


def main():
    mujoco.set_mju_user_warning(lambda text: None)  # a run that goes wrong is told in its answer
    for line in sys.stdin:
        case = json.loads(line)
        try:
            answer = {"id": case["id"], "r": make_case(case), "error": ""}
        except (ValueError, mujoco.FatalError, ArithmeticError) as error:
            answer = {"id": case["id"], "r": None, "error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
