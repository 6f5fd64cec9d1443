"""An arm of three joints from its URDF: imported, rolled out, and steered in its ODE plant. Needs a C++ compiler."""
import pathlib
import tempfile

import numpy as np

import tiller

URDF = pathlib.Path(__file__).resolve().parents[1] / "from_urdf/my_arm.urdf"


def main() -> float:
    """Imports and steers the arm; the largest joint error at the end, in rad or m."""
    with tempfile.TemporaryDirectory() as folder:
        robot = tiller.Robot.from_urdf(URDF, folder)
        print(robot)
        inputs = np.zeros((20, len(robot.inputs)))
        falls = tiller.rollout(robot, robot.initial_state, inputs)
        print("left alone, the joints go to", falls[-1, :len(robot.inputs)].round(3))
        controller, plant = tiller.Controller(robot), tiller.Plant(robot)
        controller.arm()
        for measurement in tiller.lockstep(plant, seconds=4):
            plant.step(controller.tick(measurement.t, measurement))
        error = np.abs(plant.true_state - robot.target)[:len(robot.inputs)]
        print("joint errors", error.round(4))
        return float(error.max())


if __name__ == "__main__":
    assert main() < 0.2
