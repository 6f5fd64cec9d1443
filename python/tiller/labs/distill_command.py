"""tiller distill: a planner's answers in a small network."""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .._errors import Error
from .arguments import number_between
from .distill.options import Options
from .output import can_write

READABLE = ("state", "goal", "belief_mean", "belief_spread", "last_command")
MOST_WIDTH = 64  # TILLER_MAX_NETWORK_WIDTH
EPILOG = """
In each round the model of ROBOT is steered with hidden parameters drawn from the priors; the teacher says at every tick
what it would do, and a tanh network is fitted to its answers (DAgger). Beside the policy, a robot file
ROBOT_policy.toml is written whose planner is the policy, and the teacher its fallback (docs/guide/distill.md). A
sampling planner teaches in closed loop with 512 rollouts and 4 iterations at least, for its answers then agree.

Examples:
  tiller distill robots/planar_quadrotor.toml -o out/quadrotor_policy.json
      the file's own planner as the teacher, with the default settings
  tiller distill my_robot.toml -o my_policy.json --teacher ilqr --hidden 24,24 --iterations 8 --episodes 60
      then tiller run my_robot_policy.toml --sim, and tiller export my_robot_policy.toml for a firmware
"""


def _widths(text: str) -> list[int]:
    widths = [int(word) for word in text.split(",")]
    if not 1 <= len(widths) <= 2 or not all(1 <= width <= MOST_WIDTH for width in widths):
        raise argparse.ArgumentTypeError(f"takes the widths of one or two layers, each 1..{MOST_WIDTH}, such as "
                                         "--hidden 32,32")
    return widths


def _reads(text: str) -> int:
    for name in text.split(","):
        if name not in READABLE:
            raise argparse.ArgumentTypeError(f"{name} is none of {', '.join(READABLE)}; name those that the policy is "
                                             "to read")
    return sum(1 << READABLE.index(name) for name in set(text.split(",")))


def add(one: argparse.ArgumentParser) -> None:
    o = Options()
    one.description = "Teaches a small network what a planner does, for small targets."
    one.epilog = EPILOG
    one.add_argument("robot", metavar="ROBOT", help="robot file (.toml)")
    one.add_argument("-o", "--out", type=Path, required=True, help="the policy (.json)")
    one.add_argument("--teacher", default="",
                     help="planner that answers, with its settings in ROBOT (default: its kind)")
    one.add_argument("--as-it-is", action="store_true", help="a sampling teacher with ROBOT's rollouts and iterations, "
                     "and not in closed loop")
    one.add_argument("--hidden", type=_widths, default=o.hidden, metavar="A,B",
                     help="widths of one or two layers of tanh (default 32,32)")
    one.add_argument("--reads", type=_reads, default=0, metavar="LIST",
                     help=f"what the policy reads, of {','.join(READABLE)} (default: state and belief; goal too where "
                     "the cost has a reference)")
    for name, kind, least, most, what in (
            ("iterations", int, 1, 100, "rounds"), ("episodes", int, 2, 100000, "episodes of a round"),
            ("seconds", float, 0.1, 3600, "robot time of each episode"),
            ("validation", int, 1, 10000, "undisturbed episodes after a round; they choose the round"),
            ("test", int, 0, 10000, "held-out draws on which whole controllers compare in the end"),
            ("seed", int, 1, 1 << 40, "of draws, noise and weights"),
            ("threads", int, 1, 256, "episodes side by side; results are the same bits")):
        one.add_argument(f"--{name}", type=number_between(kind, least, most), metavar="N", default=getattr(o, name),
                         help=f"{what} (default %(default)s)")
    one.add_argument("--page", type=Path, help="the page (default: beside the policy, ending .html)")
    one.add_argument("--no-page", action="store_true", help="no page")
    one.add_argument("--quiet", action="store_true", help="no progress")


def run(a: argparse.Namespace) -> int:
    from .. import _core
    from .distill.course import Course, Distilled
    from .distill.files import table, write_all

    why = can_write(a.out)
    if why:
        raise Error(f"-o {why}; name a file that can be written", status="io_error")
    robot = _core.Robot.from_toml(a.robot)
    o = Options(a.teacher, a.as_it_is, a.hidden, a.reads, a.iterations, a.episodes, a.seconds, a.validation, a.test,
                a.seed, a.threads)
    tell = (lambda line: None) if a.quiet else (lambda line: print(line, file=sys.stderr, flush=True))
    course, result, code = Course(robot, o, tell), Distilled(), 0
    try:
        course.run(result)
    except KeyboardInterrupt:
        if not result.rounds:
            print("\ntiller distill: interrupted in the first round; nothing was written", file=sys.stderr)
            return 130
        print("\ntiller distill: interrupted; the best round so far is written", file=sys.stderr)
        code = 130
    print(table(result), end="", flush=True)
    page = None if a.no_page else a.page or a.out.with_suffix(".html")
    return write_all(robot, _core.training_facts(course.teacher)["planner"], o, result, a.out, page) or code
