"""Controllers whose model is fitted as they go, on a point mass whose motor breaks, and networks as their prior."""
import numpy as np
import pytest

pytest.importorskip("jax")

import jax
import jax.numpy as jnp

from tiller.labs.policies.adaptive import AdaptiveIlqr, AdaptiveLqr, AdaptiveOptions
from tiller.labs.policies.neural_physics import network_physics, wandering
from tiller.labs.policies.plant import Trial
from tiller.labs.policies.task import Task

LOW, HIGH = np.array([-5.0]), np.array([5.0])


def slope_of(gain=1.0, friction=0.5):
    """Of a point mass that friction slows, 0.1 s a period: [position, velocity, force]."""
    return np.array([[1.0, 0.1, 0.0], [0.0, 1 - 0.1 * friction, 0.1 * gain]])


def physics_of(slope):
    return lambda z: (jnp.asarray(slope) @ z, jnp.asarray(slope))


def options(adapt=True, noise=0.001):
    return AdaptiveOptions(np.zeros(2), LOW, HIGH, np.array([10.0, 1.0]), np.array([0.1]), np.full(2, noise),
                           horizon=15, adapt=adapt)


def riccati_gain(slope, periods=15):
    a, b, state = slope[:, :2], slope[:, 2:], np.diag([10.0, 1.0])
    value = state
    for _ in range(periods):
        gain = -np.linalg.solve(0.1 * np.eye(1) + b.T @ value @ b, b.T @ value @ a)
        value = state + a.T @ value @ (a + b @ gain)
    return gain


def held(controller):
    """Where a point mass comes to rest whose motor of 0.6 pushes against 1.5 N more from period 60 on."""
    x = np.array([0.5, 0.0])
    for k in range(250):
        u = controller(x, k)
        x = slope_of() @ np.concatenate([x, u]) if k < 60 else (
            slope_of(0.6) @ np.concatenate([x, u]) + [0, 0.1 * 1.5])
    return abs(x[0])


def test_an_adaptive_lqr_holds_a_plant_that_breaks():
    """At rest the motor balances the push: u = -push / gain. The model alone commands -stiffness x, and rests where
    that is u."""
    alone = 1.5 / 0.6 / -riccati_gain(slope_of())[0, 0]
    assert held(AdaptiveLqr(physics_of(slope_of()), options(False))) == pytest.approx(alone, rel=1e-3)
    # what is left is the prior's pull on the offset
    assert held(AdaptiveLqr(physics_of(slope_of()), options())) < 0.1 * alone


def test_noise_that_the_commands_answer_to_hardly_passes_for_gain():
    """A loop at rest tells of the motor only by commands that answer to the noise of the states before. What is taken
    for gain stays below a deviation of it, and the slopes by states are the model's."""
    rng, sd, x, slopes = np.random.default_rng(6), 0.01, np.zeros(2), []
    controller = AdaptiveLqr(physics_of(slope_of()), options(noise=sd))
    for k in range(200):
        u = controller(x + sd * rng.standard_normal(2), k)
        slopes.append(controller.model(x, u)[0])
        x = slope_of() @ np.concatenate([x, u])
    found = np.mean(slopes[50:], 0)
    assert np.allclose(found[:, :2], slope_of()[:, :2])
    assert abs(found[1, 2] / slope_of()[1, 2] - 1) < 0.5


def test_an_adaptive_ilqr_is_the_lqr_within_the_limits_and_keeps_them_beyond():
    x = np.array([0.3, -0.2])
    ours = AdaptiveIlqr(physics_of(slope_of()), options(False)).command(x)
    assert ours == pytest.approx(riccati_gain(slope_of()) @ x, rel=1e-6)
    assert AdaptiveIlqr(physics_of(slope_of()), options(False)).command(np.array([9.0, 0.0])) == LOW


def test_the_first_plan_leaves_a_place_where_no_small_command_helps():
    """A mass that the square of the command pushes: from no command, iLQR finds no better one."""
    def step(z):
        return jnp.array([z[0] + 0.1 * z[1], 0.95 * z[1] + 0.02 * z[2]**2])

    controller = AdaptiveIlqr(lambda z: (step(jnp.asarray(z)), jax.jacfwd(step)(jnp.asarray(z))), options(False))
    assert np.abs(controller(np.array([-1.0, 0.0]), 0)) > 0.5


# ---- a network as the prior ---------------------------------------------------------------------------


def runs(gains, seed):
    """Of masses with these motors, from places near the origin, measured with noise."""
    trials = []
    for i, gain in enumerate(gains):
        rng = np.random.default_rng([seed, i])
        trial = Trial(np.zeros((41, 2)), np.zeros((41, 2)), np.zeros((40, 1)))
        x, command = 0.5 * rng.standard_normal(2), wandering(LOW, HIGH, rng)
        for k in range(41):
            trial.truth[k], trial.measured[k] = x, x + 0.002 * rng.standard_normal(2)
            if k < 40:
                trial.command[k] = command(x, k)
                x = slope_of(gain) @ np.concatenate([x, trial.command[k]])
        trials.append(trial)
    return trials


@pytest.fixture(scope="module")
def network():
    task = Task(["position_m", "velocity_m_s"], ["force_N"], [], LOW, HIGH, np.zeros(2), np.eye(2), 0.1, 20,
                np.zeros(2), np.eye(2))
    return network_physics(task, runs(np.linspace(0.7, 1.3, 20), 3), 1)


def test_a_network_learns_what_plants_have_in_common(network):
    """Masses with motors of 0.7 to 1.3: their mean, and its slope, without an equation."""
    z = np.concatenate([np.hstack([t.truth[:-1], t.command]) for t in runs([1.0] * 5, 4)])
    after, slope = map(np.asarray, jax.vmap(network)(z))
    gained, truth = after - z[:, :2], z @ slope_of().T - z[:, :2]
    assert np.all((gained - truth).std(0) < 0.15 * truth.std(0))
    assert np.all(np.abs(slope.mean(0) - slope_of()) < 0.03)  # 0.05 is how far friction moves the velocity's


@pytest.mark.parametrize("kind", [AdaptiveLqr, AdaptiveIlqr])
def test_what_a_network_has_not_seen_is_adapted_online(network, kind):
    """The motor of 0.6 and the push were in no earlier run."""
    alone, learnt = (held(kind(network, options(adapt))) for adapt in (False, True))
    assert learnt < 0.4 * alone, (learnt, alone)
