"""tiller infer: the parameters of a simulator from logs, without a likelihood."""
from __future__ import annotations

import argparse
import json
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from .._command import run as run_tiller
from .._errors import ArgumentError, CommandError
from .options import DENSITY_NAMES, METHODS, SUMMARY_NAMES, Options

if TYPE_CHECKING:
    from .problem import Problem
    from .result import Inferred

EPILOG = """
The simulator is any program that answers lines on stdin with lines on stdout: docs/guide/simulator.md has one of
fifteen lines. No likelihood and no derivative of it is needed. The table ends with a calibration: draws near the logs
are held out, and their 90 % intervals should hold nine of ten of them.

Examples:
  tiller infer puck.toml run1.csv run2.csv -o out/puck
      the posterior of what puck.toml has a prior for, with a page and posterior.json for a run
  tiller infer puck.toml run1.csv --method smc_abc --simulations 20000 --processes 8
      the same by another way, as a check
"""


def add(one: argparse.ArgumentParser) -> None:
    default = Options()
    methods = "".join(f"  {name:15} {m.help}\n  {'':15} [{m.citation}]\n" for name, m in METHODS.items())
    one.description = ("Learns the parameters of a simulator of your own from logs of the robot.\n\n"
                       f"Methods (docs/theory/likelihood_free.md):\n{methods}")
    one.epilog = EPILOG
    one.add_argument("files", nargs="*", metavar="FILE", help="simulator file (.toml: command, priors, sensors), then "
                     "the logs to learn from: CSV, ROS bags, ULog, as `tiller identify` takes them")
    one.add_argument("--command", dest="box", metavar="WORDS", help="in the simulator file's place: the simulator's "
                     "command, words between spaces")
    one.add_argument("--robot", metavar="FILE", help="robot file with names, priors and sensors, for --command")
    one.add_argument("--data", metavar="FILE", type=Path, help="in the place of all files: what `tiller data infer` "
                     "has written")
    one.add_argument("-o", "--out", type=Path, help="folder for infer.json, infer.html and posterior.json")
    one.add_argument("--no-page", action="store_true", help="no infer.html")
    one.add_argument("--method", choices=METHODS, default=default.method, help="how to learn (default %(default)s)")
    one.add_argument("--summary", choices=SUMMARY_NAMES, default=default.summary,
                     help="what simulations and logs are compared by: linear (default), by hand, as BayesSim, or by a "
                     "recurrent network that bayes_sim trains with its density")
    one.add_argument("--density", choices=DENSITY_NAMES, default=default.density,
                     help="of bayes_sim: a mixture of normals by a perceptron (default), or by random Fourier features")
    for name, least, most, what in (("simulations", 50, 10**7, "parameter vectors in all"),
                                    ("rounds", 1, 100, "of bayes_sim"), ("components", 1, 16, "of its mixture"),
                                    ("particles", 50, 10**5, "of smc_abc, chains of mcmc_abc")):
        one.add_argument(f"--{name}", metavar="N", type=_number_between(int, least, most),
                         default=getattr(default, name), help=f"{what} (default %(default)s)")
    one.add_argument("--accept", metavar="SHARE", type=_number_between(float, 1e-6, 1), default=default.accept,
                     help="share that abc and abc_regression keep, and that sets mcmc_abc's tolerance (default "
                     "%(default)s)")
    one.add_argument("--processes", metavar="N", type=_number_between(int, 1, 1024),
                     help="simulators side by side (default: as the file says)")


def _number_between(kind: type, least: float, most: float):  # type: ignore[no-untyped-def]
    def number(text: str) -> float:
        value: float = kind(text)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text} is not in {least} .. {most}")
        return value
    return number


def _check_files(a: argparse.Namespace) -> None:
    """Raises ArgumentError."""
    if a.data:
        if a.files or a.box or a.robot or a.processes:
            raise ArgumentError("--data: has simulator and logs in it; leave files, --command, --robot and --processes "
                                "out")
    elif bool(a.box) != bool(a.robot):
        raise ArgumentError("--command and --robot go together; give both, or a simulator file")
    elif len(a.files) < (1 if a.box else 2):
        raise ArgumentError("a log is missing; give at least one" if a.box or a.files else
                            "a simulator file and at least one log; give both")


def _read(a: argparse.Namespace) -> Problem:
    """tiller's own command reads simulator file and logs: no format has two readers."""
    from .problem import read_problem
    from .simulator import Pool

    if a.data:
        return read_problem(a.data, Pool)
    more = ["--command", a.box, "--robot", a.robot] if a.box else []
    if a.processes:
        more += ["--processes", str(a.processes)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.json"
        run_tiller(["data", "infer", *more, "-o", str(path), *a.files])
        return read_problem(path, Pool)


def _infer(a: argparse.Namespace) -> tuple[Inferred, float]:
    from .infer import infer

    problem = _read(a)
    options = Options(a.method, a.summary, a.simulations, a.rounds, a.components, a.density, a.accept,
                      a.particles)
    shown = sys.stderr.isatty()
    begun = time.monotonic()
    try:
        result = infer(problem, options, (lambda share: print(
            f"\r\033[Ksimulating ... {share:4.0%}", end="", file=sys.stderr, flush=True)) if shown else None)
    finally:
        problem.simulate.close()  # type: ignore[attr-defined]
        print("\r\033[K" if shown else "", end="", file=sys.stderr)
    return result, time.monotonic() - begun


def _write(folder: Path, result: Inferred, seconds: float, with_page: bool) -> int:
    """infer.json, the page and the posterior. The table is printed already: what fails here loses no result."""
    from . import report

    names = [folder / name for name in ("infer.json", "posterior.json", "infer.html")]
    try:
        report.write_json(names[0], report.document(result, seconds))
        report.write_json(names[1], report.posterior(result))
    except OSError as problem:
        print(f"{problem}; choose another folder", file=sys.stderr)
        return 2
    print(f"\nresult: {names[0].resolve()}\nposterior: {names[1].resolve()}, for [posterior] prior_file or tiller run "
          "--posterior")
    if not with_page:
        return 0
    try:
        from tiller_tools import infer_report

        infer_report.write_report(names[0], names[2])
    except Exception as problem:  # a page that cannot be drawn loses no result
        print(f"no page: {problem}; pip install 'tiller[pages]'", file=sys.stderr)
        return 2
    print(f"report: {names[2].resolve()}")
    return 0


def _simulator_of(a: argparse.Namespace) -> str:
    return str(json.loads(a.data.read_text())["simulator_file"] if a.data else a.box or a.files[0])


def run(a: argparse.Namespace) -> int:
    from . import report
    from .problem import InferenceError

    _check_files(a)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # simulators end with this process
    try:
        result, seconds = _infer(a)
    except InferenceError as problem:
        print(f"{_simulator_of(a)}: {problem}", file=sys.stderr)
        return 1
    except CommandError as problem:
        print(problem.output.strip(), file=sys.stderr)
        return 1
    for warning in result.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(report.text(result, seconds), end="", flush=True)
    return _write(a.out, result, seconds, not a.no_page) if a.out else 0
