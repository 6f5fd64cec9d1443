"""A model of one's own, a ball on a beam in a C++ header, and a plant of one's own in Python. Needs a C++ compiler."""
import math
import pathlib

import numpy as np
import numpy.typing as npt

import tiller

FOLDER = pathlib.Path(__file__).resolve().parents[1] / "own_model"
BALL_KG, INERTIA_KGM2, DAMPING_NMS = 0.13, 0.035, 0.02  # what the controller does not know


def step(x: npt.NDArray[np.float64], torque_Nm: float, dt_s: float) -> npt.NDArray[np.float64]:
    """Lagrange's equations of a rolling solid ball, by small steps."""
    for _ in range(40):
        s, a, v, w = x
        roll = (s * w * w - 9.81 * math.sin(a)) / 1.4
        turn = (torque_Nm - DAMPING_NMS * w - 2 * BALL_KG * s * v * w - BALL_KG * 9.81 * s * math.cos(a)) / (
            INERTIA_KGM2 + BALL_KG * s * s)
        x = x + dt_s / 40 * np.array([v, w, roll, turn])
    return x


def main() -> float:
    """Runs the loop; the ball's distance from the pivot at its end, in m."""
    robot = tiller.Robot.from_model_header(FOLDER / "ball_and_beam.hpp", "BallAndBeam", FOLDER / "robot.toml")
    controller = tiller.Controller(robot)
    controller.arm()
    dice, x = np.random.default_rng(1), robot.initial_state.copy()
    for k in range(round(8 / robot.period_s)):
        y = x[:2] + 0.001 * dice.normal(size=2)
        command = controller.tick(1 + k * robot.period_s, y)
        x = step(x, float(command.value[0]), robot.period_s)
    print(f"ball at {x[0]:+.4f} m, mass {controller.posterior.mean[0]:.3f} kg (true {BALL_KG})")
    return float(abs(x[0]))


if __name__ == "__main__":
    assert main() < 0.05
