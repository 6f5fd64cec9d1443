"""rollout(): against an integrator of its own, over shapes, types, threads, and under Ctrl-C."""
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

import tiller

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def pendulum():
    return tiller.Robot.from_toml("pendulum")


def reference(robot, x0, inputs, params):
    """A damped pendulum by RK4 in numpy, as many substeps as bring its own error below 1e-9."""
    mass, length, damping = params
    weight_Nm, inertia = mass * 9.81 * length, mass * length**2
    rate = lambda x, u: np.array([x[1], (u - damping * x[1] - weight_Nm * np.sin(x[0])) / inertia])
    way, substeps = [np.array(x0, float)], 40
    for u in inputs[:, 0]:
        x, h = way[-1], robot.period_s / substeps
        for _ in range(substeps):
            a = rate(x, u)
            b = rate(x + h / 2 * a, u)
            c = rate(x + h / 2 * b, u)
            x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c, u))
        way.append(x)
    return np.array(way)


def test_it_is_the_motion_of_the_equations(pendulum):
    dice = np.random.default_rng(1)
    x0, inputs = dice.normal(size=(37, 2)), dice.normal(size=(37, 25, 1))
    params = np.column_stack([dice.uniform(0.3, 0.7, 37), np.full(37, 0.5), dice.uniform(0, 0.1, 37)])
    ways = tiller.rollout(pendulum, x0, inputs, params)
    assert ways.shape == (37, 26, 2)
    for k in range(37):
        np.testing.assert_allclose(ways[k], reference(pendulum, x0[k], inputs[k], params[k]), atol=2e-4)


def test_shapes_that_share_rows(pendulum):
    dice = np.random.default_rng(2)
    x0, inputs, params = dice.normal(size=2), dice.normal(size=(9, 1)), pendulum.prior_centre
    one = tiller.rollout(pendulum, x0, inputs)
    assert one.shape == (10, 2)
    for state, control, value in ((np.tile(x0, (5, 1)), inputs, params), (x0, np.tile(inputs, (5, 1, 1)), params),
                                  (x0, inputs, np.tile(params, (5, 1)))):
        ways = tiller.rollout(pendulum, state, control, value)
        assert ways.shape == (5, 10, 2) and all(np.array_equal(way, one) for way in ways)


def test_threads_lists_and_single_precision(pendulum):
    dice = np.random.default_rng(3)
    x0, inputs = dice.normal(size=(500, 2)), dice.normal(size=(500, 30, 1))
    one = tiller.rollout(pendulum, x0, inputs, threads=1)
    assert one.tobytes() == tiller.rollout(pendulum, x0, inputs, threads=3).tobytes()
    assert np.array_equal(one[0], tiller.rollout(pendulum, x0[0].tolist(), inputs[0].tolist()))
    assert np.array_equal(one[:, ::1], tiller.rollout(pendulum, np.asfortranarray(x0), np.asfortranarray(inputs)))
    single = tiller.rollout(pendulum, x0, inputs, dtype=np.float32)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, one, atol=2e-4, rtol=1e-4)
    out = np.empty_like(one)
    assert tiller.rollout(pendulum, x0, inputs, out=out) is out and np.array_equal(out, one)


@pytest.mark.parametrize("arguments, error, words", [
    ((np.zeros(3), np.zeros((5, 1))), ValueError, ["x0", "(3,)", "angle_rad"]),
    ((np.zeros(2), np.zeros(5)), ValueError, ["U", "(5,)", "torque_Nm"]),
    ((np.zeros((4, 2)), np.zeros((3, 5, 1))), ValueError, ["rows"]),
    ((np.zeros(2), np.zeros((5, 1)), np.zeros(2)), ValueError, ["params", "mass_kg"]),
    ((np.zeros(2), np.zeros((0, 1))), ValueError, ["U", "one step"]),
    (("no", np.zeros((5, 1))), TypeError, ["x0", "'no'"]),
    (([0, float("nan")], np.zeros((5, 1))), ValueError, ["x0", "NaN", "rate_rad_s"]),
    ((np.zeros((40, 2)), np.where(np.arange(200).reshape(40, 5, 1) == 111, np.inf, 0)), ValueError,
     ["U", "infinity", "torque_Nm", "U[22, 1, 0]"]),
])
def test_errors(pendulum, arguments, error, words):
    with pytest.raises(error) as caught:
        tiller.rollout(pendulum, *arguments)
    assert isinstance(caught.value, tiller.ArgumentError) and caught.value.remedy
    for word in words:
        assert word in str(caught.value)


def test_options_are_checked(pendulum):
    with pytest.raises(tiller.ArgumentError, match="dtype"):
        tiller.rollout(pendulum, np.zeros(2), np.zeros((5, 1)), dtype=int)
    with pytest.raises(tiller.ArgumentError, match="threads"):
        tiller.rollout(pendulum, np.zeros(2), np.zeros((5, 1)), threads=0)
    with pytest.raises(tiller.ArgumentError, match="out"):
        tiller.rollout(pendulum, np.zeros(2), np.zeros((5, 1)), out=np.zeros((1, 5, 2)))


@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_ends_a_long_call(tmp_path, threads):
    """One call of 1e7 periods in 64 substeps, some 20 s: when it is cut, its last lanes are as they were."""
    text = (ROOT / "robots/cart_pole.toml").read_text(encoding="utf-8")
    assert "substeps" not in text
    (tmp_path / "slow.toml").write_text(text.replace("[model]", "[model]\nsubsteps = 64", 1), encoding="utf-8")
    script = textwrap.dedent(f"""
        import signal, numpy as np, tiller
        signal.signal(signal.SIGINT, signal.default_int_handler)  # which a job in the background is started without
        robot = tiller.Robot.from_toml({str(tmp_path / "slow.toml")!r})
        out = np.full((100000, 101, 4), np.nan)
        try:
            print("ready", flush=True)
            tiller.rollout(robot, np.zeros((100000, 4)), np.zeros((100, 1)), out=out, threads={threads})
        except KeyboardInterrupt:
            print("cut", np.isfinite(out[0]).all(), np.isnan(out[-1]).all(), flush=True)
    """)
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=dict(os.environ))
    try:
        assert process.stdout.readline().strip() == "ready"
        time.sleep(1)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=120)[0].strip() == "cut True True" and process.returncode == 0
    finally:
        process.kill()  # where it did not end by itself
