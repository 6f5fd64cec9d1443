"""Weights, likelihood and discrepancies of `tiller identify --method`, against values worked out by hand."""
import itertools

import numpy as np
import pytest

pytest.importorskip("scipy")

from method_problems import DT, NOISE, exact, linear_logs, logs_of, run  # noqa: E402
from scipy import stats  # noqa: E402

from tiller.labs.methods import discrepancy  # noqa: E402
from tiller.labs.methods.discrepancy import Residual, SlicedWasserstein, directions, sorted_distance  # noqa: E402
from tiller.labs.methods.reps import bounded_weights, log_likelihood, tempered_weights  # noqa: E402
from tiller.labs.problem import InferenceError  # noqa: E402


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
