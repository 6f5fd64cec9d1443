"""Local models against what they must come to, laws against the plain LQR, and guided searches on a plant whose best
policy is known."""
import numpy as np
import pytest

pytest.importorskip("jax")

import jax.numpy as jnp

from tiller.labs.policies.guide import Goal, Guide
from tiller.labs.policies.guided import Condition, Guided, GuidedOptions, GuidedResult, GuidedStep, guided_search
from tiller.labs.policies.laws import Law, Quadratic, expected_cost, kl_lqr, passage, soft_lqr
from tiller.labs.policies.local import Data, LinearStep, fit_mixture, fit_step, prior_of_mixture, prior_of_model
from tiller.labs.policies.local_laws import Local
from tiller.labs.policies.physics import Family
from tiller.labs.policies.plant import Trial
from tiller.labs.policies.task import Task


def slope_of(gain=1.0, friction=0.5):
    """Of a point mass that friction slows, 0.1 s a period: [position, velocity, force]."""
    return np.array([[1.0, 0.1, 0.0], [0.0, 1 - 0.1 * friction, 0.1 * gain]])


def physics_of(slope):
    return lambda z: (jnp.asarray(slope) @ z, jnp.asarray(slope))


def transitions(slope, count, noise, seed):
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((count, 3)) * [0.3, 0.3, 1.0]
    return np.hstack([z, z @ slope.T + noise * rng.standard_normal((count, 2))])


def test_without_a_prior_a_local_model_is_least_squares():
    rows = transitions(slope_of(), 12, 0.05, 3)
    step = fit_step(Data.of(rows), None, 2)
    solved = np.linalg.lstsq(np.hstack([rows[:, :3], np.ones((12, 1))]), rows[:, 3:], rcond=None)[0]
    assert np.allclose(step.slope, solved[:3].T, atol=1e-9) and np.allclose(step.offset, solved[3], atol=1e-9)


def test_a_prior_fills_in_for_few_samples_and_gives_way_to_many():
    truth, believed = slope_of(), slope_of(0.7)
    prior = prior_of_model(np.zeros(3), np.zeros(2), believed, np.diag([0.09, 0.09, 1.0]), np.zeros(2),
                           np.full(2, 0.0025), 5.0, 5.0)
    error = lambda count, p: np.linalg.norm(fit_step(Data.of(transitions(truth, count, 0.05, 4)), p, 2).slope - truth)
    assert error(5, prior) < 0.5 * error(5, None)
    assert error(2000, prior) < 0.01  # 0.03 is what the prior is wrong by
    none = Data(0.0, prior.mean, np.zeros((5, 5)))
    assert np.allclose(fit_step(none, prior, 2).slope, believed)


def test_a_prior_of_noisy_states_is_the_regression_on_what_is_measured():
    """The best guess of the next measurement is not the model's slope at a measured state, but less of it."""
    rng, slope, noise = np.random.default_rng(5), slope_of(), 0.2
    true = rng.standard_normal((200_000, 3)) * [0.3, 0.3, 1.0]
    measured = true + np.array([noise, noise, 0]) * rng.standard_normal(true.shape)
    after = true @ slope.T + noise * rng.standard_normal((len(true), 2))
    sampled = fit_step(Data.of(np.hstack([measured, after])), None, 2).slope
    prior = prior_of_model(np.zeros(3), np.zeros(2), slope, np.cov(measured.T), np.full(2, noise**2), np.zeros(2), 5.0)
    ours = fit_step(Data(0.0, prior.mean, np.zeros((5, 5))), prior, 2).slope
    assert np.abs(ours - sampled).max() < 0.01  # five standard errors of the regression
    assert np.abs(slope - sampled).max() > 0.2


def test_a_mixture_serves_where_data_are_few():
    truth = slope_of()
    mixture = fit_mixture(transitions(truth, 200, 0.05, 8), 3, 20, 1)
    assert mixture.share.sum() == pytest.approx(1)
    few = transitions(truth, 5, 0.05, 4)
    with_, without = (fit_step(Data.of(few), p, 2).slope for p in (prior_of_mixture(mixture, few, 5.0), None))
    assert np.linalg.norm(with_ - truth) < 0.5 * np.linalg.norm(without - truth)


# ---- laws ---------------------------------------------------------------------------------------------

MODELS = [LinearStep(slope_of(), np.zeros(2), 1e-4 * np.eye(2))] * 15
COSTS = [Quadratic(np.diag([4.0, 0.2, 0.5]), np.zeros(3))] * 15 + [Quadratic(np.diag([10.0, 2.0]), np.zeros(2))]
BEFORE = [Law(np.zeros((1, 2)), np.zeros(1), np.eye(1))] * 15
START = np.array([1.0, -0.5]), 0.01 * np.eye(2)


def test_laws_keep_their_bound_and_pay_for_it():
    last = expected_cost(COSTS, passage(MODELS, BEFORE, *START))
    for epsilon in (0.1, 1.0, 10.0):
        found = kl_lqr(MODELS, COSTS, BEFORE, *START, epsilon)
        assert 0.9 * epsilon < found.divergence <= epsilon  # the bracket ends within two per cent of eta
        assert found.cost < last
        last = found.cost


def riccati(slope, state, control, end, periods):
    """Gains and the value's Hessian, first period first."""
    a, b, value, gains = slope[:, :2], slope[:, 2:], end, []
    for _ in range(periods):
        gain = -np.linalg.solve(control + b.T @ value @ b, b.T @ value @ a)
        value = state + a.T @ value @ (a + b @ gain)
        gains.insert(0, gain)
    return gains, value


def test_laws_without_a_bound_are_the_lqr():
    laws = soft_lqr(MODELS, COSTS, BEFORE, 1e-7)
    gains, _ = riccati(slope_of(), np.diag([4.0, 0.2]), np.eye(1) * 0.5, np.diag([10.0, 2.0]), 15)
    for law, gain in zip(laws, gains, strict=True):
        assert np.allclose(law.slope, gain, atol=1e-5)


# ---- guided search ------------------------------------------------------------------------------------

BELIEVED = slope_of(0.8, 0.4)  # of a plant that the model does not quite know
FAMILY = Family(lambda _: physics_of(BELIEVED), lambda rows: None, None)
GOAL = Goal(np.zeros(2), np.array([4.0, 0.2]), np.array([4.0, 0.2]), np.array([0.3]), np.array([-4.0]), np.array([4.0]))


def mass_task():
    return Task(["position_m", "velocity_m_s"], ["force_N"], [], GOAL.low, GOAL.high, np.zeros(2), np.eye(2), 0.1, 20,
                np.zeros(2), np.eye(2))


def condition(at):
    def run(controller, index):
        trial = Trial(np.zeros((21, 2)), np.zeros((21, 2)), np.zeros((20, 1)))
        x = np.array([at, 0.0])
        for k in range(21):
            trial.truth[k] = trial.measured[k] = x
            if k < 20:
                trial.command[k] = controller(x, k)
                x = slope_of() @ np.concatenate([x, trial.command[k]])
        return trial
    return Condition(np.array([at, 0.0]), run)


def guided(options, conditions=(-1.0, 1.0)):
    return Guided(mass_task(), GOAL, [condition(at) for at in conditions], np.zeros(2), options, FAMILY)


SMALL = {"steps": 600, "hidden": [12], "epsilon": 1.0}


def quiet(step, index):
    pass


def test_a_network_learns_what_the_lqr_does():
    result = GuidedResult()
    guided_search(mass_task(), GOAL, [condition(at) for at in (-1.0, 1.0)], np.zeros(2),
                  GuidedOptions(iterations=5, **SMALL), quiet, result, FAMILY)
    _, value = riccati(slope_of(), np.diag(GOAL.state), np.diag(GOAL.control), np.diag(GOAL.terminal), 20)
    best = 0.5 * value[0, 0]  # of the true plant, from either start
    assert 0.999 * best < result.steps[result.best].policy_cost < 1.1 * best


def test_a_networks_pointwise_slope_is_not_its_gain():
    """A network that is steep in its small print: at a point 200 N/m, over the samples the 2 N/m that it follows."""
    search = guided(GuidedOptions(**SMALL), (0.5,))
    local = Local(search._conditions[0].start, 1.0)
    search._plan([local])
    search._sample(0, local, 0, GuidedStep())

    class Steep:
        def raw(self, x):
            return 2 * x[:, :1] + 0.1 * np.sin(2000 * x[:, :1])

    search._student = Steep()
    gains = np.array([law.slope[0, 0] for law in search._policy_about(local)])
    spreads = np.array([local.measured(k)[:, 0].std() for k in range(20)])
    wide = spreads > 0.02
    assert wide.any() and np.all(np.abs(gains[wide] - 2) < 8), gains
    assert np.all(np.abs(gains) * spreads <= 8.0 + 1e-9)  # the range is 8 N


def test_where_laws_near_the_network_cost_more_those_before_serve_and_the_search_goes_on():
    search, result = guided(GuidedOptions(iterations=3, **SMALL)), GuidedResult()
    far = [Law(np.zeros((1, 2)), np.full(1, 40.0), np.eye(1) * 1e-6)] * 20  # all that is near it drives off
    search._policy_about = lambda local: far
    search.run(quiet, result)
    assert len(result.steps) == 3 and [step.apart for step in result.steps] == [0, 2, 2]
    assert result.steps[-1].local_cost <= 1.01 * result.steps[0].local_cost


def test_the_best_round_is_kept_on_every_ending():
    class Stop(Exception):
        pass

    search, result, networks = guided(GuidedOptions(iterations=4, **SMALL)), GuidedResult(), []
    judge = search._judge

    def costs(iteration, step):
        judge(iteration, step)
        networks.append(search._student.network())
        step.policy_cost = [3.0, 1.0, 2.0, 5.0][iteration]

    def after(step, index):
        if index == 2:
            raise Stop

    search._judge = costs
    with pytest.raises(Stop):
        search.run(after, result)
    assert result.best == 1 and result.network == networks[1]


def test_first_motions_keep_their_limits_and_are_best_where_those_do_not_bind():
    goal = GOAL._replace(low=np.array([-40.0]), high=np.array([40.0]))
    guide, start = Guide(FAMILY.physics), np.array([[1.0, 0.0]])
    found = guide.best(None, goal, start, 20, 1)
    (x,), (u,), (gain,) = found.x, found.u, guide.gains(None, goal, found)
    gains, value = riccati(BELIEVED, np.diag(GOAL.state), np.diag(GOAL.control), np.diag(GOAL.terminal), 20)
    assert float(goal.of(x, u)) == pytest.approx(0.5 * value[0, 0], rel=1e-6)
    assert np.allclose(gain, gains, atol=1e-6)
    tight = GOAL._replace(low=np.array([-0.5]), high=np.array([0.5]))
    found = guide.best(None, tight, start, 20, 1)
    assert np.all(np.abs(found.u) <= 0.5) and found.u[0, 0, 0] == -0.5
    assert not guide.gains(None, tight, found)[0, 0].any() and guide.gains(None, goal, found)[0, 0].any()
