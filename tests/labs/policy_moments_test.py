"""What tiller policy expects of a policy on a learnt model: moments against samples and quadrature, the process against
its formula, gradients against differences."""
import itertools

import numpy as np
import pytest

pytest.importorskip("jax")

import jax
from jax.flatten_util import ravel_pytree

from tiller.labs.policies.feedback import Linear, make_feedback
from tiller.labs.policies.forecast import forecast, long_term_cost
from tiller.labs.policies.moments import (Normal, bump_moments, bump_values, saturating_cost, squash, squashed,
                                           with_sines)
from tiller.labs.policies.process import ProcessOptions, Shape, condition, evidence, fit_shape
from tiller.labs.policies.shown import DOUBT, divergence
from tiller.labs.policies.task import Task

SAMPLES = 100_000


def random_process(seed, points=60, **options):
    """A process that was fitted to a random function of four inputs."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((points, 4))
    y = np.column_stack([np.sin(x[:, 0] + x[:, 1]), np.cos(x[:, 2]) * x[:, 3]])
    o = ProcessOptions(**options)
    return x, y, fit_shape(x, y, o, seed), o


def normal(rng, size):
    root = 0.4 * rng.standard_normal((size, size))
    return Normal(rng.standard_normal(size), root @ root.T), root


# five standard errors: of some 20 numbers one in 1e5 seeds is beyond
@pytest.mark.parametrize("seed", [1, 2])
def test_moments_of_a_process_are_those_of_samples(seed):
    x, y, shape, o = random_process(seed)
    process, (of, root) = condition(x, y, shape, o), normal(np.random.default_rng(seed + 10), 4)
    exact = bump_moments(process, of)
    z = np.random.default_rng(seed).standard_normal((SAMPLES, 4))
    points = of.mean + z @ root.T
    mean, variance = map(np.asarray, jax.jit(jax.vmap(lambda p: bump_values(process, p)))(points))
    error = mean.std(0) / np.sqrt(SAMPLES)
    assert np.all(np.abs(exact.mean - mean.mean(0)) < 5 * error)
    away = mean - mean.mean(0)
    product = away[:, :, None] * away[:, None] + np.einsum("ni,ij->nij", variance, np.eye(2))
    assert np.all(np.abs(exact.covariance - product.mean(0)) < 5 * product.std(0) / np.sqrt(SAMPLES))
    across = (points - of.mean)[:, :, None] * away[:, None]
    assert np.all(np.abs(of.covariance @ exact.gain - across.mean(0)) < 5 * across.std(0) / np.sqrt(SAMPLES))


def test_sines_squash_and_cost_are_those_of_samples():
    rng = np.random.default_rng(3)
    of, root = normal(rng, 2)
    points = of.mean + rng.standard_normal((SAMPLES, 2)) @ root.T
    low, high = np.array([-2.0, 0.0]), np.array([3.0, 1.0])
    all_of = np.column_stack([points, np.sin(points[:, 1]), np.cos(points[:, 1])])
    sines, u = with_sines(of, [1]), squashed(of, low, high)
    commands = np.asarray(squash(points, low, high))
    for exact, sampled in ((sines, all_of), (u, commands)):
        assert np.all(np.abs(exact.mean - sampled.mean(0)) < 5 * sampled.std(0) / np.sqrt(SAMPLES))
        # of a bounded or normal number the covariance's error is at most that of its square
        assert np.allclose(exact.covariance, np.cov(sampled.T), atol=5 * 2 * sampled.var(0).max() / np.sqrt(SAMPLES))
    across = (points - of.mean).T @ commands / SAMPLES
    assert np.allclose(of.covariance @ u.gain, across, atol=0.02)
    weight = np.array([[2.0, 0.3], [0.3, 1.0]])
    off = points - 0.5
    costs = 1 - np.exp(-0.5 * np.einsum("ni,ij,nj->n", off, weight, off))
    assert abs(float(saturating_cost(of, 0.5 * np.ones(2), weight)) - costs.mean()) < 5 * costs.std() / np.sqrt(SAMPLES)


def test_the_divergence_from_demonstrations_is_that_of_samples_of_them():
    """E under the demonstrations, and not under the forecast, whose own divergence is another number."""
    from scipy.stats import multivariate_normal

    rng = np.random.default_rng(21)
    (shown, root), (told, _) = normal(rng, 3), normal(rng, 3)
    wide = told.covariance + DOUBT * shown.covariance
    logs = lambda x: (multivariate_normal(*shown).logpdf(x) - multivariate_normal(told.mean, wide).logpdf(x))
    gap = logs(shown.mean + rng.standard_normal((SAMPLES, 3)) @ root.T)
    assert abs(float(divergence(shown, told)) - gap.mean()) < 5 * gap.std() / np.sqrt(SAMPLES)
    other = -logs(told.mean + rng.standard_normal((SAMPLES, 3)) @ np.linalg.cholesky(wide).T)
    assert abs(other.mean() - gap.mean()) > 20 * other.std() / np.sqrt(SAMPLES)


def test_evidence_is_the_normal_density_and_fitting_raises_it():
    from scipy.stats import multivariate_normal

    x, y, shape, o = random_process(4, points=30)
    p = np.array([0.1, -0.2, 0.3, 0.0, 0.2, -2.0])
    gap = (x[:, None] - x) / np.exp(p[:4])
    k = np.exp(0.4 - 0.5 * (gap**2).sum(-1)) + (np.exp(-4) + 1e-8 * np.exp(0.4)) * np.eye(30)
    filled, target = np.zeros((50, 4)), np.zeros(50)
    filled[:30], target[:30] = x, y[:, 0]
    used = np.arange(50) < 30  # what fills up counts nothing
    density = multivariate_normal(np.zeros(30), k).logpdf(y[:, 0])
    assert float(evidence(p, filled, target, used)) == pytest.approx(-density)
    found = np.concatenate([shape.log_length[0], [shape.log_signal[0], shape.log_noise[0]]])
    assert float(evidence(found, filled, target, used)) < float(evidence(p, filled, target, used)) - 10


def test_a_sparse_process_is_near_the_full_one_and_all_points_make_it_the_same():
    x, y, shape, _ = random_process(5, points=120)
    full = condition(x, y, shape, ProcessOptions())
    sparse = condition(x, y, shape, ProcessOptions(most_points=100))
    at = np.random.default_rng(6).standard_normal((20, 4))
    values = [np.asarray(jax.vmap(lambda p, b=b: bump_values(b, p)[0])(at)) for b in (full, sparse)]
    assert np.abs(values[0] - values[1]).max() < 0.1  # of a signal of one
    k = np.array([[np.exp(2 * shape.log_signal[0] - 0.5 * (((a - b) / np.exp(shape.log_length[0]))**2).sum())
                   for b in x] for a in x])
    own = np.linalg.solve(k + (np.exp(2 * shape.log_noise[0]) + 1e-8 * k[0, 0]) * np.eye(120), y[:, 0])
    assert np.allclose(full.beta[0, :120], own, rtol=1e-6) and not full.beta[0, 120:].any()


# ---- a forecast by quadrature, with nothing of the library's formulas ---------------------------------


def nodes(mean, covariance, axis=12):
    at, weight = np.polynomial.hermite_e.hermegauss(axis)
    values, vectors = np.linalg.eigh(covariance)
    used = values > 1e-12 * values.max()
    root = vectors[:, used] * np.sqrt(values[used])
    z = np.array(list(itertools.product(at, repeat=root.shape[1])))
    return mean + z @ root.T, np.prod(list(itertools.product(weight / weight.sum(), repeat=root.shape[1])), axis=1)


def joint(points, weights):
    mean = weights @ points
    return mean, ((points - mean) * weights[:, None]).T @ (points - mean)


class ByQuadrature:
    """An angle and its rate; the process sees sine, cosine, rate and command."""

    def __init__(self, task, x, y, shape, policy):
        self.task, self.x, self.y, self.policy = task, x, y, policy
        self.length, self.signal = np.exp(shape.log_length), np.exp(shape.log_signal)
        self.noise = np.exp(shape.log_noise)

    def gains(self, z):
        mean, variance = [], []
        for a in range(2):
            kernel = lambda p, q, a=a: self.signal[a]**2 * np.exp(-0.5 * ((
                (p[:, None] - q) / self.length[a])**2).sum(-1))
            k, across = kernel(self.x, self.x) + self.noise[a]**2 * np.eye(len(self.x)), kernel(z, self.x)
            mean.append(across @ np.linalg.solve(k, self.y[:, a]))
            variance.append(self.signal[a]**2 - (across * np.linalg.solve(k, across.T).T).sum(1))
        return np.array(mean).T, np.array(variance).T

    def seen(self, mean, covariance):
        p, w = nodes(mean, covariance)
        return joint(np.column_stack([p, np.sin(p[:, 0]), np.cos(p[:, 0])]), w)

    def cost(self, mean, covariance):
        p, w = nodes(*self.seen(mean, covariance))
        off = p - self.task.target
        return w @ (1 - np.exp(-0.5 * np.einsum("ni,ij,nj->n", off, self.task.weight, off)))

    def step(self, mean, covariance):
        p, w = nodes(*self.seen(mean, covariance))
        v = p[:, [2, 3, 1]] @ self.policy.weight[0] + self.policy.bias[0]
        low, high = self.task.low[0], self.task.high[0]
        u = 0.5 * (low + high) + 0.5 * (high - low) * (9 * np.sin(v) + np.sin(3 * v)) / 8
        m, s = joint(np.column_stack([p, u]), w)  # angle, rate, sine, cosine, command
        read = [2, 3, 1, 4]
        z, w = nodes(m[read], s[np.ix_(read, read)])
        gain, variance = self.gains(z)
        both, spread = joint(np.column_stack([z, gain]), w)
        # of jointly normal a and z: cov(a, g(z)) = cov(a, z) cov(z, z)^-1 cov(z, g(z))
        across = s[:2][:, read] @ np.linalg.solve(s[np.ix_(read, read)], spread[:4, 4:])
        return m[:2] + both[4:], s[:2, :2] + spread[4:, 4:] + np.diag(w @ variance) + across + across.T


def turning_task():
    return Task(["angle_rad", "rate_rad_s"], ["torque_Nm"], [0], np.array([-2.0]), np.array([3.0]),
                np.array([0.4, -0.2]), np.array([[0.05, 0.01], [0.01, 0.08]]), 0.1, 3, np.array([0.0, 0.0, 0.0, -1.0]),
                np.diag([0.0, 0.1, 0.7, 0.7]))


def turning_process():
    x = np.random.default_rng(5).standard_normal((25, 4))
    y = np.column_stack([0.3 * x[:, 2], 0.3 * x[:, 3] - 0.5 * x[:, 0] + 0.1 * x[:, 2] * x[:, 1]])
    length = np.full((2, 4), 0.4)
    length[1, 1] = 0.1
    return x, y, Shape(length, np.full(2, -0.3), np.full(2, -2.5))


def test_a_forecast_is_that_of_quadrature():
    task, (x, y, shape) = turning_task(), turning_process()
    policy = Linear(np.array([[0.8, 0.3, -0.5]]), np.array([0.2]))
    ours = jax.jit(lambda b: forecast(task, b, policy))(condition(x, y, shape, ProcessOptions()))
    other, now = ByQuadrature(task, x, y, shape, policy), (task.start_mean, task.start_covariance)
    for k in range(4):
        # the nodes' own error grows with the deviations, to 3e-5 in the third period
        assert np.allclose(ours.mean[k], now[0], atol=1e-4) and np.allclose(ours.covariance[k], now[1], atol=1e-4)
        assert float(ours.cost[k]) == pytest.approx(other.cost(*now), abs=1e-4)
        now = other.step(*now)


@pytest.mark.parametrize("kind", ["rbf", "linear"])
def test_gradients_are_those_of_differences(kind):
    task, process = turning_task(), condition(*turning_process(), ProcessOptions())
    policy = make_feedback(task, kind, 5, Normal(np.zeros(3), np.eye(3)), 0.5, [7])
    p, unravel = ravel_pytree(policy)
    cost = jax.jit(lambda p: long_term_cost(task, process, unravel(p)))
    slope = np.asarray(jax.jit(jax.grad(cost))(p))
    along = np.random.default_rng(8).standard_normal(p.size)
    difference = (float(cost(p + 1e-5 * along)) - float(cost(p - 1e-5 * along))) / 2e-5
    assert slope @ along == pytest.approx(difference, rel=1e-5)  # of central differences in double
