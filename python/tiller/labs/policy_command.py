"""tiller policy: a feedback policy in few trials on the simulated plant."""
from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from .._errors import Error, RobotFileError
from .arguments import number_between
from .output import can_write

if TYPE_CHECKING:
    from .. import _core

METHODS = {"pilco": "gradients of the expected cost on a Gaussian process", "reps": "samples on the same process",
           "guided": "local laws that teach a network, priors from the file's model",
           "simopt": "a network trained on models that are drawn, and the draws moved to what the plant does under it",
           "adaptive_lqr": "no policy, but a comparison: an LQR on the file's model beside one whose model is fitted "
           "anew in each period",
           "adaptive_ilqr": "the same with iLQR over a horizon, which goes far and keeps limits"}
ADAPTIVE = ("adaptive_lqr", "adaptive_ilqr")
BY_COST = ("guided", "simopt", *ADAPTIVE)  # of states and inputs; the others saturate it
EPILOG = """
Trials run the plant of [sim] from [start]; every state is measured with the sensors' noise. The task is [cost]'s
target and state weights within [limits] (docs/guide/policy.md).

With --on-robot trials are the robot's own: `tiller run` steers it by each policy over the file's transport, under the
gate. It begins in STANDBY: bring the robot to its start, then press a. Ctrl-C stops it and ends the search.

Examples:
  tiller policy robots/pendulum.toml --trials 6 -o out/policy.json --page out/policy.html
      a swing-up from nothing but trials
  tiller policy my_robot.toml --on-robot --period 0.05 --seconds 3 --trials 6 -o policy.json
      the same on the robot itself; the logs of its trials lie in policy_trials/
  tiller policy my_robot.toml --match demos/*.csv --seconds 3 -o policy.json
      the states of demonstrations again, without their commands
  tiller policy robots/emps.toml --method guided --seconds 2 --period 0.05 -o out/axis_policy.json
      a network, taught by local laws; its cost is on states alone, since those know no outputs
"""
# name, kind, least, most, default, what
NUMBERS = (("trials", int, 1, 1000, 8, "pilco, reps: trials with a policy, after a random one"),
           ("seconds", float, 0.1, 600, 4.0, "robot time of each trial"),
           ("period", float, 0.001, 10, 0.1, "seconds between the policy's commands"),
           ("bumps", int, 1, 500, 20, "basis functions of rbf"),
           ("evaluations", int, 1, 100000, 100, "pilco: costs and gradients before a trial"),
           ("restarts", int, 0, 100, 1, "pilco: searches from fresh policies before a trial, as long as most of the "
            "cost is expected"),
           ("conditions", int, 1, 100, 4, "guided: starts"),
           ("iterations", int, 1, 1000, 8, "guided: rounds of 5 trials a start; simopt: rounds of 3 trials"),
           ("updates", int, 2, 100000, 150, "simopt: of the policy before its first trial; later half as many"),
           ("kl", float, 1e-3, 1e3, 1.0, "simopt: largest divergence of the models' weights from equal ones, nats"),
           ("epsilon", float, 1e-3, 1e3, 0.5, "guided: largest mean KL divergence of a round's control laws from the "
            "network, nats per period"),
           ("earlier", int, 1, 10000, 30, "--prior network: runs of other plants that it is fitted to"),
           ("seed", int, 1, 1 << 40, 1, "of commands, noise, starts and first policy"))


def add(one: argparse.ArgumentParser) -> None:
    one.description = "Searches a feedback policy in few trials on the simulated plant."
    one.epilog = EPILOG
    one.add_argument("robot", metavar="ROBOT", help="robot file (.toml) with a [sim] section")
    one.add_argument("--method", choices=METHODS, default="pilco",
                     help="; ".join(f"{name}: {what}" for name, what in METHODS.items()) + " (default %(default)s)")
    one.add_argument("--kind", choices=("rbf", "linear"), default="rbf",
                     help="pilco, reps: of the policy (default %(default)s)")
    for name, kind, least, most, default, what in NUMBERS:
        one.add_argument(f"--{name}", type=number_between(kind, least, most), default=default, metavar="N",
                         help=f"{what} (default %(default)s)")
    one.add_argument("--width", type=number_between(float, 1e-6, 1e6), default=0.0, metavar="W",
                     help="pilco, reps: deviation at which the cost saturates, times the root of a weight (default: a "
                     "quarter of the start's)")
    one.add_argument("--physics", action="store_true",
                     help="pilco, reps: learn only what the file's model leaves unexplained")
    one.add_argument("--prior", choices=("model", "network"), default="model",
                     help="adaptive_lqr, adaptive_ilqr: what is adapted, the file's model or a network that earlier "
                     "runs have taught, on plants that [sim] draws anew (default %(default)s)")
    one.add_argument("--match", nargs="+", default=[], metavar="LOG",
                     help="pilco: logs of two or more demonstrations whose distribution of states, period by period, "
                     "the policy is to repeat, in the place of [cost]'s target")
    one.add_argument("--on-robot", action="store_true",
                     help="pilco, reps: trials on the robot, over the transport of its file, in the place of [sim]")
    one.add_argument("--arm", action="store_true", help="with --on-robot: do not wait for the key a; the robot moves")
    one.add_argument("--lockstep", action="store_true", help="with --on-robot: as `tiller run --lockstep`")
    one.add_argument("--reset", metavar="COMMAND", help="with --on-robot: what brings the robot to its start, by the "
                     "shell, before each trial")
    one.add_argument("-o", "--out", type=Path, metavar="FILE",
                     help="the policy (default: ROBOT_policy.json beside the robot file)")
    one.add_argument("--page", type=Path, metavar="FILE", help="pilco, reps: an HTML page of the trials")
    one.add_argument("--quiet", action="store_true", help="no progress")


def _read(a: argparse.Namespace) -> _core.Robot:
    """Raises Error where the file is not fit for what is asked."""
    from .. import _core

    robot = _core.Robot.from_toml(a.robot)
    facts = _core.training_facts(robot)
    if not facts["has_sim"] and not a.on_robot:
        raise RobotFileError(f"{a.robot}: has no [sim] section; trials need a simulated plant, or --on-robot")
    for option in ("arm", "lockstep", "reset"):
        if getattr(a, option) and not a.on_robot:
            raise Error(f"--{option}: is of trials on the robot; add --on-robot")
    if a.on_robot and a.method not in ("pilco", "reps"):
        raise Error(f"--method {a.method}: makes no policy that `tiller run` could try; take pilco or reps")
    if a.match and a.method != "pilco":
        raise Error(f"--match: is of pilco, which forecasts distributions; {a.method} does not")
    if a.prior == "network" and a.method not in ADAPTIVE:
        raise Error(f"--prior network: is of {' and '.join(ADAPTIVE)}; take one of the two as --method")
    if a.method in BY_COST and facts["costs_outputs"]:
        raise RobotFileError(f"{a.robot}: cost.outputs: {a.method} knows costs of states alone; take them out of a "
                             "copy of the file, with state_weight in their place")
    a.out = a.out or Path(robot.path).with_name(Path(robot.path).stem + "_policy.json")
    why = can_write(a.out)
    if why:
        raise Error(f"-o {why}; name a file that can be written", status="io_error")
    return robot


def run(a: argparse.Namespace) -> int:
    robot = _read(a)
    from . import policy_runs
    from .policies.physics import Model
    from .policies.task import make_task

    by_model = {"guided": policy_runs.guide, "simopt": policy_runs.simopt, **dict.fromkeys(ADAPTIVE, policy_runs.adapt)}
    physics = Model(robot, a.period).physics() if a.physics or a.method in by_model else None
    task = make_task(robot, a.period, a.seconds, a.width, physics=physics)
    if a.match:
        from .policies.shown import read_shown

        shown = read_shown(a.robot, a.match, a.period, task.horizon)
        task = dataclasses.replace(task, shown=shown, horizon=len(shown.mean) - 1)
    return by_model.get(a.method, policy_runs.search)(a, robot, task)
