"""What `tiller policy` does by each method, and what it prints and writes."""
from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from .output import replace_file

if TYPE_CHECKING:
    from .. import _core
    from .policies.search import SearchOptions, Try
    from .policies.task import Task


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


def search(a: argparse.Namespace, robot: _core.Robot, task: Task) -> int:
    from .policies.feedback import document
    from .policies.pilco import pilco
    from .policies.report import search_document, write_page
    from .policies.reps import RepsOptions, reps_search
    from .policies.search import SearchOptions, SearchResult, SearchStep

    first = "a policy by chance" if a.on_robot else "random commands"

    def after(step: SearchStep, index: int) -> None:
        if task.shown is None:
            told, expected = f"cost {step.cost:.3f} of {task.horizon}", "expected"
        else:
            own, expected = task.horizon * task.nx / 2, "expected divergence"
            told = f"{step.cost:.4g} nats from the demonstrations' mean, of one of them {own:.4g}"
        how = f" ({expected} {step.predicted:.4g}), {step.seconds:.1f} s of search" if step.forecast else f", {first}"
        if not a.quiet:
            print(f"trial {index + 1}: {told}{how}", file=sys.stderr, flush=True)

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


def guide(a: argparse.Namespace, robot: _core.Robot, task: Task) -> int:
    from .policies.feedback import document
    from .policies.guided import GuidedOptions, GuidedResult, GuidedStep, guided_search
    from .policies.plant import measured_deviation
    from .policies.starts import conditions_of, family_of, goal_of

    def after(step: GuidedStep, index: int) -> None:
        apart = f"; at {step.apart} of {a.conditions} starts laws near the network would cost more" * bool(step.apart)
        if not a.quiet:
            print(f"iteration {index + 1}: cost {step.local_cost:.4g} by the local laws, {step.policy_cost:.4g} by the "
                  f"network; divergence {step.divergence:.2g} a period{apart}", file=sys.stderr, flush=True)

    o = GuidedOptions(a.iterations, epsilon=a.epsilon, seed=a.seed)
    result, code = GuidedResult(), 0
    try:
        guided_search(task, goal_of(robot, task), conditions_of(robot, task, a.conditions, a.seed),
                      measured_deviation(robot, a.period), o, after, result, family_of(robot, task))
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


def adapt(a: argparse.Namespace, robot: _core.Robot, task: Task) -> int:
    import numpy as np

    from .policies.adaptive import AdaptiveIlqr, AdaptiveLqr, AdaptiveOptions
    from .policies.neural_physics import earlier_runs, network_physics
    from .policies.plant import PlantTrials, measured_deviation
    from .policies.starts import goal_of

    goal, noise, physics = goal_of(robot, task), measured_deviation(robot, a.period), task.physics
    if a.prior == "network":
        physics = network_physics(task, earlier_runs(robot, task, noise, a.earlier, a.seed), a.seed)
    assert physics is not None
    run = PlantTrials(robot, a.period, task.horizon, noise, task.start_mean, task.start_covariance, a.seed)
    costs = []
    kind = AdaptiveIlqr if a.method == "adaptive_ilqr" else AdaptiveLqr
    options = [AdaptiveOptions(goal.target, task.low, task.high, goal.state, goal.control, noise, adapt=adapt)
               for adapt in (False, True)]
    for i in range(a.trials):
        trials = [run(kind(physics, o), i) for o in options]
        costs.append([((t.truth - goal.target)**2 @ goal.state).sum() + (t.command**2 @ goal.control).sum()
                      for t in trials])
        print(f"trial {i + 1}: cost {costs[-1][0]:.4g} by the {a.prior} alone, {costs[-1][1]:.4g} by what it learns",
              flush=True)
    alone, learnt = np.median(costs, 0)
    print(f"median of {a.trials}: {alone:.4g} and {learnt:.4g}")
    return 0


def simopt(a: argparse.Namespace, robot: _core.Robot, task: Task) -> int:
    import numpy as np

    from .. import _core
    from .policies.feedback import document
    from .policies.physics import Model
    from .policies.plant import PlantTrials, measured_deviation
    from .policies.sim_to_real import Priors, SimToReal, SimToRealOptions, SimToRealResult, SimToRealStep
    from .policies.starts import goal_of

    def after(step: SimToRealStep, index: int) -> None:
        models = ", ".join(f"{name} {step.mean[j]:.4g} +- {step.sd[j]:.2g}" for j, name in enumerate(robot.params)
                           if step.sd[j] > 0)
        if not a.quiet:
            print(f"iteration {index + 1}: cost {step.model_cost:.4g} on the models, {step.plant_cost:.4g} on the "
                  f"plant; models {models}", file=sys.stderr, flush=True)

    bounds = [(p.get("low", -np.inf), p.get("high", np.inf)) for p in robot.priors.values()]
    priors = Priors(_core.draw_params(robot, a.seed, 4096), *np.array(bounds, float).reshape(-1, 2).T)
    noise = measured_deviation(robot, a.period)
    run = PlantTrials(robot, a.period, task.horizon, noise, task.start_mean, task.start_covariance, a.seed)
    o = SimToRealOptions(a.iterations, a.updates, kl=a.kl, seed=a.seed)
    result, code = SimToRealResult(), 0
    try:
        SimToReal(task, goal_of(robot, task), Model(robot, a.period).step, priors, run, noise, o).run(after, result)
    except KeyboardInterrupt:
        if result.network is None:
            raise
        print("\ntiller policy: interrupted; the best iteration's network is written", file=sys.stderr)
        code = 130
    assert result.network is not None
    _write(a, document(task, result.network, "cut"))
    return code
