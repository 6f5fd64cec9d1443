"""tiller policy: a feedback policy in few trials on the simulated plant."""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._errors import Error, RobotFileError
from .arguments import number_between
from .output import can_write, replace_file

if TYPE_CHECKING:
    from .. import _core
    from .policies.search import SearchOptions, Try
    from .policies.task import Task

METHODS = {"pilco": "gradients of the expected cost on a Gaussian process", "reps": "samples on the same process",
           "guided": "local laws that teach a network, priors from the file's model",
           "adaptive_lqr": "no policy, but a comparison: an LQR on the file's model beside one whose model is fitted "
           "anew in each period"}
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
           ("iterations", int, 1, 1000, 8, "guided: rounds of 5 trials a start"),
           ("epsilon", float, 1e-3, 1e3, 0.5, "guided: largest mean KL divergence of a round's control laws from the "
            "network, nats per period"),
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
    if a.method in ("guided", "adaptive_lqr") and facts["costs_outputs"]:
        raise RobotFileError(f"{a.robot}: cost.outputs: {a.method} knows costs of states alone; take them out of a copy "
                             "of the file, with state_weight in their place")
    a.out = a.out or Path(robot.path).with_name(Path(robot.path).stem + "_policy.json")
    why = can_write(a.out)
    if why:
        raise Error(f"-o {why}; name a file that can be written", status="io_error")
    return robot


def _trials(a: argparse.Namespace, robot: _core.Robot, task: Task, o: SearchOptions) -> Try:
    from .policies.plant import PlantTrials, measured_deviation
    from .policies.search import on_plant

    if a.on_robot:
        return _robot_trials(a, robot, task, o)
    return on_plant(task, PlantTrials(robot, a.period, task.horizon, measured_deviation(robot, a.period),
                                      task.start_mean, task.start_covariance, a.seed), a.seed)


def _robot_trials(a: argparse.Namespace, robot: _core.Robot, task: Task, o: SearchOptions) -> Try:
    from .policies.on_robot import RobotTrials
    from .policies.search import fresh_policy

    words = ["--arm"] * a.arm + ["--lockstep"] * a.lockstep
    trials = RobotTrials(robot, task, a.out.with_name(a.out.stem + "_trials"), words, a.reset)
    # commands that jump in every period shake a robot: one that answers what it sees goes first
    return lambda policy, index: trials(fresh_policy(task, o, index, 1.0) if policy is None else policy, index)


def _write(a: argparse.Namespace, document: dict[str, Any]) -> None:
    replace_file(a.out, json.dumps(document, indent=1) + "\n")
    print(f"policy: {a.out.resolve()}", flush=True)


def _search(a: argparse.Namespace, robot: _core.Robot, task: Task) -> int:
    from .policies.feedback import document
    from .policies.pilco import pilco
    from .policies.report import search_document, write_page
    from .policies.reps import RepsOptions, reps_search
    from .policies.search import SearchOptions, SearchResult, SearchStep

    first = "a policy by chance" if a.on_robot else "random commands"

    def after(step: SearchStep, index: int) -> None:
        told = f"expected {step.predicted:.3f}), {step.seconds:.1f} s of search" if step.forecast else ""
        if not a.quiet:
            print(f"trial {index + 1}: " + (f"cost {step.cost:.3f} of {task.horizon} ({told}" if told else
                                            f"{first}, cost {step.cost:.3f} of {task.horizon}"),
                  file=sys.stderr, flush=True)

    o = SearchOptions(a.trials, kind=a.kind, bumps=a.bumps, evaluations=a.evaluations, restarts=a.restarts,
                      seed=a.seed)
    result, run, code = SearchResult(), _trials(a, robot, task, o), 0
    try:
        if a.method == "pilco":
            pilco(task, run, o, after, result)
        else:
            reps_search(task, run, o, RepsOptions(), after, result)
    except KeyboardInterrupt:
        if not any(step.forecast for step in result.steps):
            raise
        print("\ntiller policy: interrupted; the last trial's policy is written", file=sys.stderr)
        code = 130
    assert result.policy is not None
    _write(a, document(task, result.policy.network(), "sine"))
    if a.page:
        try:
            write_page(a.page, search_document(task, result, robot, a.method, a.kind))
        except Exception as problem:  # a page that cannot be drawn loses no result
            print(f"no page: {problem}; pip install 'tiller[pages]'", file=sys.stderr)
            return code or 2
        print(f"page: {a.page.resolve()}")
    return code


def _guide(a: argparse.Namespace, robot: _core.Robot, task: Task) -> int:
    from .policies.feedback import document
    from .policies.guided import GuidedOptions, GuidedResult, GuidedStep, guided_search
    from .policies.plant import measured_deviation
    from .policies.starts import conditions_of, goal_of, refit_of

    def after(step: GuidedStep, index: int) -> None:
        apart = f"; at {step.apart} of {a.conditions} starts laws near the network would cost more" * bool(step.apart)
        if not a.quiet:
            print(f"iteration {index + 1}: cost {step.local_cost:.4g} by the local laws, {step.policy_cost:.4g} by the "
                  f"network; divergence {step.divergence:.2g} a period{apart}", file=sys.stderr, flush=True)

    o = GuidedOptions(a.iterations, epsilon=a.epsilon, seed=a.seed)
    result, code = GuidedResult(), 0
    try:
        guided_search(task, goal_of(robot, task), conditions_of(robot, task, a.conditions, a.seed),
                      measured_deviation(robot, a.period), o, after, result, refit_of(robot, task))
    except KeyboardInterrupt:
        if result.network is None:
            raise
        print("\ntiller policy: interrupted; the best round's network is written", file=sys.stderr)
        code = 130
    assert result.network is not None
    if not a.quiet:
        print(f"iteration {result.best + 1} is the best", file=sys.stderr)
    _write(a, document(task, result.network, "cut"))
    return code


def _adapt(a: argparse.Namespace, robot: _core.Robot, task: Task) -> int:
    import numpy as np

    from .policies.adaptive import AdaptiveLqr, AdaptiveOptions, offset_deviation
    from .policies.plant import PlantTrials, measured_deviation
    from .policies.starts import goal_of

    assert task.physics is not None
    goal, noise = goal_of(robot, task), measured_deviation(robot, a.period)
    run = PlantTrials(robot, a.period, task.horizon, noise, task.start_mean, task.start_covariance, a.seed)
    offset, costs = offset_deviation(task.physics, goal.target, task.low, task.high), []
    options = [AdaptiveOptions(goal.target, task.low, task.high, goal.state, goal.control, noise, offset, adapt=adapt)
               for adapt in (False, True)]
    for i in range(a.trials):
        trials = [run(AdaptiveLqr(task.physics, o), i) for o in options]
        costs.append([((t.truth - goal.target)**2 @ goal.state).sum() + (t.command**2 @ goal.control).sum()
                      for t in trials])
        print(f"trial {i + 1}: cost {costs[-1][0]:.4g} by the model alone, {costs[-1][1]:.4g} by what it learns",
              flush=True)
    alone, learnt = np.median(costs, 0)
    print(f"median of {a.trials}: {alone:.4g} and {learnt:.4g}")
    return 0


def run(a: argparse.Namespace) -> int:
    robot = _read(a)
    from .policies.physics import Model
    from .policies.task import make_task

    by_model = {"guided": _guide, "adaptive_lqr": _adapt}
    physics = Model(robot, a.period).physics() if a.physics or a.method in by_model else None
    task = make_task(robot, a.period, a.seconds, a.width, physics=physics)
    return by_model.get(a.method, _search)(a, robot, task)
