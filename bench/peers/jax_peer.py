"""tiller.jax beside tiller.rollout, beside equations written in JAX and beside MuJoCo's MJX: one processor, one
process, in turns. jax_peer.py KERNEL_PROGRAM ROUNDS QUICK; prints lines of JSON {"part", "robot", "name", "figure", ...}."""
import json
import pathlib
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

import tiller
import tiller.jax

jax.config.update("jax_enable_x64", True)
ROBOTS = pathlib.Path(__file__).resolve().parents[2] / "robots"
LANES, STEPS, FEW = 4096, 50, 256  # FEW: of MJX, whose step takes a thousand times as long
IN_A_ROW = 4
PERIOD_S, GRAVITY = 0.02, 9.81

MJCF = """
<mujoco>
  <option timestep="0.02" integrator="RK4" gravity="0 0 -9.81">
    <flag contact="disable" constraint="disable"/></option>
  <worldbody>{}</worldbody>
  <actuator><motor joint="driven" gear="1"/></actuator>
</mujoco>"""
WORLDS = {
    "pendulum": """<body><joint name="driven" type="hinge" axis="0 -1 0" damping=".05"/>
      <inertial pos="0 0 -.5" mass=".5" diaginertia="1e-6 1e-6 1e-6"/></body>""",
    "cart_pole": """<body><joint name="driven" type="slide" axis="1 0 0" damping=".2"/>
      <inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>
      <body><joint name="pole" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 .5" mass=".1" diaginertia=".00833333333 .00833333333 1e-6"/></body></body>""",
}


def pendulum_rate(x, u, p):
    mass, length, damping = p
    return jnp.stack([x[1], (u[0] - damping * x[1] - mass * GRAVITY * length * jnp.sin(x[0])) / (mass * length**2)])


def cart_pole_rate(x, u, p):
    cart, pole, half, damping = p
    s, c = jnp.sin(x[1]), jnp.cos(x[1])
    whole, moment, inertia = cart + pole, pole * half, pole * half**2 * 4 / 3
    coupling, push, turn = moment * c, u[0] - damping * x[2] + moment * s * x[3]**2, moment * GRAVITY * s
    inverse = 1 / (whole * inertia - coupling**2)
    return jnp.stack([x[2], x[3], (inertia * push - coupling * turn) * inverse,
                      (whole * turn - coupling * push) * inverse])


RATES = {"pendulum": pendulum_rate, "cart_pole": cart_pole_rate}


def by_scan(rate):
    """A trajectory by the textbook: RK4 in lax.scan."""
    def step(x, u, p):
        a = rate(x, u, p)
        b = rate(x + PERIOD_S / 2 * a, u, p)
        c = rate(x + PERIOD_S / 2 * b, u, p)
        return x + PERIOD_S / 6 * (a + 2 * b + 2 * c + rate(x + PERIOD_S * c, u, p))

    def roll(x0, u, p):
        def advance(x, u):
            x = step(x, u, p)
            return x, x
        return jax.lax.scan(advance, x0, u)[1]
    return roll


def by_mjx(name):
    import mujoco
    from mujoco import mjx

    model = mjx.put_model(mujoco.MjModel.from_xml_string(MJCF.format(WORLDS[name])))
    empty = mjx.make_data(model)

    def roll(x0, u, _):
        def advance(data, u):
            data = mjx.step(model, data.replace(ctrl=u))
            return data, jnp.concatenate([data.qpos, data.qvel])
        half = x0.shape[0] // 2
        return jax.lax.scan(advance, empty.replace(qpos=x0[:half], qvel=x0[half:]), u)[1]
    return roll


def tell(**row):
    print(json.dumps(row), flush=True)


def problem(robot, lanes, dtype):
    x0 = np.full((lanes, len(robot.states)), 0.1, dtype)
    u = (0.01 * (np.arange(lanes * STEPS) % 97) - 0.5).astype(dtype).reshape(lanes, STEPS, 1)
    return jnp.asarray(x0), jnp.asarray(u), jnp.asarray(robot.prior_centre, dtype)


def nanoseconds(call, work):
    """Of the processor, all threads together: what else runs here does not count. The fastest of some calls in a row,
    as the kernel's own program has it: a call right after another participant's finds its memory cold."""
    best = float("inf")
    for _ in range(IN_A_ROW):
        begin = time.process_time_ns()
        jax.block_until_ready(call())
        best = min(best, time.process_time_ns() - begin)
    return best / work


# ---- exactness --------------------------------------------------------------------------------------------


def count_bits():
    """Numbers of tiller.jax that are not those of tiller.rollout, over every robot, both types."""
    for dtype in (np.float64, np.float32):
        wrong = compared = 0
        for name in tiller.robot_names():
            robot, dice = tiller.Robot.from_toml(name), np.random.default_rng(1)
            x0 = (robot.initial_state + 0.1 * dice.normal(size=(100, len(robot.states)))).astype(dtype)
            low, high = np.maximum(robot.input_low, -5), np.minimum(robot.input_high, 5)
            u = dice.uniform(low, high, (100, STEPS, len(low))).astype(dtype)
            a = np.asarray(tiller.jax.rollout(robot, x0, u, np.asarray(robot.prior_centre, dtype)))
            b = tiller.rollout(robot, x0, u, dtype=dtype)
            wrong += int((a != b).sum() - (np.isnan(a) & np.isnan(b)).sum())
            compared += a.size
        tell(part="bits", name=np.dtype(dtype).name, figure=wrong, compared=compared)


def differences(f, x, size):
    """Central, of fourth order, in double."""
    columns = []
    for i in range(x.size):
        unit = np.zeros(x.size)
        unit[i] = size
        at = lambda k: f(x + k * unit.reshape(x.shape))
        columns.append((8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * size))
    return np.stack(columns, -1)


def compare_gradients():
    """The largest error of a Jacobian's entry over its largest entry, against differences of tiller.rollout; of a
    parameter in shares of itself, as fits by logarithms have it."""
    for name in tiller.robot_names():
        robot, dice = tiller.Robot.from_toml(name), np.random.default_rng(2)
        x0 = robot.initial_state + 0.1 * dice.normal(size=len(robot.states))
        low, high = np.maximum(robot.input_low, -5), np.minimum(robot.input_high, 5)
        u, centre = low + (high - low) * dice.uniform(0.2, 0.8, (12, len(low))), np.array(robot.prior_centre)
        arguments, worst = (x0, u, np.ones(centre.size)), 0.0
        found = jax.jacrev(lambda x, v, s, r=robot, c=centre: tiller.jax.rollout(r, x, v, c * s), (0, 1, 2))(*arguments)
        for k, jacobian in enumerate(found):
            def f(value, k=k, robot=robot, arguments=arguments, centre=centre):
                x, v, s = (*arguments[:k], value, *arguments[k + 1:])
                return tiller.rollout(robot, x, v, centre * s, threads=1)
            # a foot's touchdown is a corner, rounded over less than 1e-4 m
            wanted = differences(f, arguments[k], 3e-6 if name == "hopper" else 1e-4)
            error = np.abs(np.asarray(jacobian).reshape(wanted.shape) - wanted).max()
            worst = max(worst, error / max(1e-9, np.abs(wanted).max()))
        tell(part="gradients", robot=name, figure=worst)


# ---- speed ------------------------------------------------------------------------------------------------


def gradient_of(roll):
    """By start, inputs and parameters, of every trajectory's sum of squares."""
    return lambda *a: jax.grad(lambda x, u, p: (roll(x, u, p)**2).sum(), (0, 1, 2))(*a)


def participants(name, dtype, kernel, quick):
    """name -> (what it does, lanes x steps of a call)."""
    robot, path = tiller.Robot.from_toml(name), ROBOTS / f"{name}.toml"
    given, whole = problem(robot, LANES, dtype), LANES * STEPS
    x0, u, p = map(np.asarray, given)
    out = np.empty((LANES, STEPS + 1, len(robot.states)), dtype)
    kernel_of = lambda x, v, p: tiller.jax.rollout(robot, x, v, p, threads=1)
    equations = by_scan(RATES[name])
    lanes = jax.jit(jax.vmap(equations, (0, 0, None)))
    apart = float(jnp.abs(kernel_of(*given)[:, 1:] - lanes(*given)).max())
    tell(part="apart", robot=name, name=np.dtype(dtype).name, figure=apart)

    def call(f):
        compiled = jax.jit(f)
        return lambda: compiled(*given)
    calls = {"tiller.rollout": (lambda: tiller.rollout(robot, x0, u, p, out=out, threads=1, dtype=dtype), whole),
             "tiller.jax": (call(kernel_of), whole), "tiller.jax gradient": (call(gradient_of(kernel_of)), whole),
             "equations in JAX": (lambda: lanes(*given), whole),
             "equations in JAX, gradient": (call(gradient_of(jax.vmap(equations, (0, 0, None)))), whole)}
    if dtype == np.float64:
        command = [kernel, "rollout", path, str(LANES), str(STEPS)]
        ask = lambda: json.loads(subprocess.run(list(map(str, command)), capture_output=True, check=True).stdout)
        calls["kernel"] = (lambda: ask()["kernel_ns"], 0)
        if not quick:
            few = problem(robot, FEW, dtype)
            mjx = jax.jit(jax.vmap(by_mjx(name), (0, 0, None)))
            apart = float(jnp.abs(kernel_of(*few)[:, 1:] - mjx(*few)).max())
            tell(part="apart", robot=name, name="MJX", figure=apart)
            calls["MJX"] = (lambda: mjx(*few), FEW * STEPS)
    return calls


def measure(kernel, rounds, quick):
    for name in RATES:
        for dtype in (np.float64, np.float32):
            calls, times = participants(name, dtype, kernel, quick), {}
            for round_ in range(rounds + 1):
                for who, (call, work) in calls.items():
                    ns = nanoseconds(call, work) if work else call()
                    if round_:  # the first one compiles
                        times.setdefault(who, []).append(ns)
            for who, all_ns in times.items():
                tell(part="speed", robot=name, type=np.dtype(dtype).name, name=who, figure=min(all_ns),
                     median=float(np.median(all_ns)))


def main():
    count_bits()
    compare_gradients()
    measure(sys.argv[1], int(sys.argv[2]), sys.argv[3] == "1")


main()
