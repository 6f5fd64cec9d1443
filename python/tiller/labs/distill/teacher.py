"""The teacher's and the policy's robot: the robot file's text with another planner."""
from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ... import _core
from ..._errors import Error, RobotFileError
from ..closed_loop import Outcome, play
from ..robot_text import with_words
from .belief import Array

ROLLOUTS, ITERATIONS = 512, 4  # of a sampling teacher at least: more samples agree better on one answer


def text_of(robot: _core.Robot) -> str:
    return Path(robot.path).read_text(encoding="utf-8")


def _with(robot: _core.Robot, text: str, **planner: Any) -> _core.Robot:
    return _core.Robot.from_text(with_words(text, {"planner": planner}), robot.path)


def with_teacher(robot: _core.Robot, kind: str = "", *, as_it_is: bool = False) -> _core.Robot:
    """The robot with this planner, "": its own. A sampling planner plans in closed loop with more rollouts and
    iterations, for its gains answer around each state too; `as_it_is`: as [planner] has it."""
    kind = kind or _core.training_facts(robot)["planner"]
    if kind == "policy":
        raise Error("the teacher is a policy already; name a planner with --teacher (tiller help planner lists them)",
                    status="bad_planner")
    text = text_of(robot)
    try:
        teacher = _with(robot, text, kind=kind)
    except RobotFileError as problem:
        raise Error(f"--teacher {kind}: {problem}", status="bad_planner") from problem
    facts = _core.training_facts(teacher)
    if as_it_is or not facts["feedback_if_closed"]:
        return teacher
    try:
        return _with(robot, text, kind=kind, closed_loop=True, rollouts=max(ROLLOUTS, facts["rollouts"]),
                     iterations=max(ITERATIONS, facts["iterations"]))
    except RobotFileError:  # a file that takes no closed loop
        return teacher


def policy_text(text: str, teacher: str, file: str) -> str:
    """The robot file's text under the policy of this file, with the teacher as its fallback."""
    return with_words(text, {"planner": {"kind": "policy", "fallback": teacher}, "policy": {"file": file}})


def with_policy(robot: _core.Robot, document: dict[str, Any]) -> _core.Robot:
    """The robot under the policy, without a fallback."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        return _core.Robot.from_text(policy_text(text_of(robot), "policy", str(path)), robot.path)


def held_out_params(robot: _core.Robot, seed: int) -> Array:
    """The true parameters of a held-out draw: what has a prior is drawn; NaN: as [sim] has it."""
    draw: Array = _core.draw_params(robot, seed, 1)[0]
    fixed = [prior["kind"] == "fixed" for prior in robot.priors.values()]
    return np.where(fixed, np.nan, draw) if _core.training_facts(robot)["has_sim"] else draw


def held_out(robot: _core.Robot, judge: _core.Robot, seconds: float, seed: int) -> Outcome:
    """A whole controller on the plant of [sim] (without one: the model) of this draw."""
    return play(robot, judge, seconds, seed, held_out_params(judge, seed))
