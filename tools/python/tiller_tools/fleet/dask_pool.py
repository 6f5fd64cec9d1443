"""The same packages on the workers of a Dask scheduler: bytes go out, bytes come back.

Workers need Python with dask and the `tiller` command of the same version; they share no folder with this machine.
"""

from __future__ import annotations

from typing import Callable, Iterable

from . import worker
from .files import FleetError
from .jobs import Package

RETRIES = 3  # of a task that Dask gives back as failed, beside what it repeats by itself when a worker is lost


def _client(address: str):
    try:
        import cloudpickle
        import distributed
    except ImportError:
        raise FleetError("--scheduler needs the Python package distributed: python -m pip install distributed, in the "
                         "environment that TILLER_PYTHON names") from None
    cloudpickle.register_pickle_by_value(worker)  # the workers have no copy of tiller_tools
    try:
        return distributed, distributed.Client(address, timeout="10s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise FleetError(f"--scheduler {address}: no scheduler answers ({error}); start one with `dask scheduler`, and "
                         "workers with `dask worker ADDRESS --nthreads 1`") from None


def _by_value():
    """worker.run_package in a form that pickle refuses: Dask then sends the code itself, not the name of a module."""
    run = worker.run_package
    return lambda *arguments: run(*arguments)


def _threads(client) -> int:
    """Single-threaded workers are asked for: a fit uses one core, and two in a worker would share its memory limit."""
    workers = client.scheduler_info(n_workers=-1)["workers"]
    if not workers:
        raise FleetError("the scheduler has no worker; start some with `dask worker ADDRESS --nthreads 1`")
    wide = [name for name, w in workers.items() if w["nthreads"] != 1]
    if wide:
        threads = workers[wide[0]]["nthreads"]
        raise FleetError(f"worker {wide[0]} has {threads} threads; start workers with --nthreads 1")
    return len(workers)


class DaskPool:
    def __init__(self, address: str, candidates: list[str], version: str):
        self.distributed, self.client = _client(address)
        self.candidates, self.version, self.run_package = candidates, version, _by_value()
        try:
            self.workers = _threads(self.client)
        except FleetError:
            self.client.close()
            raise

    def run(self, packages: Iterable[Package], done: Callable[[Package, dict], None]) -> None:
        """Calls `done` in this thread. Four tasks a worker wait in the scheduler, the others on this machine."""
        waiting, known, tries = iter(packages), {}, {}
        room = 4 * self.workers
        first = [p for _, p in zip(range(room), waiting)]
        futures = [self._remember(p, known) for p in first]
        flow = self.distributed.as_completed(futures, loop=self.client.loop)
        try:
            for future in flow:
                package = known.pop(future.key)
                ran = self._result(future, package)
                if ran["code"] < 0 and tries.setdefault(package.name, 0) < RETRIES:  # killed on the worker's machine
                    tries[package.name] += 1
                    future.release()
                    flow.add(self._remember(package, known, f"-{tries[package.name]}"))
                    continue
                done(package, ran)
                if (package := next(waiting, None)) is not None:
                    flow.add(self._remember(package, known))
        finally:
            self.client.close()

    def _remember(self, package: Package, known: dict, again: str = ""):
        future = self.client.submit(self.run_package, package.arguments, package.files, self.candidates, self.version,
                                    pure=False, retries=RETRIES,
                                    key=f"tiller-{package.signature[:24]}-{package.name}{again}")
        known[future.key] = package
        return future

    @staticmethod
    def _result(future, package: Package) -> dict:
        try:
            return future.result()
        except Exception as error:  # noqa: BLE001  what a worker raised, or that it was lost too often
            raise FleetError(f"{package.name}: {error}") from None
