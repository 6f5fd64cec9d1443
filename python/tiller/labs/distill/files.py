"""What `tiller distill` prints and writes."""
from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from ... import _core
from ..output import replace_file
from .course import Distilled
from .options import Options
from .teacher import policy_text, text_of


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def table(result: Distilled) -> str:
    lines = ["round   samples   error   cost over the teacher's"]
    for k, one in enumerate(result.rounds):
        error = f"{one.errors.held_out:.3f}" if math.isfinite(one.errors.held_out) else "-"
        lines.append(f"{k + 1:5d} {one.samples:9d} {error:>7s}   {one.cost_ratio:.3f}"
                     + ("   kept" if k == result.best else ""))
    if result.tests:
        safe, teacher = (sum(getattr(t, who) for t in result.tests) for who in ("policy_safe", "teacher_safe"))
        lines.append(f"held-out draws, whole controllers: cost over the teacher's {result.held_out_ratio:.3f}; SAFE in "
                     f"{safe} of {len(result.tests)} (teacher: {teacher})")
    return "\n".join(lines) + "\n"


def report(robot: _core.Robot, teacher: str, o: Options, result: Distilled) -> dict[str, Any]:
    """What the page is drawn from."""
    rounds = [{"samples": r.samples, "epochs": r.errors.epochs, "error_trained": _number(r.errors.trained),
               "error_held_out": _number(r.errors.held_out), "cost_ratio": _number(r.cost_ratio)}
              for r in result.rounds]
    tests = [{**vars(t), "teacher_cost": _number(t.teacher_cost), "policy_cost": _number(t.policy_cost)}
             for t in result.tests]
    network = result.policy["network"]
    return {"robot": robot.name, "robot_file": robot.path, "tiller": _core.version(), "teacher": teacher,
            "hidden": o.hidden, "inputs": network["inputs"], "weights": len(network["weights"]),
            "episodes": o.episodes, "seconds": o.seconds, "best_round": result.best + 1, "rounds": rounds,
            "held_out": tests, "held_out_cost_ratio": _number(result.held_out_ratio) if tests else None}


def write_policy_robot(robot: _core.Robot, teacher: str, policy: Path) -> Path:
    """ROBOT_policy.toml beside the robot file; it names the policy relatively where both lie in one folder."""
    source = Path(robot.path)
    out = source.with_name(source.stem + "_policy.toml")
    beside = policy.absolute().parent == out.absolute().parent
    text = policy_text(text_of(robot), teacher, policy.name if beside else str(policy.absolute()))
    _core.Robot.from_text(text, str(out))
    replace_file(out, text)
    return out


def write_all(robot: _core.Robot, teacher: str, o: Options, result: Distilled, policy: Path, page: Path | None) -> int:
    """Exit code: 2 where the policy stands, and something beside it could not be written."""
    try:
        replace_file(policy, json.dumps(result.policy, indent=1) + "\n")
        print(f"policy: {policy.absolute()}, {len(result.policy['network']['weights'])} weights")
        out = write_policy_robot(robot, teacher, policy)
        print(f"robot file: {out.absolute()}\n  next: tiller run {out} --sim")
        if page is None:
            return 0
        rows = policy.with_suffix(".report.json")
        replace_file(rows, json.dumps(report(robot, teacher, o, result), indent=1) + "\n")
        from tiller_tools import distill_report

        distill_report.write_report(rows, page)
    except Exception as problem:  # what fails here loses no result that is written already
        print(f"tiller distill: {problem}")
        return 2
    print(f"report: {page.absolute()}")
    return 0
