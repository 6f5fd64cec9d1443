"""What `tiller learn` prints and writes."""
from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import tomlkit

from ... import _core
from ..output import replace_file
from .learn import Candidate, Learnt, name_of


def table(learnt: Learnt) -> str:
    ground = learnt.ground
    lines = [f"logs: {ground.document['seconds']:.0f} s, {len(ground.forces.weight)} periods; held out: "
             f"{len(ground.before.squares)} rollouts of one second", "",
             f"{'':38s} {'error':>10s} {'of before':>10s} {'90 % hold':>12s}"]

    def row(name: str, held_out: Any, after: str = "") -> None:
        ratio = "1" if held_out is ground.before else f"{learnt.ratio(held_out):.2f}"
        lines.append(f"{name:38s} {held_out.rms_sigma:8.3g} s {ratio:>10s} {100 * held_out.covered:10.0f} %{after}")

    row("model alone", ground.before)
    if learnt.residual:
        row(f"nine weights at {ground.document['residual_joint']}", learnt.residual)
    for one in learnt.candidates:
        row(name_of(one), one.held_out,
            f"   beyond the data {one.spread_ratio:.1f} times as wide" if one.network else "")
    return "\n".join([*lines, "", "s: sensor deviations, root mean square over a second", learnt.why]) + "\n"


def report(learnt: Learnt, robot_file: str) -> dict[str, Any]:
    """learn.json: what the page is drawn from. docs/guide/learn.md has its keys."""
    d, residual = learnt.ground.document, learnt.residual
    candidates = [{"name": name_of(one), "held_out": one.held_out.document(), "ratio": learnt.ratio(one.held_out),
                   "spread_ratio": one.spread_ratio if math.isfinite(one.spread_ratio) else None,
                   "members": one.network["members"] if one.network else 0,
                   "weights": len(one.network["weights"]) if one.network else 0,
                   "effects": one.ground.document["origin"], "seen": one.seen} for one in learnt.candidates]
    return {"format": "tiller learn", "version": 1, "robot": d["robot"], "model": d["model"], "robot_file": robot_file,
            "seconds": d["seconds"], "samples": len(learnt.ground.forces.weight),
            "before": learnt.ground.before.document(),
            "fitted": {"names": d["param_names"], "values": d["params"]},
            "joints": [{key: joint[key] for key in ("name", "position", "velocity", "force")} for joint in d["joints"]],
            "residual": {**(residual.document() if residual else {}), "joint": d["residual_joint"],
                         "ratio": learnt.ratio(residual) if residual else None},
            "chosen": name_of(learnt.chosen) if learnt.chosen else "", "why": learnt.why, "candidates": candidates}


def _noisier(text: str, one: Candidate) -> str:
    """The robot file with process noise that makes the spread honest."""
    d = one.ground.document
    sd = {name: max(a, b) for name, a, b in zip(d["states"], one.process_sd, d["configured_process_sd"], strict=True)}
    document = tomlkit.parse(text)
    if any(sd.values()):
        row = tomlkit.inline_table()
        row.update({name: float(f"{value:.4g}") for name, value in sd.items() if value > 0})
        document.setdefault("noise", tomlkit.table())["process_sd"] = row
    return tomlkit.dumps(document)


def robot_text(learnt: Learnt, one: Candidate, network_file: str) -> str:
    """The old text with its comments, the parameters that the choice stands on, its noise, and the choice."""
    text = _noisier(one.ground.document["robot_text"], one).rstrip("\n") + "\n"
    if one.network is None:
        return text
    return (f"{text}\n# Forces learnt by `tiller learn` from {learnt.ground.document['seconds']:.0f} s of logs: "
            f"rollouts of one second {learnt.ratio(one.held_out):.2f} times as wrong as without.\n[[effects]]\nkind = "
            f"\"{one.name}\"\n\n[network]\nfile = \"{network_file}\"\n")


def write_robot(folder: Path, stem: str, learnt: Learnt) -> Path:
    """The network, and the robot file that names it; read back. Raises OSError or tiller.Error."""
    one = learnt.chosen
    assert one
    network, path = folder / f"{stem}_network.json", folder / f"{stem}_learnt.toml"
    if one.network:
        replace_file(network, json.dumps(one.network, indent=1) + "\n")
    text = robot_text(learnt, one, network.name)
    _core.Robot.from_text(text, str(path))
    replace_file(path, text)
    return path
