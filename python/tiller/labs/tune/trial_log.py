"""One row a trial, on disk before the next trial begins; a search that was cut goes on behind the last whole row."""
from __future__ import annotations

import math
import os
import statistics
from dataclasses import dataclass, field
from pathlib import Path

from ..._errors import Error
from .search_key import SearchKey, number_text


@dataclass
class Trial:
    """A set of values and what the training episodes made of it."""
    values: list[str]  # by key, as they stand in the robot file; "": left to the default
    scores: list[float] = field(default_factory=list)  # return of each training seed; empty: refused
    safe: int = 0  # episodes that ended in SAFE
    refused: str = ""  # why nothing ran

    @property
    def mean(self) -> float:
        return sum(self.scores) / len(self.scores) if self.scores else -math.inf

    @property
    def sd(self) -> float:
        return statistics.stdev(self.scores) if len(self.scores) > 1 and math.isfinite(self.mean) else 0.0


def _header(settings: str, keys: list[SearchKey], seeds: int) -> str:
    names = ["trial", *(key.path for key in keys), "mean_return", "sd_return", "safe_episodes",
             *(f"return_{s + 1}" for s in range(seeds)), "refused"]
    return f"# {settings}\n{','.join(names)}\n"


def _row(trial: Trial, number: int, seeds: int) -> str:
    numbers = [number_text(trial.mean), number_text(trial.sd), str(trial.safe), *map(number_text, trial.scores)]
    why = trial.refused.replace(",", ";").replace("\n", ";")
    return ",".join([str(number), *trial.values, *([""] * (3 + seeds) if trial.refused else numbers), why]) + "\n"


def _read_row(line: str, number: int, keys: int, seeds: int) -> Trial:
    """Raises ValueError."""
    cells = line.split(",")
    if len(cells) != keys + seeds + 5 or cells[0] != str(number):
        raise ValueError
    values, refused = cells[1:keys + 1], cells[-1]
    if refused:
        return Trial(values, refused=refused)
    return Trial(values, [float(cell) for cell in cells[keys + 4:-1]], int(cells[keys + 3]))


class TrialLog:
    def __init__(self, path: Path, settings: str, keys: list[SearchKey], seeds: int, resume: bool) -> None:
        self.path, self.trials, self._seeds = path, list[Trial](), seeds
        head = _header(settings, keys, seeds)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | (0 if resume else os.O_EXCL), 0o666)
        except FileExistsError:
            raise Error(f"{path}: is there already; go on with --resume, or name another file with --log") from None
        except OSError as problem:
            raise Error(f"{path}: cannot be made: {problem.strerror}; name another file with --log") from None
        if not path.is_file():
            raise Error(f"{path}: is no file that can be gone on with; name another with --log")
        text = path.read_text(encoding="utf-8", errors="replace")
        self._bytes = 0
        if text:
            self._read(text, head, len(keys))
        else:
            self._append(head)

    def _read(self, text: str, head: str, keys: int) -> None:
        if not text.startswith(head):
            first = text.split("\n", 1)[0]
            raise Error(f"{self.path}: was made with other settings or another robot file (its first line tells which: "
                        f"{first}); repeat them, or name another file with --log")
        rows = text[len(head):].split("\n")[:-1]  # what a loss of power cut off is dropped
        for number, line in enumerate(rows, 1):
            try:
                self.trials.append(_read_row(line, number, keys, self._seeds))
            except ValueError:
                raise Error(f"{self.path}: trial {number} cannot be read; cut the file off before it, and --resume "
                            "goes on from there") from None
        self._bytes = len((head + "".join(row + "\n" for row in rows)).encode())
        os.ftruncate(self._file, self._bytes)

    def add(self, trial: Trial) -> None:
        self._append(_row(trial, len(self.trials) + 1, self._seeds))
        self.trials.append(trial)

    def _append(self, text: str) -> None:
        """A row is whole or not there: what a full disk took in part is taken back."""
        left = text.encode()
        try:
            while left:
                left = left[os.pwrite(self._file, left, self._bytes + len(text.encode()) - len(left)):]
            os.fsync(self._file)
        except OSError as problem:
            os.ftruncate(self._file, self._bytes)
            raise Error(f"{self.path}: cannot be written: {problem.strerror}; free space, or copy the file to another "
                        f"disk and name it with --log; --resume then goes on after trial {len(self.trials)}") from None
        self._bytes += len(text.encode())
