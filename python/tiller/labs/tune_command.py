"""tiller tune: settings of planner, cost and priors by the return of episodes on the simulated plant."""
from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from .._command import run as run_tiller
from .._errors import CommandError, Error, RobotFileError
from .arguments import number_between
from .output import can_write, replace_file

if TYPE_CHECKING:
    from .tune.search import Options, Search
    from .tune.trial_log import Trial

EPILOG = """
Each trial runs the controller in lockstep against the plant of [sim], once a training seed. Its return is minus the
mean stage cost, always by the cost of ROBOT as it is. CMA-ES chooses the trials. Before and after are compared on seeds
that no trial has seen (docs/guide/tune.md).

Examples:
  tiller tune robots/cart_pole.toml -o out/cart_tuned.toml
      the default keys, 60 trials; then tiller run out/cart_tuned.toml --sim
  tiller tune my_robot.toml --search planner.horizon=20:80 --search planner.noise_sd.force_N=log:0.5:10 --trials 100
      two keys; after a cut, the same command with --resume
"""


def add(one: argparse.ArgumentParser) -> None:
    one.description = "Searches settings of planner, cost and priors on the simulated plant."
    one.epilog = EPILOG
    one.add_argument("robot", metavar="ROBOT", help="robot file (.toml) with a [sim] section")
    one.add_argument("--search", action="append", default=[], metavar="KEY=LOW:HIGH",
                     help="or KEY=log:LOW:HIGH for even steps of the logarithm; as often as wanted. KEY is a number of "
                     "the file in planner, cost, posterior, parameters, effects or noise: planner.horizon, "
                     "planner.noise_sd.force_N, parameters.pole_mass_kg.uniform.1. Default: horizon (half to twice), "
                     "noise_sd (a quarter to four times), input and input rate weights (a tenth to ten times)")
    for name, kind, least, most, default, what in (
            ("trials", int, 2, 100000, 60, "sets of values that are tried, the file's own first"),
            ("seconds", float, 0.1, 3600, 5.0, "robot time of each episode"),
            ("train", int, 1, 1000, 6, "episodes of a trial, each with its seed"),
            ("test", int, 1, 1000, 12, "episodes on other seeds, for before and after"),
            ("seed", int, 1, 1 << 53, 1, "first training seed; tiller run --sim --seed repeats one"),
            ("threads", int, 1, 256, len(os.sched_getaffinity(0)), "episodes side by side; results are the same bits")):
        one.add_argument(f"--{name}", type=number_between(kind, least, most), metavar="N", default=default,
                         help=f"{what} (default %(default)s)")
    one.add_argument("-o", "--out", type=Path, help="the tuned robot file (default: ROBOT_tuned.toml beside the robot "
                     "file)")
    one.add_argument("--log", type=Path, help="CSV with a row a trial (default: beside the tuned file, ending .csv)")
    one.add_argument("--resume", action="store_true", help="go on with the trials of the log; the result is that of an "
                     "uncut run")
    one.add_argument("--quiet", action="store_true", help="no progress")


class Progress:
    """On a terminal one line that overwrites itself, elsewhere a line a trial."""

    def __init__(self, o: Options) -> None:
        self._o, self._begun, self._done = o, time.monotonic(), 0

    def __call__(self, index: int, trials: list[Trial]) -> None:
        from .tune.report import progress_text

        self._done += 1
        left_s = (time.monotonic() - self._begun) / self._done * (self._o.trials - index - 1)
        left = f"; about {left_s:.0f} s left" if left_s else ""
        terminal = sys.stderr.isatty()
        print(("\r\033[K" if terminal else "") + progress_text(self._o, index, trials) + left,
              end="" if terminal and left else "\n", file=sys.stderr, flush=True)


def _search(a: argparse.Namespace) -> Search:
    from .. import _core
    from .tune.search import Options, Search
    from .tune.search_key import SearchKey, check_search, default_search, parse_search

    path = Path(a.robot)
    robot = _core.Robot.from_toml(a.robot)
    text = Path(robot.path).read_text(encoding="utf-8")
    keys: list[SearchKey] = []
    for argument in a.search:
        key = parse_search(argument)
        check_search(text, key)
        if key.path in [other.path for other in keys]:
            raise Error(f"--search {argument}: {key.path} is searched twice; leave one out")
        keys.append(key)
    keys = keys or default_search(robot, text)
    if not keys:
        raise Error(f"{path}: nothing to search by default; name keys, such as --search planner.horizon=20:80")
    a.out = a.out or path.with_name(path.stem + "_tuned.toml")
    a.log = a.log or a.out.with_suffix(".csv")
    if a.out.exists() and a.out.samefile(robot.path):
        raise Error(f"-o {a.out}: is the robot file itself; name another")
    why = can_write(a.out)
    if why:
        raise Error(f"-o {why}; name a file that can be written")
    o = Options(keys, a.trials, a.seconds, a.train, a.test, a.seed, a.threads, a.resume)
    return Search(robot, text, o, a.log, (lambda index, trials: None) if a.quiet else Progress(o))


def _write(out: Path, text: str) -> int:
    """The new file is read back from where it is going to stand: what it names lies beside the old one."""
    from .. import _core

    try:
        _core.Robot.from_text(text, str(out))
        replace_file(out, text)
    except RobotFileError as problem:
        print(f"{out}: the tuned file names files relative to the robot file; write it beside it with -o\n{problem}",
              file=sys.stderr)
        return 2
    except OSError as problem:
        print(f"{out}: {problem.strerror}; name a file that can be written", file=sys.stderr)
        return 2
    print(f"robot file: {out.absolute()}\n  next: tiller run {out} --sim")
    try:
        _, checked = run_tiller(["check", str(out)], good=range(256))
    except CommandError:
        return 0
    for line in checked.splitlines():  # whether a tick fits its period on this computer
        if line.strip().startswith("tick ") or not line.startswith(" ") and "period" in line:
            print(" ".join(line.split()))
    return 0


def run(a: argparse.Namespace) -> int:
    from .tune.report import report_text

    search = _search(a)
    try:
        result = search.run()
    except KeyboardInterrupt:
        print(f"\ntiller: interrupted after {len(search.result.trials)} of {a.trials} trials; the same command with "
              "--resume goes on", file=sys.stderr)
        return 130
    print(report_text(search.o, result), end="")
    print(f"trials: {a.log.absolute()}", flush=True)
    return _write(a.out, result.text) if result.best else 0
