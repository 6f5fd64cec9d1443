"""The `tiller` command: in a process of its own, by the interpreter that runs this one."""
from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence

from ._errors import CommandError
from ._paths import ABOVE, prepare


def main() -> None:
    """The console script `tiller`, and `python -m tiller`."""
    prepare()
    from . import _core

    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)  # the command has handlers of its own where it needs them
    sys.exit(_core.run_command(["tiller", *sys.argv[1:]]))


def command_line(arguments: Sequence[str]) -> list[str]:
    """What starts the command with these arguments."""
    return [sys.executable, "-m", "tiller", *arguments]


def environment() -> dict[str, str]:
    """In which command_line() finds this package."""
    prepare()
    folders = [ABOVE, os.environ.get("PYTHONPATH", "")]
    return dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, folders)))


def run(arguments: Sequence[str], *, good: Sequence[int] = (0,)) -> tuple[int, str]:
    """(exit code, what it printed). Raises CommandError for an exit code that is not good. Ctrl-C ends the command
    too, and comes back as KeyboardInterrupt."""
    with subprocess.Popen(command_line(arguments), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          env=environment(), stdin=subprocess.DEVNULL) as process:
        try:
            output, _ = process.communicate()
        except BaseException:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
            raise
    if process.returncode not in good:
        raise failed(arguments[0], process.returncode, output)
    return process.returncode, output


def failed(command: str, exit_code: int, output: str) -> CommandError:
    """The exception for a command that did not do what it was asked for."""
    lines = output.strip().splitlines()
    error = CommandError(f"tiller {command} ended with {exit_code}: " + "\n".join(lines[-5:]),
                         status="command_failed", code=exit_code,
                         remedy=lines[-1].split("; ")[-1] if lines and "; " in lines[-1] else
                         f"read the output; tiller {command} --help explains the arguments")
    error.exit_code, error.output = exit_code, output
    return error
