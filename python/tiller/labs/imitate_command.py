"""tiller imitate: the command line of tiller.labs.imitate."""
from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._command import run as run_tiller
from .._errors import CommandError, Error

if TYPE_CHECKING:
    from .imitate.learn import Imitated, Options
    from .imitate.problem import Problem

METHODS = ("maxent", "matching", "adversarial", "wasserstein", "iq_learn")

EPILOG = """
Every weight of [cost] above 0 that stands in the file as a number is learnt, but for the first input's. Weights come
with intervals; one that the demonstrations do not tell is named and stays near the file's.
A policy imitates without a cost: a critic learns to tell its rollouts on the model from the demonstrations, and the
policy to be mistaken for them. Its robot file plans as before wherever the policy was shown nothing.

Examples:
  tiller imitate my_robot.toml demos/*.csv -o my_robot_imitated.toml --page out/imitate.html
      weights that explain what was done, and a page with what they do from the same starts
  tiller imitate my_robot.toml reach1.csv reach2.csv --horizon whole --keep cost.bounds.angle_rad.weight
      motions that were planned from start to end; the price of the joint's ends stays
  tiller imitate my_robot.toml demos/*.csv --method wasserstein -o my_robot_acts.toml --page out/acts.html
      a network of 24 x 24 in my_robot_acts_policy.json, which tiller run my_robot_acts.toml --sim follows
"""


def _horizon(text: str) -> int:
    if text == "whole":
        return 0
    if text.isdigit() and 2 <= int(text) <= 2000:
        return int(text)
    raise argparse.ArgumentTypeError(f'{text}: is neither "whole" nor a number of periods in 2 .. 2000')


def _count(most: int) -> Any:
    def count(text: str) -> int:
        if not text.isdigit() or not 1 <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text} is not in 1 .. {most}")
        return int(text)
    return count


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = "Learns the weights of the cost, or a policy, from demonstrations."
    parser.epilog = EPILOG
    parser.add_argument("robot", help="robot file (.toml): model, parameters, sensors, and a [cost] to begin with")
    parser.add_argument("logs", nargs="+",
                        help="demonstrations: CSV, ROS bags, ULog, or what tiller run --record and lcm-logger write")
    parser.add_argument("-o", "--out", type=Path,
                        help="robot file with the learnt weights; of a policy: with [policy], and OUT_policy.json")
    parser.add_argument("--page", type=Path, help="an HTML page, and its JSON beside it; a folder: imitate.html in it")
    parser.add_argument("--method", choices=METHODS, default="maxent",
                        help="maxent (default), matching: weights of the cost; adversarial (GAIL), wasserstein, "
                        "iq_learn: a network that acts (docs/theory/imitation.md)")
    parser.add_argument("--keep", action="append", default=[], metavar="KEY",
                        help="a weight that stays as it is: cost.state_weight.angle_rad")
    parser.add_argument("--target", action="append", default=[], metavar="STATE",
                        help="maxent: a state whose target is learnt with the weights: angle_rad")
    parser.add_argument("--scale", default="", metavar="KEY",
                        help="the weight that stays, for the scale: demonstrations tell ratios alone (default: the "
                        "first input's)")
    parser.add_argument("--horizon", type=_horizon, default=-1,
                        help='periods that the demonstrator looked ahead (default: the planner\'s), or "whole": each '
                        "demonstration is one plan to its end; of a policy: periods of a rollout (default 60)")
    parser.add_argument("--every", type=_count(100000), default=0,
                        help="with a horizon: judge each n-th input (default: about 400 in all)")
    parser.add_argument("--rounds", type=_count(100000), default=40,
                        help="of matching: plans of every demonstration (default %(default)s)")
    parser.add_argument("--iterations", type=_count(100000), default=400,
                        help="of a policy: rollouts, critic and policy in turn (default %(default)s)")
    parser.add_argument("--seed", type=_count(2**40), default=1,
                        help="of a policy: its first weights, rollouts and draws (default %(default)s)")


def _options(a: argparse.Namespace) -> Options:
    from .imitate.learn import Options

    return Options(a.method, a.keep, a.target, a.scale, a.horizon, a.every, a.rounds, a.iterations, a.seed)


def _least(a: argparse.Namespace) -> list[str]:
    """Periods that a demonstration must have: what the demonstrator looked ahead."""
    if a.horizon > 0 and a.method in ("maxent", "matching"):
        return ["--least", str(max(10, a.horizon))]
    if a.horizon < 0 and a.method in ("maxent", "matching"):
        import tiller

        return ["--least", str(max(10, tiller.Robot.from_toml(a.robot).horizon))]
    return []


def _learn(a: argparse.Namespace) -> tuple[Problem, Options, Imitated]:
    from .imitate.learn import learn
    from .imitate.problem import read_problem

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.json"
        run_tiller(["data", "imitate", a.robot, *a.logs, "-o", str(path), *_least(a)])
        problem = read_problem(path, a.robot)
    shown = sys.stderr.isatty()
    options = _options(a)
    try:
        result = learn(problem, options, (lambda what: print(
            f"\r\033[K{what} ...", end="", file=sys.stderr, flush=True)) if shown else None)
    finally:
        print("\r\033[K" if shown else "", end="", file=sys.stderr)
    return problem, options, result


def _write_robot(a: argparse.Namespace, problem: Problem, result: Imitated) -> None:
    """The new file is read back from where it is going to stand: what it names lies beside the old one."""
    import tiller

    from .imitate import report
    from .imitate.robot_text import acting

    text = result.text
    if result.acting:
        path = a.out.with_name(a.out.stem + "_policy.json")
        report.write_json(path, report.policy_document(problem, result))
        text = acting(text, problem.planner, path.name)
        print(f"\npolicy: {path.resolve()}")
    try:
        tiller.Robot.from_text(text, str(a.out))
    except Error as refused:
        raise OSError(f"{a.out}: the learnt file names files relative to the robot file; write it beside it with -o\n"
                      f"{refused}") from refused
    report.write_text(a.out, text)
    print(f"\nrobot file: {a.out.resolve()}\n  next: tiller run {a.out} --sim")


def _write_page(a: argparse.Namespace, problem: Problem, options: Options, result: Imitated) -> None:
    """The JSON lies beside the page, under its name."""
    from .imitate import report

    page = a.page if a.page.suffix == ".html" else a.page / "imitate.html"
    report.write_json(page.with_suffix(".json"), report.document(problem, options, result))
    print(f"result: {page.with_suffix('.json').resolve()}")
    from tiller_tools import imitate_report

    imitate_report.write_report(page.with_suffix(".json"), page)
    print(f"report: {page.resolve()}")


def run(a: argparse.Namespace) -> int:
    if a.out and a.out.exists() and Path(a.robot).exists() and a.out.samefile(a.robot):
        print(f"-o {a.out}: is the robot file itself; name another", file=sys.stderr)
        return 1
    from .imitate import report
    from .imitate.problem import ImitationError

    try:
        problem, options, result = _learn(a)
    except ImitationError as refused:
        print(f"{a.robot}: {refused}", file=sys.stderr)
        return 1
    except CommandError as refused:
        print(refused.output.strip(), file=sys.stderr)
        return 1
    for warning in result.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(report.text(problem, options, result), end="", flush=True)
    try:
        if a.out:
            _write_robot(a, problem, result)
        if a.page:
            _write_page(a, problem, options, result)
    except Exception as failed:  # what was learnt stands printed already
        print(f"{failed}; choose another file, or pip install 'tiller[pages]'", file=sys.stderr)
        return 2
    return 0
