"""What a search leaves beside the policy: the numbers of its page."""
from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from ... import _core
from ..output import replace_file
from .search import SearchResult, SearchStep
from .task import Task


def _rows(values: Any) -> list[list[float | None]]:
    """By state; null: not finite."""
    return [[float(v) if math.isfinite(v) else None for v in row] for row in np.asarray(values).T]


def _trial(step: SearchStep) -> dict[str, Any]:
    f = step.forecast
    sd = None if f is None else np.sqrt(np.maximum(0, np.diagonal(f.covariance, axis1=1, axis2=2)))
    return {"predicted": step.predicted if math.isfinite(step.predicted) else None, "cost": step.cost,
            "seconds": step.seconds, "state": _rows(step.trial.truth), "command": _rows(step.trial.command),
            "forecast_mean": [] if f is None else _rows(f.mean), "forecast_sd": [] if sd is None else _rows(sd)}


def search_document(task: Task, result: SearchResult, robot: _core.Robot, method: str, kind: str) -> dict[str, Any]:
    units = _core.training_facts(robot)["units"]
    return {"format": "tiller policy search", "version": 1, "robot": robot.path, "method": method, "kind": kind,
            "period_s": task.period_s, "states": task.states, "commands": task.commands, "units": units,
            "command_units": units, "horizon": task.horizon, "trials": [_trial(step) for step in result.steps]}


def write_page(page: Path, document: dict[str, Any]) -> None:
    """The page and, beside it, the numbers that it is drawn from, under a name of their own: the policy may lie beside
    the page under the same one. Raises OSError, ImportError and what the page's module raises."""
    numbers = page.with_name(page.stem + "_search.json")
    replace_file(numbers, json.dumps(document) + "\n")
    from tiller_tools import policy_report
    from tiller_tools.table import read_json
    from tiller_tools.table import write_page as write

    write(str(page), policy_report.build(read_json(str(numbers))))
