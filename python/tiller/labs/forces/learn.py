"""Candidates for what a model lacks, judged on what none of them has seen."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ... import _core
from ..._errors import CommandError
from . import ensemble, process
from .data import Array, Beside, Forces, Ground, HeldOut, Logs, Samples
from .encoder import find_eccentricity
from .network import document, evaluate
from ..forces_options import Options

SEEN_EVERY = 20  # periods, of what is shown and of what the spread is taken of
Tell = Callable[[str], None]


@dataclass
class Candidate:
    """What one form came to: effects, or forces on top of `ground`."""
    name: str  # "catalogue", "network", "gaussian_process"
    ground: Ground
    held_out: HeldOut
    process_sd: list[float]  # that makes the held-out spread honest
    network: dict[str, Any] | None = None
    spread_ratio: float = float("nan")  # of the members' forces outside of the data, over inside
    seen: dict[str, list[float]] = field(default_factory=dict)  # some periods: state, force that lacks, members


@dataclass
class Learnt:
    ground: Ground
    candidates: list[Candidate]
    chosen: Candidate | None
    why: str  # a sentence: of the choice, or of the refusal

    def ratio(self, held_out: HeldOut) -> float:
        return held_out.rms_sigma / self.ground.before.rms_sigma

    @property
    def residual(self) -> HeldOut | None:
        """The nine local weights at one joint, from the same part of the logs."""
        return HeldOut.of(self.ground.document["residual"]) if self.ground.document["residual_joint"] else None


class Course:
    def __init__(self, logs: Logs, options: Options, tell: Tell) -> None:
        self.logs, self.o, self._tell = logs, options, tell

    def run(self) -> Learnt:
        """Raises CommandError where the logs cannot answer. A refusal is no error."""
        self._tell("reading and smoothing the logs")
        plain = self.logs.ground()
        learnt = Learnt(plain, [], None, "")
        stands_on = self._effects(learnt) if self.o.catalogue else plain
        for form in ("network", "gaussian"):
            if self.o.form in ("auto", form):
                self._add(learnt, form, stands_on)
        _choose(learnt, self.o)
        self._doubt(learnt)
        if learnt.chosen and learnt.chosen.network:
            self._learn_from_all(learnt.chosen, plain)
        return learnt

    def _effects(self, learnt: Learnt) -> Ground:
        """What the forces stand on: the robot with the effects that have earned their place, or without."""
        self._tell("looking through the catalogue of effects")
        try:
            ground = self.logs.catalogue(learnt.ground, self.o.threads)
        except CommandError:  # none helps
            return learnt.ground
        learnt.candidates.append(Candidate("catalogue", ground, ground.before, ground.document["process_sd"]))
        return ground if _earns(learnt, ground.before, learnt.ground.before, self.o) else learnt.ground

    def _doubt(self, learnt: Learnt) -> None:
        """An encoder's error is no force: what is learnt of it serves rollouts that begin at its readings alone."""
        if not learnt.chosen or "encoder_eccentricity" in learnt.chosen.ground.document["origin"]:
            return
        self._tell("asking whether an eccentric encoder explains it")
        robot = _core.Robot.from_text(learnt.ground.document["robot_text"], str(self.logs.robot))
        encoder = find_eccentricity(robot, learnt.ground)
        if encoder and encoder.ratio < learnt.ratio(learnt.chosen.held_out):
            learnt.why = (f"refused: {encoder} explains the logs better ({encoder.ratio:.2f}) than "
                          f"{name_of(learnt.chosen)} ({learnt.ratio(learnt.chosen.held_out):.2f}), and no force is "
                          "missing; mount or calibrate it anew")
            learnt.chosen = None

    def _add(self, learnt: Learnt, form: str, ground: Ground) -> None:
        try:
            network, beside = self._in_passes(form, ground, learnt.ground)
        except CommandError as problem:  # training that diverged
            self._tell(f"{form}: {problem.output.strip()}")
            return
        spread, seen = _seen(ground, network, beside.forces)
        name = "gaussian_process" if form == "gaussian" else "network"
        learnt.candidates.append(Candidate(name, ground, beside.held_out, beside.process_sd, network, spread, seen))

    def _in_passes(self, form: str, ground: Ground, first: Ground) -> tuple[dict[str, Any], Beside]:
        """Learns, smooths with what was learnt, and learns again: the walk has less to explain, and blurs less."""
        forces, force_sd, known = ground.forces, ground.document["force_sd"], np.zeros_like(ground.forces.force)
        for k in range(self.o.passes):
            self._tell(f"{form}, pass {k + 1} of {self.o.passes}")
            network = self._fit(form, ground, Samples.of(ground, forces, known))
            beside = self.logs.beside(ground, first, network, force_sd, False)
            forces, force_sd = beside.forces, beside.force_sd
            known = evaluate(network, ground.features(forces))[0]
        return network, beside

    def _fit(self, form: str, ground: Ground, samples: Samples) -> dict[str, Any]:
        o = self.o
        if form == "gaussian":
            weights, shape, _ = process.fit(samples, o.draws, o.inducing, o.seed)
            return document(ground, "gaussian", o.draws, shape, weights)
        weights = ensemble.fit(samples, o.members, o.hidden, o.steps, o.batch, o.seed)
        return document(ground, "tanh", o.members, o.hidden, weights)

    def _learn_from_all(self, chosen: Candidate, first: Ground) -> None:
        """What is given out has seen every log: its network smooths all of them first."""
        assert chosen.network
        form = "network" if chosen.name == "network" else "gaussian"
        begin = self.logs.beside(chosen.ground, first, chosen.network, chosen.ground.document["force_sd"], True)
        known = evaluate(chosen.network, chosen.ground.features(begin.forces))[0]
        self._tell(f"{form}, from everything")
        chosen.network = self._fit(form, chosen.ground, Samples.of(chosen.ground, begin.forces, known))


def _earns(learnt: Learnt, held_out: HeldOut, than: HeldOut, o: Options) -> bool:
    return held_out.rms_sigma < o.most_ratio * than.rms_sigma and held_out.is_better(than)


def _choose(learnt: Learnt, o: Options) -> None:
    """Each thing earns its place over what it stands on: effects over the model, forces over the effects."""
    residual = learnt.ratio(learnt.residual) if learnt.residual else float("inf")
    for one in learnt.candidates:
        than = learnt.ground.before if one.network is None else one.ground.before
        if not _earns(learnt, one.held_out, than, o) or (o.beat_residual and learnt.ratio(one.held_out) >= residual):
            continue
        if learnt.chosen is None or one.held_out.rms_sigma < learnt.chosen.held_out.rms_sigma:
            learnt.chosen = one
    if learnt.chosen:
        learnt.why = (f"{name_of(learnt.chosen)}: held-out rollouts of one second are "
                      f"{learnt.ratio(learnt.chosen.held_out):.2f} times as wrong as without it")
    elif not learnt.candidates:
        learnt.why = "refused: nothing could be trained"
    else:
        learnt.why = _refusal(learnt, o, residual)


def _refusal(learnt: Learnt, o: Options, residual: float) -> str:
    nearest = min(learnt.ratio(one.held_out) for one in learnt.candidates)
    why = f"refused: held-out rollouts of one second would be {nearest:.2f} times as wrong as without it, "
    if o.beat_residual and nearest >= residual and residual < o.most_ratio:
        return why + f"and nine weights at {learnt.ground.document['residual_joint']} come to {residual:.2f}"
    if nearest < o.most_ratio:
        return why + f"which {learnt.ground.before.seconds:.1f} s of rollouts do not tell from chance"
    return why + f"and {o.most_ratio:.2f} is the most that earns a place"


def name_of(one: Candidate) -> str:
    """"network on top of input_delay (torque_Nm)"."""
    effects = one.ground.document["origin"]
    if one.network is None:
        return effects or "catalogue"
    return one.name + (f" on top of {effects}" if effects else "")


def _seen(ground: Ground, network: dict[str, Any], forces: Forces) -> tuple[float, dict[str, list[float]]]:
    """The members' deviation at twice the largest velocities over that in the data, and some periods."""
    some = Forces(*(a[..., ::SEEN_EVERY] for a in vars(forces).values()))
    said = evaluate(network, ground.features(some))
    mean, sd = said.mean(0), said.std(0)
    state = some.state.copy()
    for joint in ground.document["joints"]:
        v = ground.document["states"].index(joint["velocity"])
        state[v] = np.where(state[v] >= 0, 2.0, -2.0) * np.abs(forces.state[v]).max()
    beyond = evaluate(network, ground.features(Forces(state, *list(vars(some).values())[1:]))).std(0)
    columns: dict[str, Array] = dict(zip(ground.document["states"], some.state, strict=True))
    for what, rows in (("", said[0] + some.force), ("mean ", mean), ("sd ", sd)):
        columns.update(zip([what + name for name in ground.document["network_outputs"]], rows, strict=True))
    return float(beyond.sum() / max(sd.sum(), 1e-300)), {name: list(map(float, row)) for name, row in columns.items()}
