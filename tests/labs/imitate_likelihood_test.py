"""The likelihood of demonstrated inputs against dense algebra and differences; games, processes and transport whose
values are known."""
import itertools

import numpy as np
import pytest

pytest.importorskip("jax")
pytest.importorskip("equinox")
pytest.importorskip("optax")
tomlkit = pytest.importorskip("tomlkit")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
from tiller.labs.imitate.expansion import Expansion, side_by_side, windows_of  # noqa: E402
from tiller.labs.imitate.game import multiplicative_weights, projection, total_variation  # noqa: E402
from tiller.labs.imitate.process import FiniteProcess  # noqa: E402
from tiller.labs.imitate.maxent import fit_weights  # noqa: E402
from tiller.labs.imitate.sweep import Periods, information, log_likelihood, sweep, with_noise  # noqa: E402
from tiller.labs.imitate.transport import dual, primal, sinkhorn  # noqa: E402


# ---- the likelihood -----------------------------------------------------------------------------------


def linear_motion(steps, defect=0.0, side=()):
    """A linear system with two inputs; costs 1/2 h z^2 + g z for each entry of z = (x, u)."""
    def wave(i):
        return np.sin(1.3 * i + 0.2 * i * i)

    f = np.array([[[0.6 * wave(i + 5 * r + 3 * k) for i in range(5)] for r in range(3)] for k in range(steps)])
    g, h = np.zeros((4, steps, 5)), np.zeros((4, steps, 5, 5))
    end_g, end_h = np.zeros((4, steps + 1, 3)), np.zeros((4, steps + 1, 3, 3))
    for k, group in itertools.product(range(steps), range(4)):
        at = (3, 4, 0, 1)[group]
        g[group, k, at], h[group, k, at, at] = wave(7 * group + k), 1.5 + wave(group)
    end_g[3, :, 2], end_h[3, :, 2, 2] = 0.7, 3.0
    off, sides = np.zeros((steps, 3)), np.zeros((steps, 2), int)
    for k in range(steps):
        off[k, k % 3] = defect * wave(k)
    for k, i, value in side:
        sides[k, i] = value
    return Expansion(*map(jnp.asarray, (f, off, g, h, end_g, end_h, sides)))


def dense(e, w):
    """Levine and Koltun's equation 5 with gradient and Hessian by all inputs at once."""
    steps, n, m = e.slope.shape
    size = (m - n) * steps
    x, hessian, gradient = np.zeros((n, size)), np.zeros((size, size)), np.zeros(size)
    for k in range(steps):
        z = np.concatenate([x, np.eye(size)[(m - n) * k:(m - n) * (k + 1)]])
        gradient += z.T @ np.einsum("g,gi", w, e.gradient[:, k])
        hessian += z.T @ np.einsum("g,gij", w, e.hessian[:, k]) @ z
        x = np.asarray(e.slope[k]) @ z
    gradient += x.T @ np.einsum("g,gi", w, e.end_gradient[:, -1])
    hessian += x.T @ np.einsum("g,gij", w, e.end_hessian[:, -1]) @ x
    return (np.linalg.slogdet(hessian)[1] - gradient @ np.linalg.solve(hessian, gradient)
            - size * np.log(2 * np.pi)) / 2


def value_of(motions, theta, horizon=0, every=1):
    return log_likelihood(sweep(side_by_side(motions), jnp.exp(theta), windows_of(motions, horizon, every)))


def test_the_likelihood_is_that_of_all_inputs_at_once():
    motions, theta = [linear_motion(6), linear_motion(9)], np.log([1.2, 0.4, 2.0, 0.7])
    both = sum(dense(e, np.exp(theta)) for e in motions)
    assert float(value_of(motions, theta)) == pytest.approx(both, abs=1e-9)


@pytest.mark.parametrize(("defect", "side", "horizon"), [
    (0.0, (), 0), (0.3, (), 0), (0.0, ((2, 0, 1), (4, 0, -1), (4, 1, 1)), 0), (0.3, ((0, 1, 1),), 4)])
def test_slopes_and_information(defect, side, horizon):
    e, theta = [linear_motion(9, defect, side)], np.array([0.3, -0.5, 0.2, 0.9])
    slope = jax.grad(lambda t: value_of(e, t, horizon, 2))(theta)
    for i, move in enumerate(1e-5 * np.eye(4)):
        difference = (value_of(e, theta + move, horizon, 2) - value_of(e, theta - move, horizon, 2)) / 2e-5
        assert float(slope[i]) == pytest.approx(float(difference), abs=1e-6 * (1 + abs(float(difference))))

    def periods(t):
        p = sweep(side_by_side(e), jnp.exp(t), windows_of(e, horizon, 2))
        return Periods(*(a * 1.0 for a in p))

    info = information(periods(theta), jax.jacfwd(periods)(theta))
    assert np.linalg.eigvalsh(info).min() >= -1e-9


def test_pressing_harder_against_a_limit_is_no_evidence():
    values = []
    for slope in (3.0, 0.0, -3.0, -30.0, -300.0):  # downhill beyond the limit, ever steeper
        e = linear_motion(1, side=((0, 0, 1),))
        e = e._replace(gradient=e.gradient.at[0, 0, 3].set(slope), end_gradient=0 * e.end_gradient,
                       end_hessian=0 * e.end_hessian)
        values.append(float(value_of([e], np.zeros(4))))
    assert np.all(np.diff(values) >= 0) and values[-1] - values[-2] < 1e-6


@pytest.mark.parametrize("side", [(), ((2, 0, 1), (4, 0, -1), (4, 1, 1))])
def test_under_white_noise_inputs_are_normal_around_the_best_ones_and_the_scale_has_no_say(side):
    e, precision = linear_motion(9, 0.2, side), np.array([4.0, 0.3])
    values = []
    for scale in (0.0, 5.0):
        p = sweep(side_by_side([e]), jnp.exp(np.log([1.2, 0.4, 2.0, 0.7]) + scale), windows_of([e], 0, 1))
        values.append(float(log_likelihood(with_noise(p, jnp.asarray(precision)))))
    normal = (np.log(precision / (2 * np.pi)) - precision * np.asarray(p.wish)**2) / 2
    if not side:
        assert values[0] == pytest.approx(normal.sum(), abs=1e-9)
    assert values[1] == pytest.approx(values[0], abs=1e-9)


def test_noise_that_a_demonstrators_motors_have_is_no_evidence_of_the_weights():
    """Two inputs, of which one is ten times as noisy as the other for reasons of its own."""
    rng, true, sd = np.random.default_rng(3), np.array([1.0, 0.5, 2.0, 1.5]), np.array([0.01, 0.1])
    f = np.array([[1.0, 0.1, 0.0, 0.0, 0.02], [0.0, 0.95, 0.1, 0.05, 0.0], [0.0, 0.0, 0.9, 0.1, 0.1]])
    at, steps = (3, 4, 0, 1), 40

    def expansion(z, end):
        g, h = np.zeros((4, steps, 5)), np.zeros((4, steps, 5, 5))
        end_g, end_h = np.zeros((4, steps + 1, 3)), np.zeros((4, steps + 1, 3, 3))
        for group, i in enumerate(at):
            g[group, :, i], h[group, :, i, i] = z[:, i], 1.0
        for i in (0, 1):
            end_g[2 + i, -1, i], end_h[2 + i, -1, i, i] = end[i], 1.0
        return Expansion(*map(jnp.asarray, (np.tile(f, (steps, 1, 1)), np.zeros((steps, 3)), g, h, end_g, end_h,
                                            np.zeros((steps, 2), int))))

    still = expansion(np.zeros((steps, 5)), np.zeros(3))
    gain = np.asarray(sweep(side_by_side([still]), jnp.asarray(true), windows_of([still], 0, 1)).gain[:, 0])
    motions = []
    for _ in range(6):
        x, rows = rng.normal(size=3), []
        for k in range(steps):
            rows.append(np.concatenate([x, gain[k] @ x + sd * rng.normal(size=2)]))
            x = f @ rows[-1]
        motions.append(expansion(np.array(rows), x))
    worst = {}
    for noise in ("own", "entropy"):
        fit = fit_weights(motions, ["b", "c", "d"], [1.0, 1.0, 1.0], noise=noise)
        worst[noise] = max(abs(w.value / t - 1) for w, t in zip(fit.weights, true[1:], strict=True))
        if noise == "own":
            assert all(w.low < t < w.high for w, t in zip(fit.weights, true[1:], strict=True))
            assert fit.noise_sd == pytest.approx(sd, rel=0.15)
    print(worst)
    assert worst["own"] < 0.15 and worst["entropy"] > 3 * worst["own"]


# ---- games, processes, transport ----------------------------------------------------------------------


def bandit(arms):
    return lambda w: np.array(min(arms, key=lambda arm: float(w @ np.array(arm))), float)


@pytest.mark.parametrize("slip", [0.01, 0.2, 0.45])
def test_total_variation_of_two_actions_that_slip_is_the_slip(slip):
    e = total_variation(np.array([1.0, 0.0]), bandit([(1 - slip, slip), (slip, 1 - slip)]))
    assert e.value == pytest.approx(slip, abs=1e-9) and e.bound == pytest.approx(slip, abs=1e-9)


def test_projection_finds_the_nearest_point_of_a_triangle():
    e = projection(np.zeros(2), bandit([(1, 0), (0, 1), (2, 2)]), 1e-9, 500)
    assert e.value == pytest.approx(np.sqrt(0.5), abs=1e-6) and e.bound <= e.value + 1e-9


def test_multiplicative_weights_bound_the_value_from_both_sides():
    e = multiplicative_weights(np.ones(2), bandit([(2, 1), (1, 2)]), np.ones(2), 2000)
    assert 0.5 - 1e-9 <= e.value < e.bound + 0.05 and e.bound <= 0.5 + 1e-9


def two_states(discount=0.7):
    return FiniteProcess(np.array([0.2, 0.8]), np.array([[[0.9, 0.1], [0.4, 0.6]], [[0.2, 0.8], [0.5, 0.5]]]), discount)


def test_occupancies_obey_the_flow_and_the_best_is_the_best_of_all():
    p, cost = two_states(), np.array([1.0, 1.3, 0.2, 0.6])
    o = p.occupancy(np.array([[0.3, 0.7], [1, 0]]))
    assert o.sum() == pytest.approx(1) and p.flow() @ o == pytest.approx(0.3 * p.start)
    every = [cost @ p.occupancy(np.eye(2)[list(choice)]) for choice in itertools.product((0, 1), repeat=2)]
    assert cost @ p.best_occupancy(cost) == pytest.approx(min(every), abs=1e-12)


def test_the_unrestricted_reward_is_one_linear_program():
    """The game over every reward within the box, its planner in turn, and one program over occupancies agree."""
    p, demonstrated = two_states(), np.array([0.0, 0.1, 0.0, 0.9])
    least, occupancy = p.least_total_variation(demonstrated)
    assert p.flow() @ occupancy == pytest.approx(0.3 * p.start)
    assert total_variation(demonstrated, p.best_occupancy).value == pytest.approx(least, abs=1e-9)
    assert p.least_total_variation(p.occupancy(np.full((2, 2), 0.5)))[0] == pytest.approx(0, abs=1e-12)


def test_transport_primal_and_dual_agree_and_sinkhorn_comes_near():
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(7, 1)), rng.normal(size=(7, 1))
    cost, even = np.abs(x - y.T), np.full(7, 1 / 7)
    on_a_line = np.abs(np.sort(x[:, 0]) - np.sort(y[:, 0])).mean()  # the plan on a line is in order
    one, other = primal(cost, even, even), dual(cost, even, even)
    assert one.value == pytest.approx(on_a_line, abs=1e-12) and other.value == pytest.approx(on_a_line, abs=1e-12)
    assert other.plan.sum(0) == pytest.approx(even) and other.plan.sum(1) == pytest.approx(even)
    assert (other.f[:, None] + other.g <= cost + 1e-9).all()
    pytest.importorskip("ott")
    gaps = [sinkhorn(cost, even, even, epsilon).value - on_a_line for epsilon in (0.1, 0.01)]
    assert 0 <= gaps[1] < gaps[0] and gaps[1] < 0.01 * np.log(49)
