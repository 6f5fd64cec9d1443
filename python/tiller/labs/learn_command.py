"""tiller learn: forces that no known effect explains, on top of the physics."""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from .._errors import CommandError, Error
from .arguments import number_between
from .forces_options import FORMS, MOST_MEMBERS, MOST_WIDTH, Options
from .output import can_write, replace_file

if TYPE_CHECKING:
    from .forces.learn import Learnt

NOTHING_LEARNT, UNFIT_LOGS = 2, 3
EPILOG = """
The last quarter of every log judges: rollouts of one second with what was learnt against those without. What does not
earn its place is refused. Effects of the catalogue come first, since they need fewer data and extrapolate: what is
learnt stands on those that earn their place (--no-catalogue leaves them out).

Exit code: 0 learnt; 2 refused; 3 the logs cannot answer; 1 wrong option, robot file or file name.

Examples:
  tiller learn robot.toml logs/*.csv -o learnt
      learnt/learn.html, and learnt/robot_learnt.toml where something has earned its place
  tiller learn robot.toml run.mcap --form gaussian -o learnt && tiller run learnt/robot_learnt.toml --sim
"""


def _widths(text: str) -> list[int]:
    widths = [int(word) for word in text.split(",")]
    if not 1 <= len(widths) <= 2 or not all(1 <= width <= MOST_WIDTH for width in widths):
        raise argparse.ArgumentTypeError(f"takes the widths of one or two layers, each 1..{MOST_WIDTH}, such as "
                                         "--hidden 16,16")
    return widths


def add(one: argparse.ArgumentParser) -> None:
    o = Options()
    one.description = "Learns forces that no known effect explains, on top of the physics."
    one.epilog = EPILOG
    one.add_argument("robot", metavar="ROBOT", help="robot file (.toml): model, priors, sensors, [log]")
    one.add_argument("logs", metavar="LOG", nargs="+", help="logs, as `tiller identify` takes them")
    one.add_argument("-o", "--out", type=Path,
                     help="folder for the network, the robot file with it, learn.json and the page")
    one.add_argument("--form", choices=FORMS, default=o.form,
                     help="effects: of the catalogue alone; network: an ensemble of perceptrons; gaussian: a sparse "
                     "Gaussian process; auto: the better one on what is held out (default)")
    one.add_argument("--hidden", type=_widths, metavar="A,B", default=o.hidden,
                     help="widths of the hidden layers (default 16,16)")
    for name, kind, least, most, what in (
            ("members", int, 1, MOST_MEMBERS, "networks of the ensemble"),
            ("inducing", int, 4, 256, "inducing points of the Gaussian process"),
            ("hold-out", float, 0.05, 0.8, "last share of every log, kept for the judgement"),
            ("most-ratio", float, 0, 1, "rollout errors on what is held out, with over without, that earn a place"),
            ("seed", int, 1, 1000000, "of every random number"),
            ("threads", int, 1, 256, "of the search of the catalogue")):
        one.add_argument(f"--{name}", type=number_between(kind, least, most), metavar="N",
                         default=getattr(o, name.replace("-", "_")), help=f"{what} (default %(default)s)")
    one.add_argument("--no-catalogue", dest="catalogue", action="store_false", help="no effects of the catalogue")
    one.add_argument("--beat-residual", action="store_true", help="refuse what nine weights at one joint do as well")
    one.add_argument("--stem", help="what the files' names begin with (default: the robot's name)")
    one.add_argument("-q", "--quiet", action="store_true", help="no progress")


class Progress:
    """On a terminal one line that overwrites itself, elsewhere a line for each new thing."""

    def __init__(self, quiet: bool) -> None:
        self._shown = not quiet
        self._terminal = sys.stderr.isatty()

    def __call__(self, what: str) -> None:
        if self._shown:
            print(f"\r\033[Klearn: {what}" if self._terminal else f"learn: {what}", file=sys.stderr, flush=True,
                  end="" if self._terminal else "\n")

    def clear(self) -> None:
        if self._shown and self._terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def _learn(a: argparse.Namespace) -> Learnt:
    from .forces.data import Logs
    from .forces.learn import Course

    o = Options(a.form, a.members, a.hidden, a.inducing, a.hold_out, a.most_ratio, a.seed, a.catalogue, a.beat_residual,
                a.threads)
    progress = Progress(a.quiet)
    try:
        with tempfile.TemporaryDirectory(prefix="tiller-learn-") as folder:
            return Course(Logs(Path(a.robot), a.logs, a.hold_out, Path(folder)), o, progress).run()
    finally:
        progress.clear()


def _write(a: argparse.Namespace, learnt: Learnt) -> int:
    """The table is printed already: what fails here loses no result."""
    from .forces.report import report, write_robot

    path, code = "", 0 if learnt.chosen else NOTHING_LEARNT
    try:
        if learnt.chosen:
            path = str(write_robot(a.out, a.stem or learnt.ground.document["robot"], learnt))
        replace_file(a.out / "learn.json", json.dumps(report(learnt, path), indent=1) + "\n")
    except (Error, OSError) as problem:
        print(f"tiller learn: {problem}\nwrite it beside the old robot file with -o where that names files of its "
              "folder", file=sys.stderr)
        return 2
    print(f"result: {(a.out / 'learn.json').absolute()}")
    if path:
        print(f"robot file: {Path(path).absolute()}\n  next: tiller run {path} --sim")
    try:
        from tiller_tools import learn_report

        print(f"report: {learn_report.write_report(a.out / 'learn.json', a.out / 'learn.html').absolute()}")
    except Exception as problem:  # a page that cannot be drawn loses no result
        print(f"no page: {problem}; pip install 'tiller[pages]'", file=sys.stderr)
        return 2
    return code


def run(a: argparse.Namespace) -> int:
    from .. import _core
    from .forces.report import table

    _core.Robot.from_toml(a.robot)  # what is wrong with it is told before anything else
    why = can_write(a.out / "learn.json") if a.out else ""
    if why:
        raise Error(f"-o {why}; name a folder that can be written", status="io_error")
    try:
        learnt = _learn(a)
    except CommandError as problem:
        print(problem.output.strip(), file=sys.stderr)
        return UNFIT_LOGS
    print(table(learnt), end="", flush=True)
    return _write(a, learnt) if a.out else 0 if learnt.chosen else NOTHING_LEARNT
