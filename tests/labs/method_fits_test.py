"""Methods of `tiller identify` against the posterior of a linear system, on bad input, and in their process."""
import dataclasses
import json
import socket
import struct
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("scipy")

from method_problems import DT, NOISE, NORMAL, exact, linear_logs, problem_of, run  # noqa: E402
from problems import divergence, moments  # noqa: E402

from tiller.labs.methods.serve import METHODS  # noqa: E402
from tiller.labs.methods.settings import Settings  # noqa: E402
from tiller.labs.methods.simopt import normal_of_prior  # noqa: E402
from tiller.labs.mixture import Mixture  # noqa: E402
from tiller.labs.problem import InferenceError, Prior  # noqa: E402


# ---- posteriors and fits -----------------------------------------------------------------------------------

# With 30,000 draws the last share accepts 150. Sampling alone makes a divergence of about (d + d (d + 1) / 2) / (2 *
# 150) = .017; three times that is allowed for, and for what is left of the tolerance.
@pytest.mark.parametrize("seed", [1, 2])
def test_abc_approaches_the_exact_posterior_as_its_tolerance_falls(seed):
    logs, last = linear_logs(seed), np.inf
    for accept in (1.0, 0.1, 0.005):
        now = divergence(*exact(logs), *moments(run("abc", logs, simulations=30000, accept=accept)))
        assert now < 0.6 * last
        last = now
    assert last < 0.05


# On a linear system the regression is exact, so what remains is sampling: about 2.5 / ESS, 2.5 / 750 here. Chains and a
# population end with it too, on fewer draws that resemble each other.
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_regression_beats_rejection(seed):
    logs = linear_logs(seed)
    of = {name: divergence(*exact(logs), *moments(run(name, logs, simulations=10000, accept=0.1)))
          for name in ("abc", "abc_regression", "smc_abc", "mcmc_abc")}
    assert of["abc_regression"] < 0.2 * of["abc"] and of["abc_regression"] < 0.02
    assert of["smc_abc"] < 0.1 and of["mcmc_abc"] < 0.1


# Everything accepted is the prior itself, marginals or mixture, to the sampling error of 2.5 / 20,000.
@pytest.mark.parametrize("mixture, mean, covariance", [
    (None, [0.5, 0.5], np.eye(2)),
    # within: {.25, .15; .15, .25}; between: the means are +-(.5, 1) from theirs
    (Mixture(np.full(2, 0.5), np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([[[0.25, 0.15], [0.15, 0.25]]] * 2)),
     [0.5, 1.0], [[0.5, 0.65], [0.65, 1.25]])])
def test_everything_accepted_is_the_prior(mixture, mean, covariance):
    found = run("abc", linear_logs(4), problem_of(mixture=mixture), simulations=20000, epsilon=1e9)
    assert len(found.weight) == 20000
    assert divergence(np.array(mean), np.array(covariance), *moments(found)) < 0.001


# 40 periods whose noise leaves a tenth of what it leaves in the exact posterior above.
@pytest.mark.parametrize("name, settings", [("simopt", {}), ("simopt", {"discrepancy": "wasserstein"}),
                                            ("trajectory_simopt", {"smoothing_steps": 0.5})])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_simopt_finds_the_system_and_shrinks_whatever_the_logs_tell(name, settings, seed):
    logs = linear_logs(seed, noise=0.07, steps=20 if name == "trajectory_simopt" else 1)
    found = run(name, logs, simulations=4000, iterations=8, **settings)
    # errors of steps err as the exact posterior does; sums of them, and unordered ones, several times as much
    assert np.abs(found.rounds[-1]["mean"] - [0.9, -0.3]).max() < (0.2 if name == "simopt" and not settings else 0.4)
    assert [r["kl"] for r in found.rounds] == pytest.approx([1.0] * 8, abs=1e-6)
    assert found.rounds[-1]["discrepancy"] < found.rounds[0]["discrepancy"]
    covariance = found.normal.covariance[0]
    assert (found.rounds[-1]["sd"] < 0.05).all() and np.array_equal(covariance.T, covariance)


def test_the_first_normal_is_the_priors():
    uniform = normal_of_prior(problem_of([Prior("a", "uniform", low=0.1, high=1.0), NORMAL[1]]))
    assert uniform.mean[0] == pytest.approx([0.55, 0.5])
    assert np.diag(uniform.covariance[0]) == pytest.approx([0.81 / 12, 1])
    within = np.array([[0.04, 0.024], [0.024, 0.0169]])
    two = Mixture(np.full(2, 0.5), np.array([[0.7, -0.4], [1.1, -0.4]]), np.stack([within, within]))
    both = normal_of_prior(problem_of(mixture=two))
    assert both.mean[0] == pytest.approx([0.9, -0.4])
    assert both.covariance[0] == pytest.approx(np.array([[0.08, 0.024], [0.024, 0.0169]]))


# ---- every method ------------------------------------------------------------------------------------------

SMALL = {"simulations": 2000, "iterations": 5, "accept": 0.05}


@pytest.mark.parametrize("name", METHODS)
def test_bits_weights_and_bounds(name):
    problem = problem_of([Prior("a", "log_normal", 0.5, 0.5, 0.3, 0.95), Prior("b", "normal", 0.0, 0.3, -0.35, 0.5)])
    logs = linear_logs(22)
    found, again = run(name, logs, problem, **SMALL), run(name, logs, problem, **SMALL)
    assert np.array_equal(found.v, again.v) and np.array_equal(found.weight, again.weight)
    problem.seed = 2
    assert not np.array_equal(found.v, run(name, logs, problem, **SMALL).v)
    assert (found.weight >= 0).all() and found.rounds
    a, b = found.params.T
    assert (a >= 0.3 * (1 - 1e-9)).all() and (a <= 0.95 * (1 + 1e-9)).all()
    assert (b >= -0.35 - 1e-9).all() and (b <= 0.5 + 1e-9).all()


# Half of the prior diverges: those have no weight, and what is left is as good as ever.
@pytest.mark.parametrize("name", METHODS)
def test_candidates_that_diverge_do_not_poison(name):
    found = run(name, linear_logs(23, noise=0.05, wall=1.1), **SMALL)
    assert found.failed > 100 and np.isfinite(found.params).all() and np.isfinite(found.weight).all()
    assert not (found.weight[found.params[:, 0] > 1.1].any() and name == "reps")
    assert abs(found.rounds[-1]["mean"][0] - 0.9) < (1.0 if name == "reps" else 0.3)
    with pytest.raises(InferenceError, match="finite"):
        run(name, linear_logs(24, wall=-100), **SMALL)


# Three of four rows lost: what is left in pairs still serves.
@pytest.mark.parametrize("name", METHODS)
def test_missing_values_are_left_out(name):
    logs = linear_logs(27, noise=0.3, periods=160)
    logs.state[np.arange(160) % 4 > 0, 0] = np.nan
    assert np.isfinite(run(name, logs, **SMALL).rounds[-1]["mean"]).all()


def test_what_cannot_be_is_refused():
    with pytest.raises(InferenceError, match="--l1 0, --l2 0"):
        run("simopt", linear_logs(3), weight_l2=0.0)
    for name in ("abc", "abc_regression"):
        with pytest.raises(InferenceError, match="raise --epsilon"):
            run(name, linear_logs(29), epsilon=1e-9, **SMALL)


# ---- the process -------------------------------------------------------------------------------------------

def block(channel):
    return channel.recv(struct.unpack("=Q", channel.recv(8, socket.MSG_WAITALL))[0], socket.MSG_WAITALL)


def asked(channel, told, table, simulate):
    """As tools/identify/laboratory.cpp holds it: (document, draws), or the refusal."""
    for part in (json.dumps(told).encode(), table.tobytes()):
        channel.sendall(struct.pack("=Q", len(part)) + part)
    document = None
    while True:
        kind, content = channel.recv(1), block(channel)
        if kind == b"s":
            params = np.frombuffer(content).reshape(-1, 2)
            lanes = np.concatenate([params, np.repeat(params[-1:], 64 - len(params), axis=0)])
            channel.sendall(simulate(lanes).tobytes())
        elif kind == b"r":
            document = json.loads(content)
        else:
            return (document, np.frombuffer(content).reshape(-1, 3)) if kind == b"d" else content.decode()


def test_a_process_answers_one_fit_after_the_other_and_ends_with_its_owner():
    logs = linear_logs(5)
    table = np.column_stack([logs.rollout, logs.period, logs.inputs, logs.start, logs.start_sd, logs.state,
                             logs.state_sd])
    options = {f.name: None for f in dataclasses.fields(Settings)} | {
        "simulations": 500, "iterations": 2, "kl": 1.0, "accept": 0.1, "discrepancy": "residual", "smoothing_steps": 0}
    told = {"method": "reps", "seed": 1, "period_s": DT, "angle": [False] * 2, "input_count": 2,
            "process_sd": [NOISE] * 2, "prior_mixture": None, "options": options,
            "parameters": [{"name": n, "unit": "", "kind": "normal", "numbers": [0.5, 1.0, None, None]} for n in "ab"]}
    here, there = socket.socketpair()
    words = [sys.executable, "-m", "tiller.labs", "--methods"]
    with subprocess.Popen(words, stdin=there, stdout=sys.stderr) as process:
        there.close()
        with here:
            here.settimeout(300)
            document, draws = asked(here, told, table, logs.simulate)
            own = run("reps", logs, simulations=500)
            assert np.array_equal(draws, np.column_stack([own.params, own.weight]))
            assert document["simulations"] == 500 and document["iterations"][0]["kl"] == pytest.approx(1, abs=1e-6)
            narrow = told | {"method": "abc", "options": options | {"epsilon": 1e-9}}
            assert "raise --epsilon" in asked(here, narrow, table, logs.simulate)
            document, draws = asked(here, told | {"method": "simopt"}, table, logs.simulate)
            assert len(document["mean"]) == 2 and len(document["covariance"]) == 4 and len(draws) == 1024
        assert process.wait(60) == 0
