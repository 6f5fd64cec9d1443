"""What there is to fit: the robots of a folder, their logs and robot files, as packages of bytes.

A package names no place on this machine, so that the same fit gives the same bytes in any process of any machine.
"""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from .files import FleetError, read_bytes

LOG_ENDINGS = {".csv", ".lcm", ".mcap", ".rec", ".mat", ".npz", ".parquet", ".bag", ".db3", ".ulg", ".ulog"}
LARGEST_COMPANION = 64 << 20  # bytes of a file that a robot file names


@dataclass(frozen=True)
class Robot:
    name: str
    file: Path
    logs: tuple[Path, ...]


@dataclass(frozen=True)
class Job:
    """One run of `tiller identify` or `tiller gap`."""

    robot: str
    name: str  # of the result: the robot, and its log where it has several
    file: Path
    logs: tuple[Path, ...]

    @property
    def log_names(self) -> str:
        return ", ".join(log.name for log in self.logs)


@dataclass
class Package:
    """A job as bytes: what a worker needs beside the `tiller` command."""

    name: str
    arguments: list[str]
    files: dict[str, bytes] = field(repr=False)
    signature: str


def _is_bag(path: Path) -> bool:
    """Of ROS 2: a folder."""
    return (path / "metadata.yaml").is_file()


def _logs_in(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if not p.name.startswith(".") and
                  (p.suffix in LOG_ENDINGS if p.is_file() else _is_bag(p)))


def find_robots(folder: str | Path, robot_file: str | None = None, skip: Path | None = None) -> list[Robot]:
    """Every log of `folder` is a robot, and every subfolder with logs is one. Sorted by name."""
    folder = Path(folder)
    if not folder.is_dir():
        raise FleetError(f"{folder}: is no folder; name the one that holds robot.toml and the logs")
    common = Path(robot_file) if robot_file else folder / "robot.toml"
    robots = [Robot(log.stem, common, (log,)) for log in _logs_in(folder)]
    for sub in sorted(p for p in folder.iterdir() if p.is_dir() and not _is_bag(p) and not p.name.startswith(".")):
        if skip is not None and sub.resolve() == skip.resolve() or sub.name in ("fleet_identify", "fleet_gap"):
            continue
        logs = _logs_in(sub)
        own = sub / "robot.toml"
        if logs:
            robots.append(Robot(sub.name, own if own.is_file() else common, tuple(logs)))
    _check(folder, robots)
    return sorted(robots, key=lambda r: r.name)


def _check(folder: Path, robots: list[Robot]) -> None:
    if not robots:
        raise FleetError(f"{folder}: no log in it; put NAME.csv of each robot there, or a folder NAME/ with its logs")
    seen: dict[str, Robot] = {}
    for robot in robots:
        if robot.name in seen:
            raise FleetError(f"{folder}: robot '{robot.name}' is there twice ({seen[robot.name].logs[0]} and "
                             f"{robot.logs[0]}); rename one")
        seen[robot.name] = robot
        stems = [log.stem for log in robot.logs]
        if len(set(stems)) != len(stems):
            raise FleetError(f"{robot.logs[0].parent}: two logs differ by their ending alone; rename one")
        if not robot.file.is_file():
            raise FleetError(f"{robot.file}: no such robot file; write one (tiller help robot-file), or name it by "
                             "--robot")


def jobs_of(robots: list[Robot], what: str) -> list[Job]:
    """identify: one a log, so that the logs of a robot can be compared; gap: one a robot, which wants all its logs."""
    jobs = []
    for robot in robots:
        if what == "gap" or len(robot.logs) == 1:
            jobs.append(Job(robot.name, robot.name, robot.file, robot.logs))
        else:
            jobs += [Job(robot.name, f"{robot.name}.{log.stem}", robot.file, (log,)) for log in robot.logs]
    names = [job.name for job in jobs]
    for name in names:
        if names.count(name) > 1 and len(names) < 5000:
            raise FleetError(f"two logs would leave the same result '{name}'; rename a robot or a log")
    return jobs


def _texts(value) -> list[str]:
    if isinstance(value, str):
        return [value]
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [text for item in inner for text in _texts(item)]


def _companions(path: Path, data: bytes) -> dict[str, bytes]:
    """Files that a robot file names relative to itself: models, trajectories, networks."""
    try:
        texts = _texts(tomllib.loads(data.decode("utf-8")))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {}  # `tiller` tells what is wrong with it, with line and remedy
    found = {}
    for text in sorted(set(texts)):
        near = path.parent / text
        if not text or len(text) > 255 or "\0" in text or "\n" in text or not near.is_file():
            continue
        if Path(text).is_absolute() or ".." in Path(text).parts:
            raise FleetError(f"{path}: names '{text}', which is not beside it; copy it there, so that it travels along")
        if near.stat().st_size > LARGEST_COMPANION:
            raise FleetError(f"{near}: larger than 64 MB, which a robot file of a fleet cannot name")
        found[text] = read_bytes(near)
    return found


class RobotFiles:
    """Robot files with what they name, read once: a thousand robots share one."""

    def __init__(self):
        self._known: dict[Path, dict[str, bytes]] = {}

    def of(self, path: Path) -> dict[str, bytes]:
        if path not in self._known:
            data = read_bytes(path)
            self._known[path] = {"robot.toml": data, **_companions(path, data)}
        return self._known[path]


def pack(job: Job, what: str, options: list[str], version: str, robot_files: RobotFiles) -> Package:
    """Reads the job's files. The signature is that of all that the result depends on."""
    files = dict(robot_files.of(job.file))
    logs = [f"{job.robot}.logs/{log.name}" for log in job.logs]
    for name, log in zip(logs, job.logs):
        parts = sorted(p for p in log.rglob("*") if p.is_file()) if log.is_dir() else [log]
        files.update({name + str(part)[len(str(log)):]: read_bytes(part) for part in parts})
    arguments = [what, "robot.toml", *logs, "--json", *options]
    return Package(job.name, arguments, files, signature(arguments, version, files))


def signature(arguments: list[str], version: str, files: dict[str, bytes]) -> str:
    """SHA-256 over arguments, version and files, each with its length: no two inputs share one."""
    digest = hashlib.sha256()

    def add(data: bytes) -> None:
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)

    for text in [version, str(len(arguments)), *arguments]:
        add(text.encode())
    for name in sorted(files):
        add(name.encode())
        add(files[name])
    return digest.hexdigest()
