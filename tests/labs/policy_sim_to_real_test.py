"""Trust regions that are kept, updates that come to the LQR, and an alternation that finds a plant's parameters and
gains by them."""
import numpy as np
import pytest

pytest.importorskip("jax")

import jax
import jax.numpy as jnp

from tiller.labs.policies.guide import Goal
from tiller.labs.policies.plant import Trial
from tiller.labs.policies.sim_to_real import Priors, SimToReal, SimToRealOptions, SimToRealResult
from tiller.labs.policies.student import Student
from tiller.labs.policies.task import Task
from tiller.labs.policies.trpo import Trpo, TrpoOptions, advantages, normal_kl

GOAL = Goal(np.zeros(2), np.array([4.0, 0.2]), np.array([4.0, 0.2]), np.array([0.3]), np.array([-4.0]), np.array([4.0]))


def mass_task():
    return Task(["position_m", "velocity_m_s"], ["force_N"], [], GOAL.low, GOAL.high, np.array([1.0, 0.0]),
                np.diag([0.04, 0.0001]), 0.1, 20, np.zeros(2), np.eye(2))


def step(z, p):
    """A point mass with friction 0.5 and a motor of p[0], that a spring of p[1] pulls."""
    return jnp.array([z[0] + 0.1 * z[1], 0.95 * z[1] + 0.1 * (p[0] * z[2] - p[1] * z[0])])


def lqr_cost(gain, spring):
    a, b = np.array([[1, 0.1], [-0.1 * spring, 0.95]]), np.array([[0], [0.1 * gain]])
    value = np.diag(GOAL.terminal)
    for _ in range(20):
        k = -np.linalg.solve(np.diag(GOAL.control) + b.T @ value @ b, b.T @ value @ a)
        value = np.diag(GOAL.state) + a.T @ value @ (a + b @ k)
    return 0.5 * (value[0, 0] * (1 + 0.04) + value[1, 1] * 0.0001)


def trpo(**options):
    student = Student(mass_task(), [12], 1)
    student.scale = np.zeros(2), np.ones(2)
    return Trpo(mass_task(), GOAL, step, student, TrpoOptions(**options))


def draws(params, seed=5):
    rng, task = np.random.default_rng(seed), mass_task()
    return lambda n: (np.tile(params, (n, 1)), rng.multivariate_normal(task.start_mean, task.start_covariance, n))


def test_the_divergence_is_of_the_old_from_the_new():
    from scipy.stats import norm

    old, new = (0.3, np.log(0.5)), (-0.2, np.log(0.8))
    x = 0.3 + 0.5 * np.random.default_rng(2).standard_normal(200_000)
    gap = norm(0.3, 0.5).logpdf(x) - norm(-0.2, 0.8).logpdf(x)
    found = normal_kl(*(np.atleast_1d(v) for v in (*old, *new)))
    assert abs(float(found) - gap.mean()) < 5 * gap.std() / np.sqrt(len(x))


def test_advantages_with_a_trace_of_one_are_returns_over_their_baseline():
    """Costs that features tell leave nothing; a command's own share of the cost is what is left."""
    rng = np.random.default_rng(3)
    f, own = rng.standard_normal((1, 4000, 2)), rng.standard_normal((1, 4000))
    cost = f[..., 0] + 0.5 * f[..., 1]**2 + own
    assert np.corrcoef(np.asarray(advantages(f, cost, 1.0, 1.0)).ravel(), -own.ravel())[0, 1] > 0.99


def test_an_update_stays_within_its_trust_region_and_uses_it():
    search = trpo(kl=0.01)
    for i in range(5):
        batch, _ = search._rollouts(search.actor, *draws([1.0, 0.0], i)(128), jax.random.key(i))
        before = search.actor
        search.actor, told = search._update(before, batch, search.student.scale)
        x = np.asarray(batch.x).reshape(-1, 2)
        mean = lambda actor: np.asarray(search.student.answers(actor.arrays, search.student.scale, x)) / 4
        kl = float(normal_kl(mean(before), before.log_sd, mean(search.actor), search.actor.log_sd).mean())
        assert kl == pytest.approx(float(told), rel=1e-6) and 0.003 < kl <= 0.01


def test_updates_come_to_the_lqr():
    search = trpo(kl=0.03)
    costs = search.run(draws([1.0, 0.0]), 150, 1)
    params, starts = draws([1.0, 0.0], 9)(500)
    batch, _ = search.policy_rollouts(search.student.arrays, params, starts)
    best = lqr_cost(1.0, 0.0)
    assert costs[0] > 1.3 * best and float(batch.cost.sum(0).mean()) < 1.1 * best


def test_the_alternation_finds_the_plants_parameters_and_gains_by_them():
    """Models of 0.2 to 2 and springs of -1 to 5; the plant is at an edge of both."""
    truth, rng = np.array([0.6, 4.0]), np.random.default_rng(4)
    priors = Priors(np.column_stack([rng.uniform(0.2, 2, 4096), rng.uniform(-1, 5, 4096)]), np.array([0.2, -1]),
                    np.array([2.0, 5]))

    def run(controller, index):
        own = np.random.default_rng([7, index])
        x, trial = own.multivariate_normal([1.0, 0.0], np.diag([0.04, 0.0001])), Trial(
            np.zeros((21, 2)), np.zeros((21, 2)), np.zeros((20, 1)))
        for k in range(21):
            trial.truth[k], trial.measured[k] = x, x + 0.002 * own.standard_normal(2)
            if k < 20:
                trial.command[k] = controller(trial.measured[k], k)
                x = np.asarray(step(np.concatenate([x, trial.command[k]]), truth))
        return trial

    o, result = SimToRealOptions(4, 120, kl=2.0, hidden=[12], trpo=TrpoOptions(kl=0.03)), SimToRealResult()
    SimToReal(mass_task(), GOAL, step, priors, run, np.full(2, 0.002), o).run(lambda step, i: None, result)
    first, last = result.steps[0], result.steps[-1]
    assert np.all(np.abs(last.mean - truth) < 0.35 * np.abs(first.mean - truth))
    # what it is trained on and what it meets come together
    assert abs(last.model_cost - last.plant_cost) < 0.5 * abs(first.model_cost - first.plant_cost)
    assert min(s.plant_cost for s in result.steps[1:]) < first.plant_cost
