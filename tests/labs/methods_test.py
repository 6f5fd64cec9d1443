"""Methods of `tiller identify --method`: against values worked out by hand, the posterior of a linear system, and bad
input. The system is dx/dt = a u + b v, dy/dt = b u - a v: linear in its parameters, and no state acts on it."""
import dataclasses
import itertools
import json
import socket
import struct
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("scipy")

from problems import divergence, moments  # noqa: E402
from scipy import stats  # noqa: E402

from tiller.labs.methods import discrepancy  # noqa: E402
from tiller.labs.methods.discrepancy import Residual, SlicedWasserstein, directions, sorted_distance  # noqa: E402
from tiller.labs.methods.logs import Logs  # noqa: E402
from tiller.labs.methods.reps import bounded_weights, log_likelihood, tempered_weights  # noqa: E402
from tiller.labs.methods.serve import METHODS  # noqa: E402
from tiller.labs.methods.settings import Settings  # noqa: E402
from tiller.labs.methods.simopt import normal_of_prior  # noqa: E402
from tiller.labs.mixture import Mixture  # noqa: E402
from tiller.labs.problem import InferenceError, Prior, Problem  # noqa: E402

DT, NOISE = 0.1, 0.7
NORMAL = [Prior("a", "normal", 0.5, 1.0), Prior("b", "normal", 0.5, 1.0)]


def problem_of(priors=NORMAL, seed=1, mixture=None):
    return Problem("logs", priors, [], np.zeros(0), np.array([0]), np.zeros((1, 0)), np.zeros((1, 0)), np.zeros((1, 1)),
                   lambda *_: None, seed, mixture)


def logs_of(state, inputs, steps=1, process_sd=NOISE, sensor_sd=0.0, angle=(False, False), wall=np.inf):
    """Logged states (points, 2) and inputs (points - 1, 2), cut to rollouts of so many periods (0: one). A candidate
    whose a is beyond the wall diverges."""
    state, inputs = np.asarray(state, float), np.asarray(inputs, float)
    begin = np.arange(len(inputs)) // (steps or len(inputs)) * (steps or len(inputs))
    rows = np.arange(len(inputs))

    def simulate(params):
        a, b = params[:, 0], params[:, 1]
        rate = np.stack([inputs[:, :1] * a + inputs[:, 1:] * b, inputs[:, :1] * b - inputs[:, 1:] * a], axis=1)
        way = np.concatenate([np.zeros((1, 2, len(params))), np.cumsum(DT * rate, axis=0)])
        states = state[begin][..., None] + way[rows + 1] - way[begin]
        return np.where(a > wall, np.nan, states)

    doubt = np.full((len(inputs), 2), sensor_sd)
    return Logs(begin, rows - begin + 1.0, inputs, state[begin], doubt, state[1:].copy(), doubt, np.array(angle),
                np.full(2, process_sd), DT, 64, simulate)


def linear_logs(seed, noise=NOISE, periods=40, truth=(0.9, -0.3), **more):
    rng = np.random.default_rng([seed, 300])
    inputs = np.repeat(rng.normal(size=(periods // 5 + 1, 2)), 5, axis=0)[:periods]
    inputs /= (inputs**2).mean() ** 0.5  # 40 periods leave a posterior about a quarter as wide as the prior
    a, b = truth
    rate = np.stack([a * inputs[:, 0] + b * inputs[:, 1], b * inputs[:, 0] - a * inputs[:, 1]], axis=1)
    change = DT * rate + noise * DT**0.5 * rng.normal(size=rate.shape)
    return logs_of(np.cumsum(np.concatenate([np.zeros((1, 2)), change]), axis=0), inputs, process_sd=noise, **more)


def exact(logs, eta=1.0):
    """Mean and covariance by the normal equations; the likelihood counts 1 / eta times."""
    variance = eta * (logs.process_sd[0] ** 2 * DT + 2 * logs.state_sd[0, 0] ** 2)
    u, v = logs.inputs.T
    design = DT * np.concatenate([np.stack([u, v], axis=1), np.stack([-v, u], axis=1)])
    change = (logs.state - logs.start).T.reshape(-1)
    covariance = np.linalg.inv(np.eye(2) + design.T @ design / variance)
    return covariance @ (np.full(2, 0.5) + design.T @ change / variance), covariance


def run(name, logs, problem=None, **settings):
    return METHODS[name](problem or problem_of(), logs, Settings(**settings))


# ---- weights by relative entropy ---------------------------------------------------------------------------

@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("bound", [1e-3, 0.5, 1.0, 4.0])
def test_the_divergence_is_the_bound_and_the_dual_is_least(scale, bound):
    cost = scale * (3 + np.random.default_rng(7).uniform(size=500) ** 3)
    found = bounded_weights(cost, bound)
    held = found.weight[found.weight > 0]
    assert held @ np.log(500 * held) == pytest.approx(bound, abs=1e-6) and found.kl == pytest.approx(bound, abs=1e-6)
    assert found.weight.sum() == pytest.approx(1)

    def dual(eta):
        return eta * bound + eta * np.log(np.mean(np.exp(-(cost - cost.min()) / eta)))
    assert dual(found.temperature) < min(dual(0.95 * found.temperature), dual(1.05 * found.temperature))
    assert np.allclose(bounded_weights(1e4 + 1e3 * cost / scale, bound).weight, found.weight, atol=1e-9)


def test_a_slack_bound_takes_the_cheapest_and_equal_costs_weigh_alike():
    assert np.allclose(bounded_weights(np.full(40, 7.5), 1.0).weight, 1 / 40)
    cost = np.random.default_rng(10).uniform(size=64)
    cost[[3, 9]] = -1
    found = bounded_weights(cost, np.log(64))
    assert found.temperature == 0 and found.kl == pytest.approx(np.log(32))
    assert found.weight[3] == found.weight[9] == 0.5


def test_costs_that_are_not_finite_do_not_poison():
    cost = np.random.default_rng(11).uniform(size=100)
    found = bounded_weights(np.insert(cost, 50, [np.nan, np.inf, -np.inf]), 1.0)
    assert np.array_equal(np.delete(found.weight, [50, 51, 52]), bounded_weights(cost, 1.0).weight)
    assert not found.weight[50:53].any()
    with pytest.raises(InferenceError, match="finite"):
        bounded_weights(np.array([np.nan, np.inf]), 1.0)
    huge = tempered_weights(np.array([1e308, -np.inf, np.nan, 1e308 * (1 - 1e-15)]), 1.0)
    assert huge.weight[0] == 1 and not huge.weight[1:].any()


# ---- the likelihood ----------------------------------------------------------------------------------------

@pytest.mark.parametrize("sensor_sd", [0.0, 0.2])
def test_the_likelihood_is_a_sum_of_normal_log_densities(sensor_sd):
    logs = linear_logs(1, sensor_sd=sensor_sd)
    params = np.array([[0.9, -0.3], [0.2, 1.4]])
    sd = (NOISE**2 * DT + 2 * sensor_sd**2) ** 0.5
    by_hand = stats.norm.logpdf(logs.errors(logs.simulate(params)), scale=sd).sum(axis=(0, 1))
    assert np.allclose(log_likelihood(logs, params), by_hand, rtol=1e-9)


# On a grid that holds all of the posterior the trapezoidal rule errs by exp(-2 pi^2 8^2): what is left is rounding.
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("eta", [1.0, 0.5, 3.0])
def test_reps_at_a_temperature_is_the_conjugate_posterior(seed, eta):
    logs = linear_logs(seed, sensor_sd=0.2)
    mean, covariance = exact(logs, eta)
    axes = [m + s * np.arange(-72, 73) / 8 for m, s in zip(mean, np.sqrt(np.diag(covariance)))]
    v = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    base = np.exp(-0.5 * ((v - 0.5) ** 2).sum(axis=1))
    weight = tempered_weights(log_likelihood(logs, v), eta, base).weight
    off = v - weight @ v
    assert np.allclose(weight @ v, mean, atol=1e-6)
    assert np.allclose(off.T @ (weight[:, None] * off), covariance, atol=1e-6)


# A draw from the prior weighs posterior over prior, up to one constant.
def test_each_draw_weighs_posterior_over_prior():
    logs = linear_logs(4, sensor_sd=0.1)
    found = run("reps", logs, simulations=3000, eta=2.5)
    posterior = stats.multivariate_normal(*exact(logs, 2.5)).logpdf(found.v)
    held = found.weight > 1e-200  # far from the smallest double, whose logarithm is inexact
    constant = np.log(found.weight[held]) - posterior[held] - 0.5 * ((found.v[held] - 0.5) ** 2).sum(axis=1)
    assert held.sum() > 2900 and np.ptp(constant) < 1e-6 and found.rounds[-1]["temperature"] == 2.5


# ---- discrepancies -----------------------------------------------------------------------------------------

# a = 1, b = 2 moves by (.1, .2) and (.4, .3): from logged states errors are (-.2, .1) and (.6, .6), along a rollout
# (-.2, .1) and (.4, .7).
STATE, INPUTS, CANDIDATE = [[0, 0], [0.3, 0.1], [0.1, -0.2]], [[1, 0], [2, 1]], np.array([[1.0, 2.0]])


@pytest.mark.parametrize("steps, l1, l2, scale, wanted", [
    (1, 0, 1, False, 0.77 / 2), (1, 1, 0, False, 1.5 / 2), (1, 0.5, 3, False, 0.5 * 0.75 + 3 * 0.385),
    # root mean square changes: x .3 and -.2, mean square .065; y .1 and -.3, mean square .05
    (1, 0, 1, True, (0.40 / 0.065 + 0.37 / 0.05) / 2), (1, 2, 0, True, 0.8 / 0.065**0.5 + 0.7 / 0.05**0.5),
    # displacements from the start: x .3 and .1, y .1 and -.2
    (0, 0, 1, False, 0.70 / 2), (0, 0, 1, True, (0.20 / 0.05 + 0.50 / 0.025) / 2)])
def test_residuals_are_those_worked_out_by_hand(steps, l1, l2, scale, wanted):
    logs = logs_of(STATE, INPUTS, steps)
    assert Residual(logs, l1, l2, scale, 0.0)(logs.simulate(CANDIDATE))[0] == pytest.approx(wanted, abs=1e-12)


def test_a_filter_averages_errors_over_a_rollout():
    logs = logs_of(STATE, INPUTS, 0)
    tap = np.exp(-0.5 / 2.25)
    x, y = (np.array([e[0] + tap * e[1], e[1] + tap * e[0]]) / (1 + tap) for e in ((-0.2, 0.4), (0.1, 0.7)))
    found = Residual(logs, 0, 1, False, 1.5)(logs.simulate(CANDIDATE))[0]
    assert found == pytest.approx((x @ x + y @ y) / 2, abs=1e-12)


def test_angles_go_the_short_way_round():
    plain, turned = np.array(STATE, float), np.array(STATE, float)
    turned[1, 0] += 2 * np.pi
    values = [Residual(logs, 1, 1, False, 0.0)(logs_of(STATE, INPUTS).simulate(CANDIDATE))[0]
              for logs in (logs_of(s, INPUTS, angle=(True, False)) for s in (plain, turned))]
    assert values[0] == pytest.approx(values[1], rel=1e-9) and values[0] > 0


def test_wasserstein_on_a_line_is_the_best_of_all_assignments():
    rng = np.random.default_rng(7)
    for n in (1, 2, 5, 7):
        a, b = rng.normal(size=(2, n))
        best = min(np.abs(a - b[list(p)]).mean() for p in itertools.permutations(range(n)))
        assert sorted_distance(a, b) == pytest.approx(best, abs=1e-12)
    a, b = rng.normal(size=(2, 1000))
    assert sorted_distance(a, b) == pytest.approx(stats.wasserstein_distance(a, b), abs=1e-12)


def test_directions_are_fixed_unit_vectors_on_all_sides():
    found = directions(64, 3)
    assert np.array_equal(found, directions(64, 3)) and np.allclose(np.linalg.norm(found, axis=1), 1)
    assert np.abs(found.mean(axis=0)).max() < 0.29  # four deviations of a mean of 64: 4 / sqrt(3 * 64)


@pytest.mark.parametrize("scale", [False, True])
def test_sliced_wasserstein_is_the_mean_over_slices(scale):
    logs = linear_logs(3, periods=6)
    logs.process_sd = np.zeros(2)  # of simulated periods
    moved = logs.simulate(np.array([[-1.0, 2.0]]))[..., 0] - logs.start
    context = np.concatenate([logs.start, logs.inputs], axis=1)
    divide = np.concatenate([(logs.moved**2).mean(axis=0), context.var(axis=0)]) ** 0.5 if scale else np.ones(6)
    slices = directions(discrepancy.DIRECTIONS, 6).T
    sets = [np.concatenate([d, context], axis=1) / divide @ slices for d in (moved, logs.moved)]
    wanted = np.mean([stats.wasserstein_distance(a, b) for a, b in zip(*(s.T for s in sets))])
    assert SlicedWasserstein(logs, scale)(logs.simulate(np.array([[-1.0, 2.0]])))[0] == pytest.approx(wanted, abs=1e-12)


# Noise of .22 a period beside a motion of .09: a model that moves more would be spread as the logs are, if simulated
# periods had no noise.
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_of_the_logs_is_not_taken_for_motion(seed):
    logs = linear_logs(seed, periods=1600)
    states = logs.simulate(np.array([[0.9, -0.3], [1.6 * 0.9, -1.6 * 0.3]]))
    with_noise = SlicedWasserstein(logs, True)(states)
    logs.process_sd = np.zeros(2)
    without = SlicedWasserstein(logs, True)(states)
    assert with_noise[0] < with_noise[1] and without[0] > without[1]


# Displacements alone would be distributed alike for (a, b) and (-a, -b): inputs come in pairs of opposite sign.
def test_answers_to_opposite_inputs_are_told_apart():
    u = np.repeat(1 + 0.1 * np.arange(20), 2) * np.tile([1, -1], 20)
    inputs = np.stack([u, np.zeros(40)], axis=1)
    state = np.cumsum(np.concatenate([np.zeros((1, 2)), DT * u[:, None] * [0.9, -0.3]]), axis=0)
    logs = logs_of(state, inputs, process_sd=0.0)
    states = logs.simulate(np.array([[0.9, -0.3], [-0.9, 0.3], [0.8, -0.3]]))
    own, opposite, near = SlicedWasserstein(logs, True)(states)
    assert own == pytest.approx(0, abs=1e-12) and opposite > 0.1 and opposite > 3 * near > 0.003


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
