"""python -m tiller_tools.fleet identify|gap|make: what `tiller fleet` becomes."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from pathlib import Path

from .files import DiskFull, FleetError, replace_file


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tiller fleet")
    commands = parser.add_subparsers(dest="what", required=True)
    for what in ("identify", "gap"):
        fit = commands.add_parser(what)
        fit.add_argument("folder")
        fit.add_argument("--robot")
        fit.add_argument("--out")
        fit.add_argument("--tiller", default="tiller")
        fit.add_argument("--jobs", type=int, default=1)
        fit.add_argument("--scheduler")
        fit.add_argument("--worker-tiller")
        fit.add_argument("--false-alarm", type=float, default=0.05)
        fit.add_argument("--seed", type=int, default=1)
        fit.add_argument("--fresh", action="store_true")
        fit.add_argument("--quiet", action="store_true")
    make = commands.add_parser("make")
    make.add_argument("folder")
    make.add_argument("--robots", type=int, default=1000)
    make.add_argument("--odd", type=int, default=5)
    make.add_argument("--seconds", type=float, default=3.0)
    make.add_argument("--seed", type=int, default=1)
    at = argv.index("--") if "--" in argv else len(argv)
    args = parser.parse_args(argv[:at])
    args.options = argv[at + 1:]  # of each fit
    return args


def _make(args) -> None:
    from .make import make

    if args.odd > args.robots:
        raise FleetError(f"--odd {args.odd}: more than the {args.robots} robots that there are")
    make(args.folder, args.robots, args.odd, args.seconds, args.seed)
    print(f"fleet: {args.robots} robots, {args.odd} odd, in {Path(args.folder).resolve()}\n"
          f"  next: tiller fleet identify {args.folder}")


def _fit(args) -> None:
    from . import fit, gap_fleet, identify_fleet, report

    kind = identify_fleet if args.what == "identify" else gap_fleet
    out = Path(args.out) if args.out else Path(args.folder) / f"fleet_{args.what}"
    how = fit.How(args.folder, args.robot, out, args.tiller, args.jobs, args.scheduler, args.worker_tiller, args.fresh,
                  args.quiet, args.false_alarm, args.seed, args.options)
    fitted = fit.fit_all(how, args.what, kind.line)
    result = kind.analyse(fitted, args.false_alarm, args.seed)
    print(kind.text(result), end="")
    replace_file(out / "fleet.json", (json.dumps(result, indent=1) + "\n").encode())
    replace_file(out / "fleet.html", report.build(result).encode())
    print(f"\nresult: {(out / 'fleet.json').resolve()}\nreport: {(out / 'fleet.html').resolve()}")


def _interrupt(_signal, _frame):
    raise KeyboardInterrupt


def main(argv: list[str]) -> int:
    signal.signal(signal.SIGTERM, _interrupt)  # ends the fits that run, as Ctrl-C does
    args = _parse(argv)
    try:
        _make(args) if args.what == "make" else _fit(args)
    except DiskFull as error:
        print(f"tiller: {error}", file=sys.stderr)
        return 2
    except FleetError as error:
        print(f"tiller: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ntiller: interrupted; what is fitted is kept, the same command goes on", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except ModuleNotFoundError as error:
        print(f"tiller: {error}; tiller fleet needs Python with the packages of tools/dev/requirements.txt: run ./dev "
              "setup, or set TILLER_PYTHON to an interpreter that has them", file=sys.stderr)
        sys.exit(1)
