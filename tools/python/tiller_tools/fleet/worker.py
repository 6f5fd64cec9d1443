"""Runs one package through the `tiller` command: in a process of the pool, or on a worker of Dask.

Needs nothing but Python's own library, so that it can be sent to a worker that has no copy of tiller_tools.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

THREADS_ENV = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
_versions: dict[str, str] = {}


def version_of(tiller: str) -> str:
    """What `tiller version` says first: "tiller 0.1.0" without the instruction set; raises OSError."""
    if tiller not in _versions:
        out = subprocess.run([tiller, "--version"], capture_output=True, text=True, check=False).stdout
        _versions[tiller] = out.split(",")[0].strip()
    return _versions[tiller]


def command_here(candidates: list[str], version: str) -> str:
    """The first candidate that is on this machine in that version; RuntimeError tells what there is instead."""
    seen = []
    for candidate in candidates:
        path = shutil.which(candidate)
        if path is None:
            continue
        try:
            found = version_of(path)
        except OSError as error:
            found = str(error)
        if found == version:
            return path
        seen.append(f"{path} is '{found}'")
    raise RuntimeError(f"no `tiller` of version '{version}' on {os.uname().nodename}: "
                       f"{'; '.join(seen) or 'none of ' + ', '.join(candidates)}; install it there, or name it by "
                       "--worker-tiller")


def _lay_out(folder: str, files: dict[str, bytes]) -> None:
    for name, data in files.items():
        path = Path(folder) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def run_package(arguments: list[str], files: dict[str, bytes], candidates: list[str], version: str,
                started=None) -> dict:
    """{"code", "out", "err"} of the command; a code below zero is the signal that ended it.

    `started` is told the process, so that a caller can end it. The command runs in a folder of its own, with relative
    names: what it prints does not depend on where that is.
    """
    tiller = command_here(candidates, version)
    with tempfile.TemporaryDirectory(prefix="tiller_fleet_") as folder:
        _lay_out(folder, files)
        process = subprocess.Popen([tiller, *arguments], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, env=dict(os.environ, **THREADS_ENV),
                                   start_new_session=True)
        if started is not None:
            started(process)
        try:
            out, err = process.communicate()
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            raise
    return {"code": process.returncode, "out": out, "err": err}
