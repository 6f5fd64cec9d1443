"""Packages through processes of this machine: each is a run of the `tiller` command."""

from __future__ import annotations

import concurrent.futures
import os
import signal
import threading
from typing import Callable, Iterable

from .files import DiskFull, FleetError
from .jobs import Package
from .worker import run_package

RETRIES = 3  # of a process that a signal ended: killed by hand, or for want of memory


class Pool:
    """`jobs` processes at a time. A killed one is run again; a full disk or an interrupt ends the others."""

    def __init__(self, jobs: int, tiller: str, version: str):
        self.jobs, self.tiller, self.version = jobs, tiller, version
        self._running: set = set()
        self._lock = threading.Lock()
        self._stopped = False

    def _started(self, process) -> None:
        with self._lock:
            self._running.add(process)
            if self._stopped:
                os.killpg(process.pid, signal.SIGKILL)

    def _run(self, package: Package) -> dict:
        for attempt in range(1 + RETRIES):
            ran = run_package(package.arguments, package.files, [self.tiller], self.version, self._started)
            if ran["code"] >= 0 or self._stopped:
                return ran
        raise FleetError(f"{package.name}: the command was ended by signal {-ran['code']} {1 + RETRIES} times; where "
                         "memory is short, give fewer --jobs")

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            for process in self._running:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)

    def run(self, packages: Iterable[Package], done: Callable[[Package, dict], None]) -> None:
        """Calls `done` in this thread, as results come. At most two packages a process are in memory."""
        waiting = iter(packages)
        futures: dict = {}
        with concurrent.futures.ThreadPoolExecutor(self.jobs) as threads:
            try:
                while True:
                    while len(futures) < 2 * self.jobs and (package := next(waiting, None)) is not None:
                        futures[threads.submit(self._run, package)] = package
                    if not futures:
                        return
                    ready, _ = concurrent.futures.wait(futures, return_when=concurrent.futures.FIRST_COMPLETED)
                    for future in ready:
                        done(futures.pop(future), _result(future))
            except BaseException:
                self.stop()
                threads.shutdown(wait=True, cancel_futures=True)
                raise


def _result(future) -> dict:
    try:
        return future.result()
    except OSError as error:
        kind = DiskFull if error.errno in (28, 122) else FleetError
        raise kind(f"temporary folder: {error.strerror}: {error.filename}; free space, or set TMPDIR; then run the same "
                   "command again") from None
    except RuntimeError as error:
        raise FleetError(str(error)) from None
