"""Controller, commands and views: bits of the C interface, lifetimes, threads, interruption."""
import gc
import os
import subprocess
import sys
import threading

import numpy as np
import pytest

import tiller


@pytest.fixture(scope="module")
def pendulum():
    return tiller.Robot.from_toml("pendulum")


def run(robot, seconds=1.0, **how):
    controller, plant = tiller.Controller(robot, **how), tiller.Plant(robot)
    controller.arm()
    commands = []
    for m in tiller.lockstep(plant, seconds):
        command = controller.tick(m.t, m)
        plant.step(command)
        commands.append(command.value.copy())
    return controller, plant, np.array(commands)


# a process without Python in it drives the C interface; its measurements come back here
@pytest.mark.parametrize("name", ["pendulum", "cart_pole", "furuta"])
def test_commands_have_the_bits_of_the_c_interface(name):
    program = os.environ.get("TILLER_C_LOOP", "")
    if not os.path.exists(program):
        pytest.skip("no bench_package (TILLER_C_LOOP)")
    robot = tiller.Robot.from_toml(name)
    ticks = os.environ.get("TILLER_TEST_TICKS", "60")
    lines = subprocess.run([program, "commands", robot.path, ticks], check=True, capture_output=True,
                           text=True).stdout.splitlines()
    controller = tiller.Controller(robot)
    controller.arm()
    moved = 0
    for line in lines:
        measured, commanded = line.split(";")
        stamp, *y = measured.split()
        command = controller.tick(int(stamp) * 1e-6, [float.fromhex(v) for v in y])
        expected = [float.fromhex(v) for v in commanded.split()]
        assert command.value.tolist() == expected
        moved += any(expected)
    assert len(lines) == int(ticks) and moved > int(ticks) // 2


def test_threads_do_not_change_a_bit(pendulum):
    one, two = run(pendulum)[2], run(pendulum, threads=2)[2]
    assert one.tobytes() == two.tobytes() and np.abs(one).max() > 0


def test_the_command_line_commands_the_same(pendulum, tmp_path):
    log = tmp_path / "run.csv"
    subprocess.run([sys.executable, "-m", "tiller", "run", pendulum.path, "--sim", "--seconds", "1", "--quiet", "--log",
                    str(log)], check=True, capture_output=True)
    lines = [line for line in log.read_text().splitlines() if line and not line.startswith("#")]
    column = next(i for i, name in enumerate(lines[0].split(",")) if name.startswith("command") or "torque_Nm" in name)
    logged = np.array([float(line.split(",")[column]) for line in lines[1:]])
    commands = run(pendulum)[2][:, 0]
    assert len(logged) >= len(commands) > 40
    np.testing.assert_allclose(logged[:len(commands)], commands, rtol=1e-6, atol=1e-9)


def test_views_share_memory_and_move_on(pendulum):
    controller, plant, _ = run(pendulum)
    particles, again = controller.posterior.particles, controller.posterior.particles
    assert controller.posterior.shared and np.shares_memory(particles, again)
    views = [particles, controller.posterior.weights, controller.posterior.mean, controller.posterior.sd,
             controller.plan, controller.info.state_mean, controller.info.param_sd]
    addresses = [v.ctypes.data for v in views[:4]]
    assert all(not v.flags.writeable and not v.flags.owndata for v in views)
    before = particles.copy()
    mean = views[2].copy()
    for _ in range(30):
        command = controller.tick(plant.measurement.t, plant.measurement)
        plant.step(command)
    assert not np.array_equal(before, particles), "a view shows what the tick has changed"
    assert not np.array_equal(mean, views[2])
    assert [v.ctypes.data for v in (controller.posterior.particles, controller.posterior.weights,
                                    controller.posterior.mean, controller.posterior.sd)] == addresses
    with pytest.raises(ValueError):
        particles[0, 0] = 1.0


def test_moments_are_those_of_the_particles(pendulum):
    posterior = run(pendulum)[0].posterior
    weights, particles = posterior.weights, posterior.particles
    assert particles.shape == (posterior.size, 3) and abs(weights.sum() - 1) < 1e-12
    np.testing.assert_allclose(weights @ particles, posterior.mean, rtol=1e-9)
    spread = particles - posterior.mean
    np.testing.assert_allclose(np.einsum("n,ni,nj->ij", weights, spread, spread), posterior.covariance(), atol=1e-12)
    low, high = posterior.quantiles([0.05, 0.95])
    assert low[0] < posterior.mean[0] < high[0] and low[1] == high[1] == 0.5


@pytest.mark.parametrize("take", [lambda c: c.posterior.particles, lambda c: c.posterior.weights, lambda c: c.plan,
                                  lambda c: c.info.state_mean, lambda c: c.posterior.mean])
def test_a_view_keeps_its_owner_alive(pendulum, take):
    controller = run(pendulum, 0.3)[0]
    view = take(controller)
    expected = view.copy()
    del controller
    gc.collect()
    junk = [np.full(1 << 16, 7.0) for _ in range(50)]  # a freed block would be taken for these
    assert np.array_equal(view, expected) and junk


def test_forces_at_a_frame_are_those_of_the_joints(tmp_path):
    text = open(tiller.Robot.from_toml("two_link_arm").path).read()
    file = tmp_path / "arm.toml"
    file.write_text(text.replace("[posterior]\n", "[posterior]\ndisturbance = true\n"))
    controller = run(tiller.Robot.from_toml(str(file)))[0]
    forces = controller.frame_forces()
    assert list(forces) == ["tip_x_N", "tip_z_N"]
    info, upper, lower = controller.info, 0.5, 0.4
    q1, q12 = info.state_mean[0], info.state_mean[0] + info.state_mean[1]
    along = np.array([[upper * np.cos(q1) + lower * np.cos(q12), upper * np.sin(q1) + lower * np.sin(q12)],
                      [lower * np.cos(q12), lower * np.sin(q12)]])  # (joints, coordinates)
    inverse = np.linalg.inv(along)
    np.testing.assert_allclose([m for m, _ in forces.values()], inverse @ info.force_mean, rtol=1e-5)
    np.testing.assert_allclose([s for _, s in forces.values()], np.sqrt(inverse ** 2 @ info.force_sd ** 2), rtol=1e-5)
    assert run(tiller.Robot.from_toml("two_link_arm"), 0.1)[0].frame_forces() == {}


def test_an_owner_goes_with_its_last_view(pendulum):
    resident = lambda: int(open("/proc/self/statm").read().split()[1])
    tiller.Controller(pendulum)
    begin = resident()
    for _ in range(400):
        controller = tiller.Controller(pendulum)
        view = controller.posterior.particles
        info = controller.info
        del controller, view, info
    gc.collect()
    assert (resident() - begin) * 4096 < 50 * tiller.Controller(pendulum).block_bytes


def test_command_value_outlives_the_command(pendulum):
    value = tiller.Controller(pendulum).tick(1.0, [0.1]).value
    gc.collect()
    assert value.tolist() == [0.0]


def test_states_and_statuses(pendulum):
    controller = tiller.Controller(pendulum)
    first = controller.tick(1.0, [0.0])
    assert first.state == tiller.State.STANDBY and first.value.tolist() == [0.0]
    controller.arm()
    assert controller.tick(1.02, [0.0]).state == tiller.State.ACTIVE
    late = controller.tick(2.0, None)
    assert late.status == tiller.Status.sensor_stale and not late.ok and late.state == tiller.State.SAFE
    with pytest.raises(tiller.StatusError) as caught:
        controller.arm()
    assert caught.value.status == "wrong_state" and "reset()" in caught.value.remedy
    controller.reset()
    controller.arm()
    controller.stop()
    assert controller.info.first_fault == tiller.Status.stopped


@pytest.mark.parametrize("t, y, error, words", [
    (0.0, [1.0, 2.0], tiller.ArgumentError, ["y", "shape (2,)", "angle_rad", "(1,)"]),
    (0.0, np.zeros((1, 1)), tiller.ArgumentError, ["y", "shape (1, 1)"]),
    (0.0, "ab", TypeError, ["y", "'ab'"]),
    (0.0, [None], TypeError, ["y", "None"]),
    (0.0, [1j], TypeError, ["y", "1j"]),
    ("now", [0.0], TypeError, ["t", "'now'", "seconds"]),
    (float("nan"), [0.0], ValueError, ["t", "nan", "finite"]),
    (1e300, [0.0], ValueError, ["t", "1e+300", "9e12"]),
])
def test_errors_name_argument_value_and_remedy(pendulum, t, y, error, words):
    controller = tiller.Controller(pendulum)
    with pytest.raises(error) as caught:
        controller.tick(t, y)
    assert isinstance(caught.value, tiller.ArgumentError) and caught.value.remedy
    for word in words:
        assert word in str(caught.value)
    assert controller.info.ticks == 0, "a refused call changes nothing"


def test_a_missing_value_is_nan():
    controller = tiller.Controller(tiller.Robot.from_toml("cart_pole"))
    controller.tick(1.0, [0.0, 3.14])
    controller.tick(1.02, [float("nan"), 3.14])
    assert controller.info.missing_values == 1


@pytest.mark.parametrize("y", [[0.25], (0.25,), np.array([0.25]), np.array([0.25], np.float32), np.array([9, 0.25])[1:],
                               np.array([0.25, 9, 9])[::3]])
def test_whatever_holds_numbers_is_taken(pendulum, y):
    controller = tiller.Controller(pendulum)
    for k in range(3):
        controller.tick(1 + 0.02 * k, y)
    assert abs(controller.info.state_mean[0] - 0.25) < 0.01


def test_two_threads_in_one_controller_are_refused(pendulum):
    controller = tiller.Controller(pendulum)
    controller.arm()
    refused, stop = [], threading.Event()

    def work(offset):
        k = 0
        while not stop.is_set() and k < 3000:
            k += 1
            try:
                controller.tick(1.0 + offset + 0.02 * k, [0.1])
            except tiller.StatusError as error:
                refused.append(str(error))
                stop.set()

    threads = [threading.Thread(target=work, args=(0.01 * i,)) for i in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert refused and "another thread" in refused[0]


def test_other_threads_run_during_a_tick(pendulum):
    def work(seed, results):
        results[seed] = run(tiller.Robot.from_toml("pendulum"), 0.4)[2].tobytes()

    results = {}
    threads = [threading.Thread(target=work, args=(i, results)) for i in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert len(set(results.values())) == 1 and len(results) == 4


def test_targets_and_references(pendulum):
    controller = tiller.Controller(pendulum)
    controller.set_target([1.0, 0.0])
    controller.set_reference(np.zeros((20, 2)))
    with pytest.raises(tiller.ArgumentError, match="columns|shape"):
        controller.set_reference(np.zeros((20, 3)))
    with pytest.raises(tiller.ArgumentError, match="nan"):
        controller.set_target([float("nan"), 0.0])
    with pytest.raises(tiller.StatusError) as caught:
        controller.prediction()
    assert caught.value.status == "bad_planner"


