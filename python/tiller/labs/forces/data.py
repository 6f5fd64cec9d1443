"""What `tiller data learn` gives: smoothed states, inputs, and the forces that the model lacks."""
from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._command import run as run_tiller

Array = npt.NDArray[np.float64]
BLOCK_S = 0.5  # what is drawn, and held out, together: neighbours in time tell the same


def _rows(value: Any) -> Array:
    return np.array(value, float)


@dataclass(frozen=True)
class HeldOut:
    """Rollouts of one second from filtered states of the part that judges."""
    rms_sigma: float  # error of the members' mean, in sensor deviations
    covered: float  # share of readings at the end within the central 90 %
    squares: Array  # (rollouts) mean square error of each
    seconds: float  # that the rollouts begin in: they overlap

    @classmethod
    def of(cls, document: dict[str, Any]) -> HeldOut:
        missing = float("inf") if document["rms_sigma"] is None else document["rms_sigma"]
        return cls(missing, document["covered"], _rows(document["squares"]), document["seconds"])

    def is_better(self, than: HeldOut) -> bool:
        """Than chance would have it: the share of rollouts that are nearer, of as many independent ones as there are
        seconds, is above a half by 1.64 deviations (one-sided 5 %)."""
        if not len(than.squares):
            return False
        share = float((self.squares < than.squares).mean())
        return share - 0.5 > 1.64 * 0.5 / max(than.seconds, 1.0) ** 0.5

    def document(self) -> dict[str, float]:
        return {"rms_sigma": self.rms_sigma, "covered": self.covered, "rollouts": len(self.squares)}


@dataclass(frozen=True)
class Forces:
    """Periods of logs: states (nx, n), inputs (nu, n), forces (nf, n) with variance; weight (n) 0 where the smoother
    had only begun."""
    state: Array
    input: Array
    force: Array
    variance: Array
    weight: Array

    @classmethod
    def of(cls, document: dict[str, Any]) -> Forces:
        return cls(*(_rows(document[key]) for key in ("state", "input", "force", "variance", "weight")))


@dataclass(frozen=True)
class Ground:
    """A robot file that forces are learnt beside."""
    path: Path
    document: dict[str, Any]
    forces: Forces
    before: HeldOut

    @classmethod
    def read(cls, path: Path) -> Ground:
        document = json.loads(path.read_text(encoding="utf-8"))
        return cls(path, document, Forces.of(document.pop("forces")), HeldOut.of(document["before"]))

    def features(self, forces: Forces) -> Array:
        """(inputs, n) as a network of forces reads them: joint by joint the position, of an angle sine and cosine, and
        the velocity; then the inputs."""
        rows = []
        for joint in self.document["joints"]:
            if joint["position"]:
                q = forces.state[self.document["states"].index(joint["position"])]
                rows += [np.sin(q), np.cos(q)] if joint["angle"] else [q]
            rows.append(forces.state[self.document["states"].index(joint["velocity"])])
        return np.array([*rows, *forces.input])


@dataclass(frozen=True)
class Beside:
    """What is left beside a network, and what rollouts with it come to."""
    forces: Forces
    force_sd: list[float]
    held_out: HeldOut
    process_sd: list[float]


class Logs:
    """Robot file and logs, as tiller's own command reads them: no format has two readers."""

    def __init__(self, robot: Path, logs: Sequence[str], hold_out: float, folder: Path) -> None:
        self.robot, self.logs, self.hold_out, self.folder = robot, logs, hold_out, folder
        self._count = 0

    def _ask(self, *words: str) -> Path:
        self._count += 1
        out = self.folder / f"{self._count}.json"
        run_tiller(["data", "learn", str(self.robot), *self.logs, "-o", str(out), "--hold-out", str(self.hold_out),
                    *words])
        return out

    def ground(self) -> Ground:
        return Ground.read(self._ask())

    def catalogue(self, ground: Ground, threads: int) -> Ground:
        return Ground.read(self._ask("--base", str(ground.path), "--catalogue", "--threads", str(threads)))

    def beside(self, ground: Ground, first: Ground, network: dict[str, Any], force_sd: list[float],
               everything: bool) -> Beside:
        """`first`: whose filter the judged rollouts begin in."""
        file = self.folder / "network.json"
        file.write_text(json.dumps(network), encoding="utf-8")
        out = self._ask("--base", str(ground.path), "--states-of", str(first.path), "--network", str(file),
                        "--force-sd", ",".join(map(repr, force_sd)), *(["--all"] if everything else []))
        document = json.loads(out.read_text(encoding="utf-8"))
        out.unlink()
        return Beside(Forces.of(document["forces"]), document["force_sd"], HeldOut.of(document["held_out"]),
                      document["process_sd"])


@dataclass(frozen=True)
class Samples:
    """What forces are fitted to, a row a period, in units of their deviations: x (n, inputs), y (n, nf), inverse
    variances (n, nf) of mean one over each force's periods that count, and blocks (n) of half a second."""
    x: Array
    y: Array
    weight: Array
    block: Array
    x_mean: Array
    x_sd: Array
    y_sd: Array

    @classmethod
    def of(cls, ground: Ground, forces: Forces, known: Array) -> Samples:
        """`known` (nf, n): what a network said there already, beside which the forces are left."""
        x, y, counts = ground.features(forces).T, (forces.force + known).T, forces.weight > 0
        taken = counts if counts.any() else np.ones_like(counts)
        x_mean, x_sd, y_sd = x[taken].mean(0), _deviation(x[taken]), _deviation(y[taken])
        # a force is never known better than to a hundredth of what it is at large
        weight = counts[:, None] / (forces.variance.T + 1e-4 * y_sd**2)
        weight *= counts.sum() / np.maximum(weight.sum(0), 1e-300)
        length = max(1, round(BLOCK_S / ground.document["period_s"]))
        return cls((x - x_mean) / x_sd, y / y_sd, weight, np.arange(len(x)) // length, x_mean, x_sd, y_sd)


def _deviation(x: Array) -> Array:
    """Of what never changes 1. Forces keep their mean: there is none where nothing was learnt."""
    sd = x.std(0)
    return np.where(sd > 1e-12 * (1 + np.abs(x.mean(0))), sd, 1.0)
