"""Trials on the robot itself: `tiller run` steers it by the policy, over its transport and under its gate."""
from __future__ import annotations

import csv
import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ... import _core
from ..._command import command_line, environment
from ..._errors import Error
from ..output import replace_file
from ..robot_text import with_words
from .feedback import Feedback, document
from .minimise import Numbers
from .plant import Trial
from .task import Task

LEAST_PERIODS = 2  # that teach anything: a transition begins and ends


class TrialFailed(Error):
    """A trial that left no data."""


class RobotTrials:
    """Every trial leaves its policy and its log in a folder; beside the robot file stands ROBOT_trial.toml meanwhile.
    What is measured is the filter's mean, which the policy sees there too; nobody knows the truth, and it stands for
    that as well."""

    def __init__(self, robot: _core.Robot, task: Task, folder: Path, words: Sequence[str],
                 reset: str | None = None) -> None:
        self._path, self._task, self._folder = Path(robot.path), task, folder
        self._words, self._reset = list(words), reset

    def __call__(self, policy: Feedback, index: int) -> Trial:
        """Raises TrialFailed where the robot's log has no two periods of motion."""
        if self._reset and subprocess.run(self._reset, shell=True).returncode:
            raise TrialFailed(f"--reset {self._reset}: failed; trial {index + 1} has not begun",
                              status="command_failed")
        log = self._folder / f"trial_{index + 1}.csv"
        log.unlink(missing_ok=True)
        network = log.with_suffix(".json")
        replace_file(network, json.dumps(document(self._task, policy.network(), "sine"), indent=1) + "\n")
        file = self._trial_file(network)
        try:
            seconds = (self._task.horizon + 1) * self._task.period_s
            code = _steer(["run", str(file), "--seconds", f"{seconds:.9g}", "--log", str(log), "--quiet", *self._words])
        finally:
            file.unlink()
        return read_trial(log, self._task, code)

    def _trial_file(self, policy: Path) -> Path:
        file = self._path.with_name(f"{self._path.stem}_trial.toml")
        text = self._path.read_text(encoding="utf-8")
        replace_file(file, with_words(text, {"model": {"period_s": self._task.period_s}, "planner": {"kind": "policy"},
                                             "policy": {"file": str(policy.resolve())}}))
        return file


def _steer(words: list[str]) -> int:
    """Keys are the operator's: the robot waits in STANDBY for them. Ctrl-C reaches the command too, which stops the
    motors and ends its log; it is waited for, never killed."""
    process = subprocess.Popen(command_line(words), env=environment())
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.wait()
        raise


def read_trial(log: Path, task: Task, exit_code: int = 0) -> Trial:
    """The periods in which the robot moved, at most the task's; fewer where it stopped before."""
    states, commands = [f"mean.{name}" for name in task.states], task.commands
    rows: list[Numbers] = []
    status = "no row"
    try:
        with open(log, encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                status = f"{row['state']}, {row['status']}"
                if row["state"] == "ACTIVE":
                    rows.append(np.array([float(row[name]) for name in (*states, *commands)]))
                elif rows:
                    break
    except FileNotFoundError:
        status = "no log"
    except (OSError, KeyError, ValueError) as problem:
        raise TrialFailed(f"{log}: {problem}; tiller run ended with {exit_code}", status="command_failed") from problem
    table = np.array(rows[:task.horizon + 1]).reshape(-1, task.nx + task.nu)
    if len(table) < LEAST_PERIODS or not np.isfinite(table).all():
        raise TrialFailed(f"{log}: the robot did not move for two periods ({status}); tiller run ended with "
                          f"{exit_code}. Try the robot file by hand: tiller run FILE", status="command_failed")
    measured = table[:, :task.nx]
    return Trial(measured, measured, table[:-1, task.nx:])
