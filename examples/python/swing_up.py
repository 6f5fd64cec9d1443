"""A pendulum whose mass and damping are unknown, pumped up and held upright: the whole loop in ten lines."""
import math

import tiller


def main() -> float:
    """Runs the loop; the angle's error at its end, in rad."""
    robot = tiller.Robot.from_toml("pendulum")
    controller = tiller.Controller(robot)
    plant = tiller.Plant(robot)
    controller.arm()
    for measurement in tiller.lockstep(plant, seconds=6):
        command = controller.tick(measurement.t, measurement)
        plant.step(command)
        controller.prepare()

    known = controller.posterior
    for name, mean, sd, true in zip(robot.params, known.mean, known.sd, plant.true_params):
        print(f"{name:14} {mean:.4f} +- {sd:.4f}   true {true:.4f}")
    error = math.remainder(float(plant.true_state[0]) - math.pi, 2 * math.pi)
    print(f"angle error {error:+.4f} rad, command {command}")
    return error


if __name__ == "__main__":
    assert abs(main()) < 0.05
