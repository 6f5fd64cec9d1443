"""The laboratories' command line: `tiller NAME ...` becomes python -m tiller.labs NAME ..."""
from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from .._errors import Error
from . import _compiled, _install

# Each is a module NAME_command with add(parser), which needs no JAX, and run(arguments) -> exit code.
# tools/cli/laboratories.cpp has the same names for `tiller --help`.
LABORATORIES = {"infer": "learn the parameters of a simulator of your own from logs of the robot",
                "imitate": "learn the weights of the cost, or a policy, from demonstrations",
                "policy": "search a feedback policy in few trials on the simulated plant",
                "distill": "teach a small network what a planner does, for small targets",
                "learn": "learn forces that no known effect explains, on top of the physics",
                "tune": "search settings of planner, cost and priors on the simulated plant"}


def _parser(wanted: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="tiller", description="What learns on the host, on JAX.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, what in LABORATORIES.items():
        one = commands.add_parser(name, help=what, formatter_class=argparse.RawDescriptionHelpFormatter)
        if name in wanted[:1]:  # the others' arguments are not asked for
            import_module(f".{name}_command", __package__).add(one)
    return parser


def _tell_missing() -> int:
    print(f"{_install.missing()[0]} is missing, for {sys.executable}; pip install 'tiller[labs]', or run `tiller "
          "infer` once, which installs it for itself", file=sys.stderr)
    return 1


def main(arguments: Sequence[str] | None = None) -> int:
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words == ["--check"]:  # of a command that starts a laboratory later: can it?
        return 0 if _install.is_ready() else _tell_missing()
    if words == ["--methods"]:  # of tiller identify and tiller run, for as long as they ask
        _install.provide(words)
        _compiled.keep()
        return int(import_module(".methods.serve", __package__).serve())
    try:
        a = _parser(words).parse_args(words)
    except SystemExit as end:  # argparse ends with 2 for a wrong option; tiller's commands with 1
        return 1 if end.code else 0
    try:
        _install.provide(words)
        _compiled.keep()
        return int(import_module(f".{a.command}_command", __package__).run(a))
    except Error as problem:
        print(f"tiller {a.command}: {problem}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"\ntiller {a.command}: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
