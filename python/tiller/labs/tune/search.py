"""The outer loop: CMA-ES (Hansen, arXiv:1604.00772) chooses settings for the return of what the inner loop makes of
them."""
from __future__ import annotations

import math
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import cma
import numpy as np

from ... import _core
from ..._errors import Error, RobotFileError
from ..closed_loop import play
from .search_key import SearchKey, number_at, with_numbers, written
from .trial_log import Trial, TrialLog

FIRST_SIGMA = 0.25  # of the cube: most of the first generation lies in the middle half around the file


@dataclass
class Options:
    keys: list[SearchKey]
    trials: int = 60  # sets of values, the robot file's own first
    seconds: float = 5.0  # of each episode
    train: int = 6  # episodes of a trial: seeds first_seed, first_seed + 1, ...
    test: int = 12  # episodes that no trial sees: the seeds behind those
    first_seed: int = 1
    threads: int = 1  # episodes side by side; the results are the same bits
    resume: bool = False


@dataclass
class Tuned:
    trials: list[Trial] = field(default_factory=list)
    best: int = 0  # of the trials; 0: the robot file as it was
    before: Trial | None = None  # on the test seeds
    after: Trial | None = None  # None where best is 0
    text: str = ""  # the robot file with the best values


def _checksum(text: str) -> int:
    """FNV-1a: tells files apart, protects nothing."""
    total = 14695981039346656037
    for byte in text.encode():
        total = (total ^ byte) * 1099511628211 % (1 << 64)
    return total


def seeds_text(first: int, count: int) -> str:
    return f"seed {first}" if count == 1 else f"seeds {first}..{first + count - 1}"


def settings_text(text: str, o: Options) -> str:
    """What a log must have been made with to be gone on with."""
    return "; ".join([f"tiller tune 2; robot file {_checksum(text):016x}; seconds {o.seconds:g}",
                      seeds_text(o.first_seed, o.train), *map(str, o.keys)])


def generations(start: list[float], seed: int) -> Generator[list[list[float]], list[float], None]:
    """Points of the unit cube; send() each generation's returns, larger is better. A generation is a function of the
    seed and of the returns before it."""
    wide = start if len(start) > 1 else [*start, 0.5]  # cma wants two; the second is told to nobody
    strategy = cma.CMAEvolutionStrategy(wide, FIRST_SIGMA, {"bounds": [0, 1], "seed": seed % 0xffffffff or 1,
                                                             "verbose": -9})
    while True:
        points = strategy.ask()
        returns = yield [list(map(float, point[:len(start)])) for point in points]
        costs = -np.array(returns)
        finite = costs[np.isfinite(costs)]
        costs[~np.isfinite(costs)] = finite.max() + abs(finite.max()) + 1 if len(finite) else 1.0  # ranked last
        strategy.tell(points, costs.tolist())


class Search:
    def __init__(self, robot: _core.Robot, text: str, o: Options, log: Path,
                 tell: Callable[[int, list[Trial]], None]) -> None:
        self.robot, self.text, self.o, self._tell = robot, text, o, tell
        self._log = TrialLog(log, settings_text(text, o), o.keys, o.train, o.resume)
        self.result = Tuned()

    def run(self) -> Tuned:
        """self.result has the trials so far whenever this is interrupted."""
        own = [number_at(self.text, key.path) for key in self.o.keys]
        start = [0.5 if v is None else min(max(key.coordinate(v), 0.0), 1.0)
                 for key, v in zip(self.o.keys, own, strict=True)]
        self._try([written(self.text, key.path) for key in self.o.keys])
        search = generations(start, self.o.first_seed)
        points = next(search)
        while len(self.result.trials) < self.o.trials:
            done = len(self.result.trials)
            for point in points[:self.o.trials - done]:
                self._try([key.text(v) for key, v in zip(self.o.keys, point, strict=True)])
            if len(self.result.trials) < self.o.trials:
                points = search.send([t.mean for t in self.result.trials[done:]])
        return self._conclude()

    def _try(self, values: list[str]) -> None:
        trials, logged = self.result.trials, self._log.trials
        index = len(trials)
        if index < len(logged):
            if logged[index].values != values:
                raise Error(f"{self._log.path}: trial {index + 1} is not the one that this search makes; it is of "
                            "another version of tiller: name another file with --log")
            trials.append(logged[index])
            return
        trial = self._play(values, self.o.first_seed, self.o.train)
        self._log.add(trial)
        trials.append(trial)
        self._tell(index, trials)

    def _with(self, values: list[str]) -> str:
        return with_numbers(self.text, {key.path: value for key, value in zip(self.o.keys, values, strict=True)
                                        if value})

    def _play(self, values: list[str], first: int, count: int) -> Trial:
        """Settings that contradict each other make no episode and no error."""
        try:
            changed = _core.Robot.from_text(self._with(values), self.robot.path)
        except (RobotFileError, KeyError) as problem:
            return Trial(values, refused=str(problem) or "refused")
        with ThreadPoolExecutor(self.o.threads) as pool:
            outcomes = list(pool.map(lambda seed: play(changed, self.robot, self.o.seconds, seed),
                                     range(first, first + count)))
        return Trial(values, [one.score for one in outcomes], sum(one.safe for one in outcomes))

    def _conclude(self) -> Tuned:
        done = self.result
        done.best = max(range(len(done.trials)), key=lambda k: (done.trials[k].mean, -k))
        first = self.o.first_seed + self.o.train
        done.before = self._play(done.trials[0].values, first, self.o.test)
        if done.best:
            done.after = self._play(done.trials[done.best].values, first, self.o.test)
            done.text = self._with(done.trials[done.best].values)
        return done
