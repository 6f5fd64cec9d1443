"""Fits what is not fitted yet: the part that `identify` and `gap` share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .files import FleetError
from .jobs import Job, Package, RobotFiles, find_robots, jobs_of, pack
from .progress import Progress
from .store import Store
from .worker import version_of


@dataclass
class How:
    """Options of the command line."""

    folder: str
    robot: str | None
    out: Path
    tiller: str
    jobs: int
    scheduler: str | None
    worker_tiller: str | None
    fresh: bool
    quiet: bool
    false_alarm: float
    seed: int
    options: list[str]


def _version(tiller: str) -> str:
    try:
        return version_of(tiller)
    except OSError as error:
        raise FleetError(f"{tiller}: cannot be run: {error.strerror}; name the command by --tiller") from None


def _pool(how: How, version: str):
    if how.scheduler:
        from .dask_pool import DaskPool

        return DaskPool(how.scheduler, [how.worker_tiller] if how.worker_tiller else [how.tiller, "tiller"], version)
    from .pool import Pool

    return Pool(how.jobs, how.tiller, version)


def fit_all(how: How, what: str, line) -> list[tuple[Job, dict]]:
    """Every job with what is kept of it, in the order of names. `line(kept)` says in words what came out."""
    options = ["--threads", "1", *how.options] if what == "gap" else how.options
    jobs = jobs_of(find_robots(how.folder, how.robot, how.out), what)
    store, robot_files, version = Store(how.out, what), RobotFiles(), _version(how.tiller)
    kept: dict[str, dict] = {}
    signatures: dict[str, str] = {}
    for job in jobs:
        signatures[job.name] = pack(job, what, options, version, robot_files).signature
        if not how.fresh and (found := store.get(job.name, signatures[job.name])) is not None:
            kept[job.name] = found
    todo = [job for job in jobs if job.name not in kept]
    progress = Progress(len(jobs), len(kept), how.quiet)
    by_name = {job.name: job for job in jobs}

    def done(package: Package, ran: dict) -> None:
        kept[package.name] = store.put(package.name, package.signature, ran)
        job = by_name[package.name]
        progress.step(f"{job.robot} ({job.log_names}): {line(kept[package.name])}")

    if todo:
        _pool(how, version).run((pack(job, what, options, version, robot_files) for job in todo), done)
    return [(job, kept[job.name]) for job in jobs]
