"""tiller.jax: values against tiller.rollout to the bit, derivatives against differences of it, and JAX's transforms."""
import pathlib

import numpy as np
import pytest

import tiller

ROOT = pathlib.Path(__file__).resolve().parents[2]

jax = pytest.importorskip("jax")
jax.config.update("jax_enable_x64", True)
if not hasattr(tiller._core, "jax_targets"):
    pytest.skip("this build has no primitives for JAX: no jaxlib where it was configured", allow_module_level=True)
import jax.numpy as jnp  # noqa: E402

import tiller.jax  # noqa: E402

HORIZON = 12


def start(robot, seed=3, lanes=()):
    """A state near the robot's first, inputs within its limits and parameters near the prior's centre."""
    dice = np.random.default_rng(seed)
    x0 = robot.initial_state + 0.1 * dice.normal(size=(*lanes, len(robot.states)))
    low, high = np.maximum(robot.input_low, -5), np.minimum(robot.input_high, 5)
    u = low + (high - low) * dice.uniform(0.2, 0.8, (*lanes, HORIZON, len(robot.inputs)))
    return x0, u, np.array(robot.prior_centre) * dice.uniform(0.99, 1.01, (*lanes, len(robot.params)))


def difference(f, x, size, relative=False):
    """d f / d x by central differences of fourth order; what they leave is some 1e-10 of a smooth function's."""
    columns = []
    for i in np.ndindex(x.shape):
        h = size * (abs(x[i]) if relative and x[i] != 0 else 1.0)
        at = lambda k: f(np.array([v + (k * h if j == i else 0) for j, v in np.ndenumerate(x)]).reshape(x.shape))
        columns.append((8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h))
    return np.stack(columns, -1).reshape(*np.shape(columns[0]), *x.shape)


def robot_with(effect):
    text = (ROOT / "robots/pendulum.toml").read_text(encoding="utf-8")
    return tiller.Robot.from_text(text.replace("[measurement]", effect + "\n[measurement]", 1))


LAG = '[[effects]]\nkind = "actuator_lag"\nport = "torque_Nm"\ntime_constant_s = { uniform = [0.02, 0.1] }\n'
DELAY = '[[effects]]\nkind = "input_delay"\nport = "torque_Nm"\ndelay_s = { uniform = [0.0, 0.05] }\n'


# ---- values ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("name", tiller.robot_names())
def test_values_are_the_kernels_to_the_bit(name, dtype):
    robot = tiller.Robot.from_toml(name)
    x0, u, params = (a.astype(dtype) for a in start(robot, lanes=(37,)))
    for p in (params, params[0]):
        ways = tiller.jax.rollout(robot, x0, u, p)
        assert ways.dtype == dtype and ways.shape == (37, HORIZON + 1, len(robot.states))
        assert np.asarray(ways).tobytes() == tiller.rollout(robot, x0, u, p, dtype=dtype).tobytes()


def test_a_delayed_robot_rolls_out_with_its_history():
    robot = robot_with(DELAY)
    x0, u, params = start(robot)
    history = np.linspace(-1, 1, 3).reshape(3, 1)
    wanted = tiller.rollout(robot, x0, u, params, history=history)
    assert np.array_equal(jax.jit(lambda h: tiller.jax.rollout(robot, x0, u, params, history=h))(history), wanted)


def test_cost_is_that_of_every_step():
    robot = tiller.Robot.from_toml("acrobot")
    x0, u, params = start(robot)
    double = [tiller.jax.cost(robot, x0, np.repeat(u[:1], n, 0), params) for n in (1, 2)]
    assert double[0].shape == () and double[1] > double[0] > 0
    many = tiller.jax.cost(robot, np.tile(x0, (3, 1)), u, params)
    assert many.shape == (3,) and np.ptp(many) == 0


def test_leading_dimensions_broadcast():
    robot = tiller.Robot.from_toml("cart_pole")
    x0, u, params = start(robot, lanes=(2, 3))
    ways = tiller.jax.rollout(robot, x0[:, :1], u[0], params[0, 0])
    assert ways.shape == (2, 3, HORIZON + 1, 4)
    for i, j in np.ndindex(2, 3):
        assert np.array_equal(ways[i, j], tiller.rollout(robot, x0[i, 0], u[0, j], params[0, 0]))


def test_a_dictionary_of_parameters_leaves_the_others_at_the_prior():
    robot = tiller.Robot.from_toml("pendulum")
    x0, u, _ = start(robot)
    params = np.array(robot.prior_centre)
    params[robot.params.index("mass_kg")] = 0.3
    wanted = tiller.rollout(robot, x0, u, params)
    assert np.array_equal(tiller.jax.rollout(robot, x0, u, {"mass_kg": 0.3}), wanted)
    both = tiller.jax.rollout(robot, x0, u, {"mass_kg": jnp.array([0.2, 0.3])})
    assert both.shape == (2, HORIZON + 1, 2) and np.array_equal(both[1], wanted)
    assert np.array_equal(tiller.jax.rollout(robot, x0, u), tiller.rollout(robot, x0, u))


# ---- derivatives ----------------------------------------------------------------------------------------


def check_derivatives(robot, tolerance=1e-6, seed=3, size=1e-4):
    """Forward and backward, of states and cost, by everything; tolerance: of the largest entry. size: of differences,
    of a parameter relative to it."""
    arguments = start(robot, seed)
    roll = lambda *a: np.asarray(tiller.jax.rollout(robot, *a, threads=1))
    cost = lambda *a: np.asarray(tiller.jax.cost(robot, *a, threads=1))
    for values, function in ((roll, tiller.jax.rollout), (cost, tiller.jax.cost)):
        f = lambda *a, function=function: function(robot, *a)
        found = jax.jacrev(f, (0, 1, 2))(*arguments), jax.jacfwd(f, (0, 1, 2))(*arguments)
        for k, name in enumerate(("x0", "u", "params")):
            at = lambda v, k=k, values=values: values(*arguments[:k], v, *arguments[k + 1:])
            wanted = difference(at, arguments[k], size, relative=name == "params")
            for jacobian in found:
                assert jacobian[k].shape == wanted.shape
                most = tolerance * max(1e-9, np.abs(wanted).max())
                np.testing.assert_allclose(jacobian[k], wanted, rtol=0, atol=most, err_msg=f"by {name}")


@pytest.mark.parametrize("name", tiller.robot_names())
def test_derivatives_are_those_of_differences(name):
    # a foot's touchdown is a corner, rounded over less than 1e-4 m
    check_derivatives(tiller.Robot.from_toml(name), size=3e-6 if name == "hopper" else 1e-4)


def test_effects_with_states_are_differentiated_with_them():
    check_derivatives(robot_with(LAG))


def test_a_model_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.setenv("TILLER_CACHE", str(tmp_path / "models"))
    own = ROOT / "examples/own_model"
    check_derivatives(tiller.Robot.from_model_header(own / "ball_and_beam.hpp", "BallAndBeam", own / "robot.toml"))


def test_single_precision_has_derivatives_in_double():
    robot = tiller.Robot.from_toml("cart_pole")
    arguments = start(robot)
    slope = jax.grad(lambda *a: tiller.jax.cost(robot, *a), (0, 1, 2))
    for exact, single in zip(slope(*arguments), slope(*(a.astype(np.float32) for a in arguments)), strict=True):
        assert single.dtype == np.float32
        # of states that single precision rounds
        np.testing.assert_allclose(single, exact, atol=1e-4 * np.abs(exact).max())


def test_jit_vmap_and_scan():
    robot = tiller.Robot.from_toml("pendulum")
    x0, u, params = start(robot, lanes=(5,))
    cost = lambda x, v, p: tiller.jax.cost(robot, x, v, p)
    slope = jax.grad(cost, (0, 1, 2))
    many = jax.jit(jax.vmap(slope))(x0, u, params)
    one = jax.jit(jax.vmap(slope, (None, 0, None)))(x0[0], u, params[0])
    for i in range(5):
        for got, wanted in zip((*(m[i] for m in many), *(m[i] for m in one)),
                               (*slope(x0[i], u[i], params[i]), *slope(x0[0], u[i], params[0])), strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-12)
    # what all lanes share has the sum of their slopes
    shared = jax.grad(lambda p: cost(x0, u, p).sum())(params[0])
    np.testing.assert_allclose(shared, sum(slope(x, v, params[0])[2] for x, v in zip(x0, u, strict=True)), rtol=1e-10)

    def by_steps(x, v, p):
        return jax.lax.scan(lambda x, u: (tiller.jax.step(robot, x, u, p),) * 2, x, v)[1]

    roll = lambda x, v, p: tiller.jax.rollout(robot, x, v, p)[1:]
    arguments = x0[0], u[0], params[0]
    assert np.array_equal(jax.jit(by_steps)(*arguments), roll(*arguments))
    for a, b in zip(jax.jacrev(by_steps, (0, 1, 2))(*arguments), jax.jacfwd(roll, (0, 1, 2))(*arguments), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_a_policy_is_differentiated_through():
    """The gradient of a closed loop by the policy's gain, against differences."""
    robot = tiller.Robot.from_toml("cart_pole")

    def cost(gain):
        def advance(x, _):
            x = tiller.jax.step(robot, x, jnp.dot(gain, x)[None])
            return x, jnp.sum(x**2)
        return jax.lax.scan(advance, jnp.array([0.1, 0.2, 0.0, 0.0]), None, 30)[1].sum()

    gain = np.array([0.5, 20.0, 1.0, 3.0])
    np.testing.assert_allclose(jax.jit(jax.grad(cost))(gain), difference(jax.jit(cost), gain, 1e-4), rtol=1e-7)


def test_the_guides_example_finds_the_mass():
    if not (ROOT / "docs/guide/jax.md").exists():
        pytest.skip("no guide beside these tests")
    block = (ROOT / "docs/guide/jax.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    space = {}
    exec(compile(block, "docs/guide/jax.md", "exec"), space)
    np.testing.assert_allclose(space["p"], [0.63, 0.04], rtol=1e-3)


# ---- what is refused --------------------------------------------------------------------------------------


def test_second_derivatives_and_delays_are_refused():
    robot, delayed = tiller.Robot.from_toml("pendulum"), robot_with(DELAY)
    x0, u, params = start(robot)
    with pytest.raises(tiller.Error, match="first derivatives"):
        jax.hessian(lambda p: tiller.jax.cost(robot, x0, u, p))(params)
    with pytest.raises(tiller.Error, match="input delay"):
        jax.grad(lambda m: tiller.jax.cost(delayed, x0, u, {"mass_kg": m}))(0.4)
    for remembering in (delayed, robot_with(LAG)):
        with pytest.raises(tiller.ArgumentError, match=r"step.*remember.*tiller\.jax\.rollout"):
            tiller.jax.step(remembering, x0, u[0])


@pytest.mark.parametrize("arguments, error, words", [
    ((np.zeros(3), np.zeros((5, 1))), ValueError, ["x0", "(3,)", "nx = 2", "angle_rad"]),
    ((np.zeros(2), np.zeros(5)), ValueError, ["u", "(5,)", "(..., H, nu)", "torque_Nm"]),
    ((np.zeros(2), np.zeros((0, 1))), ValueError, ["u", "(0, 1)", "one step"]),
    ((np.zeros((4, 2)), np.zeros((3, 5, 1))), ValueError, ["(4,)", "(3,)", "broadcast"]),
    ((np.zeros(2), np.zeros((5, 1)), np.zeros(2)), ValueError, ["params", "(2,)", "np = 3", "mass_kg"]),
    ((np.zeros(2), np.zeros((5, 1)), {"mass": 1.0}), ValueError, ["params", "'mass'", "mass_kg"]),
    ((np.zeros(2, np.float16), np.zeros((5, 1))), TypeError, ["x0", "float16", "float32"]),
    (("no", np.zeros((5, 1))), TypeError, ["x0", "'no'"]),
])
def test_errors_name_argument_shape_and_remedy(arguments, error, words):
    robot = tiller.Robot.from_toml("pendulum")
    for function in (tiller.jax.rollout, tiller.jax.cost):
        with pytest.raises(error) as caught:
            function(robot, *arguments)
        assert isinstance(caught.value, tiller.ArgumentError) and caught.value.remedy
        for word in (f"tiller.jax.{function.__name__}", *words):
            assert word in str(caught.value)
    with pytest.raises(tiller.ArgumentTypeError, match=r"robot.*tiller\.Robot"):
        tiller.jax.rollout(None, np.zeros(2), np.zeros((5, 1)))
    with pytest.raises(tiller.ArgumentError, match="threads"):
        tiller.jax.rollout(robot, np.zeros(2), np.zeros((5, 1)), threads=0)
    with pytest.raises(tiller.ArgumentError, match=r"history.*\(2, 1\).*\(0, 1\)"):
        tiller.jax.rollout(robot, np.zeros(2), np.zeros((5, 1)), history=np.zeros((2, 1)))


def test_threads_do_not_change_the_bits():
    robot = tiller.Robot.from_toml("cart_pole")
    x0, u, params = start(robot, lanes=(500,))
    for f in (tiller.jax.rollout, tiller.jax.cost,
              lambda *a, threads: jax.grad(lambda v: tiller.jax.cost(*a[:2], v, a[3], threads=threads).sum())(a[2])):
        one, three = (np.asarray(f(robot, x0, u, params, threads=n)).tobytes() for n in (1, 3))
        assert one == three
