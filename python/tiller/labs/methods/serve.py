"""The process that `tiller identify` and `tiller run` ask for fits, one after the other."""
from __future__ import annotations

import json
import os
import signal
import socket
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..problem import Array, InferenceError, Problem, prior_of
from ..result import Inferred, effective, normalised
from . import reps, simopt, steps
from .logs import Logs
from .settings import Settings
from .wire import LANES, Gone, Wire

Fit = Callable[[Problem, Logs, Settings], Inferred]

# tools/identify/methods.def has the same names, the posterior before them
METHODS: Mapping[str, Fit] = {"reps": reps.fit, "simopt": simopt.one_step, "trajectory_simopt": simopt.trajectory} | {
    name: partial(steps.fit, method=name) for name in ("abc", "abc_regression", "smc_abc", "mcmc_abc")}


def _no_box(*_: Any) -> Any:
    raise NotImplementedError  # what is simulated is asked for by Logs


def read_problem(told: dict[str, Any]) -> Problem:
    """Priors and seed alone; the logs are apart."""
    priors, mixture = prior_of(told)
    return Problem("logs", priors, [], np.zeros(0), np.array([0]), np.zeros((1, 0)), np.zeros((1, 0)),
                   np.zeros((1, 1)), _no_box, told["seed"], mixture)


def read_logs(told: dict[str, Any], wire: Wire) -> Logs:
    states, inputs = len(told["angle"]), told["input_count"]
    table = np.frombuffer(wire.block()).reshape(-1, 2 + inputs + 4 * states)

    def simulate(params: Array) -> Array:
        wire.send("s", np.ascontiguousarray(params).tobytes())
        return wire.numbers((len(table), states, LANES))

    return Logs.of_table(table, inputs, told["angle"], told["process_sd"], told["period_s"], LANES, simulate)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def document(result: Inferred) -> dict[str, Any]:
    iterations = [{"mean": r["mean"].tolist(), "sd": r["sd"].tolist(), "effective_samples": r["effective_samples"],
                   **{key: _finite(r.get(key, np.nan))
                      for key in ("temperature", "kl", "discrepancy", "smallest_discrepancy")}} for r in result.rounds]
    normal = result.normal
    return {"iterations": iterations, "simulations": result.simulations, "diverged": result.failed,
            # of SimOpt those of its last candidates: the draws of its normal all count alike
            "effective_samples": result.rounds[-1]["effective_samples"] if normal else effective(result.weight),
            "mean": normal.mean[0].tolist() if normal else None,
            "covariance": normal.covariance[0].reshape(-1).tolist() if normal else None}


def _answer(wire: Wire, told: dict[str, Any]) -> None:
    logs = read_logs(told, wire)
    try:
        result = METHODS[told["method"]](read_problem(told), logs, Settings.of_json(told["options"]))
    except InferenceError as refused:
        wire.send("e", str(refused).encode())
        return
    wire.send_json("r", document(result))
    wire.send("d", np.column_stack([result.params, normalised(result.weight)]).tobytes())


def serve() -> int:
    """Standard input is a socket for both ways. Ctrl-C is the other process's: this one ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wire = Wire(socket.socket(fileno=os.dup(0)))
    try:
        while True:
            _answer(wire, json.loads(wire.block()))
    except Gone:
        return 0
