"""MuJoCo's batched rollout on the cart-pole of the comparisons, one thread: 64 rollouts of 50 steps a call."""

import mujoco
import mujoco.rollout
import numpy as np

from rounds import cpu_per_call, take_part

XML = """
<mujoco><option timestep="0.02" gravity="0 0 -9.81" integrator="Euler"><flag contact="disable"/></option>
<worldbody><body name="cart"><joint name="slide" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
<body name="pole"><joint name="hinge" type="hinge" axis="0 1 0"/>
<inertial pos="0 0 0.5" mass="0.1" diaginertia="0.00833333333333333 0.00833333333333333
1e-4"/></body></body></worldbody> <actuator><motor joint="slide"/></actuator></mujoco>
"""


def plain(u):
    """The same steps by hand."""
    x = np.array([0.0, np.pi, 0.0, 0.0])
    for force in u:
        s, c, all_, h, j = np.sin(x[1]), np.cos(x[1]), 1.1, 0.05, 0.1 * 0.25 * 4 / 3
        push, turn = force + h * s * x[3] ** 2, h * 9.81 * s
        det = all_ * j - h * h * c * c
        x[2] += 0.02 * (j * push - h * c * turn) / det
        x[3] += 0.02 * (all_ * turn - h * c * push) / det
        x[0] += 0.02 * x[2]
        x[1] += 0.02 * x[3]
    return x


def main():
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    batch, steps = 64, 50
    start = np.tile(np.array([0.0, 0.0, np.pi, 0.0, 0.0]), (batch, 1))
    control = np.random.default_rng(1).uniform(-10, 10, (batch, steps, 1))
    run = lambda: mujoco.rollout.rollout(model, data, start, control)
    state, _ = run()
    error = max(float(np.abs(state[i, -1, 1:] - plain(control[i, :, 0])).max()) for i in range(batch))
    take_part({"MuJoCo rollout": (lambda: cpu_per_call(run) / (batch * steps), {"error": error})})


main()
