"""# A model of one's own

A ball rolls on a beam. The model is a C++ header that tiller does not ship; it is compiled when the robot is made,
which needs a C++ compiler. The plant is not tiller's either: it is a few lines of Python.
"""
# %%
import math
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt

import tiller

TOP = pathlib.Path(globals().get("__file__", "examples/python/notebook")).resolve().parents[2]
FOLDER = TOP / "examples/own_model"
robot = tiller.Robot.from_model_header(FOLDER / "ball_and_beam.hpp", "BallAndBeam", FOLDER / "robot.toml")
print(robot)

# %% The plant: Lagrange's equations of a solid ball that rolls, by small steps
BALL_KG, INERTIA_KGM2, DAMPING_NMS = 0.13, 0.035, 0.02  # what the controller does not know


def step(x: npt.NDArray[np.float64], torque_Nm: float, dt_s: float) -> npt.NDArray[np.float64]:
    """The state (position, angle, their speeds) after dt_s."""
    for _ in range(40):
        s, a, v, w = x
        roll = (s * w * w - 9.81 * math.sin(a)) / 1.4
        turn = (torque_Nm - DAMPING_NMS * w - 2 * BALL_KG * s * v * w - BALL_KG * 9.81 * s * math.cos(a)) / (
            INERTIA_KGM2 + BALL_KG * s * s)
        x = x + dt_s / 40 * np.array([v, w, roll, turn])
    return x


# %% The loop: sensors of position and angle with a millimetre and a milliradian of noise
controller = tiller.Controller(robot)
controller.arm()
dice, x = np.random.default_rng(1), robot.initial_state.copy()
seen = []
for k in range(round(8 / robot.period_s)):
    y = x[:2] + 0.001 * dice.normal(size=2)
    command = controller.tick(1 + k * robot.period_s, y)
    x = step(x, float(command.value[0]), robot.period_s)
    seen.append([k * robot.period_s, x[0], *controller.posterior.quantiles([0.05, 0.5, 0.95])[:, 0]])
print(f"ball at {x[0]:+.4f} m, mass {controller.posterior.mean[0]:.3f} kg (true {BALL_KG})")
assert abs(x[0]) < 0.05


# %% The picture: where the ball is, and what its mass is thought to be
def picture() -> Any:
    """A matplotlib figure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    t, ball, low, middle, high = np.array(seen).T
    above.plot(t, ball)
    above.axhline(0, color="0.6", lw=1)
    above.set_ylabel("ball [m]")
    below.fill_between(t, low, high, alpha=0.25)
    below.plot(t, middle)
    below.axhline(BALL_KG, color="C1", ls="--")
    below.set_ylabel("mass of the ball [kg]")
    below.set_xlabel("time [s]")
    return figure
