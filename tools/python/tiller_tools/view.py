"""A viewer of runs: what `tiller run --view KIND` and `tiller view LOG` start.

    python -m tiller_tools.view rerun|foxglove [--file FILE] [--layout FILE]

Its standard input is a socket of packets. The first eight bytes tell the length of a greeting in JSON (tools/view), the
greeting follows in pieces, and each further packet is the row of a tick in doubles. It answers "ready" once rows may
come, and a dot for each batch that was shown, so that who waits for the end knows that it goes on.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path

try:
    import numpy as np
except ModuleNotFoundError:
    sys.exit(f"view: the package numpy is missing for {sys.executable}: {sys.executable} -m pip install numpy")

from .table import ReportError, write_page

MOST_ROWS = 256  # of a batch
MOST_WAITING = 4096  # rows that are read and not yet shown; then the sender's queue fills, and it drops and counts


class Batch:
    """Rows of some neighbouring ticks: fields by name, (rows x columns), or (rows x steps x columns)."""

    def __init__(self, hello: dict, rows: np.ndarray):
        self.count, self._fields, at = len(rows), {}, 0
        for field in hello["fields"]:
            steps, columns = field["rows"], len(field["columns"])
            values = rows[:, at:at + steps * columns]
            # a field of steps has a dimension for them, however few they are
            is_table = field["name"] in ("plan", "predicted", "predicted_sd", "particles")
            self._fields[field["name"]] = values.reshape(len(rows), steps, columns) if is_table else values
            at += steps * columns
        self.tick = dict(zip(next(f["columns"] for f in hello["fields"] if f["name"] == "tick"),
                             self._fields["tick"].T))
        self.time_s = self.tick["time_s"]

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    def __getitem__(self, name: str) -> np.ndarray:
        return self._fields[name]


class Input:
    """The socket, read ahead by a thread."""

    def __init__(self, descriptor: int):
        self._socket = socket.socket(fileno=descriptor)
        size, = struct.unpack("=Q", self._socket.recv(8))
        text = b""
        while len(text) < size:
            piece = self._socket.recv(65536)
            if not piece:
                raise ReportError("the greeting is cut off")
            text += piece
        self.hello = json.loads(text)
        self._bytes = 8 * sum(f["rows"] * len(f["columns"]) for f in self.hello["fields"])
        self._rows: deque[bytes] = deque()
        self._changed = threading.Condition()
        self._ended = False
        self._last_s, self._offset_s = -np.inf, 0.0

    def begin(self) -> None:
        threading.Thread(target=self._read, daemon=True).start()
        self.say(b"ready")

    def say(self, text: bytes) -> None:
        try:
            self._socket.send(text)
        except OSError:  # who is gone waits for nothing
            pass

    def _read(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: len(self._rows) < MOST_WAITING)
            try:
                row = self._socket.recv(self._bytes)
            except OSError:
                row = b""
            with self._changed:
                self._ended = len(row) != self._bytes
                if not self._ended:
                    self._rows.append(row)
                self._changed.notify_all()
                if self._ended:
                    return

    def batches(self):
        """Whatever has come meanwhile, until the end."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._rows or self._ended)
                rows = [self._rows.popleft() for _ in range(min(len(self._rows), MOST_ROWS))]
                self._changed.notify_all()
            if not rows:
                return
            batch = Batch(self.hello, np.frombuffer(b"".join(rows)).reshape(len(rows), -1).copy())
            self._one_clock(batch)
            yield batch

    def _one_clock(self, batch: Batch) -> None:
        """Episodes begin at zero each: one behind the other."""
        for i, time_s in enumerate(batch.time_s):
            if time_s + self._offset_s < self._last_s:
                self._offset_s = self._last_s + self.hello["period_s"] - time_s
            self._last_s = batch.time_s[i] = time_s + self._offset_s


# ---- packages ----------------------------------------------------------------------------------------


def need(module: str, package: str):
    """The module; its package comes on first use where the environment is that of a source tree (./dev)."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        pass
    wanted = Path(__file__).parents[3] / "tools/dev/requirements_view.txt"
    ours = (Path(sys.prefix) / "requirements.txt").exists() and sys.prefix != sys.base_prefix
    if not (ours and wanted.exists()):
        raise ReportError(f"the package {package} is missing for {sys.executable}: {sys.executable} -m pip install "
                          f"{package}   (or set TILLER_PYTHON to an interpreter that has it)")
    print(f"view: installing {package} into {sys.prefix}, once", file=sys.stderr, flush=True)
    line = [sys.executable, "-m", "pip", "install", "--disable-pip-version-check", "-q", "-r", str(wanted)]
    if subprocess.run(line, check=False, stdout=sys.stderr).returncode != 0:
        raise ReportError(f"{package} cannot be installed: {' '.join(line)}")
    shutil.copy(wanted, sys.prefix)  # as ./dev tells what is there
    importlib.invalidate_caches()
    return importlib.import_module(module)


def open_sink(kind: str, hello: dict, file: str | None):
    if file and Path(file).parent != Path() and not Path(file).parent.is_dir():
        raise ReportError(f"{file}: its folder does not exist; make it, or name another --view-file")
    if kind == "rerun":
        need("rerun", "rerun-sdk")
        from .view_rerun import RerunView
        return RerunView(hello, file)
    need("foxglove", "foxglove-sdk")
    from .view_foxglove import FoxgloveView
    return FoxgloveView(hello, file)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.view", description="Shows a run that another process sends.")
    parser.add_argument("kind", choices=("rerun", "foxglove"))
    parser.add_argument("--file")
    parser.add_argument("--layout")
    options = parser.parse_args(argv)
    os.nice(10)  # a tick that is due goes first, where both want one processor; Rerun's window inherits it
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the run's: its last rows are worth seeing
    try:
        rows = Input(0)
        sink = open_sink(options.kind, rows.hello, options.file)
        if options.layout:
            sink.save_layout(options.layout) if options.kind == "rerun" else write_page(options.layout, sink.layout())
        rows.begin()
        for batch in rows.batches():
            sink.add(batch)
            rows.say(b".")
        sink.close()
    except ReportError as error:
        print(f"view: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
