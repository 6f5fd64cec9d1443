"""A fleet: pendulums with different true masses, one controller each, in threads; then their motions in one batch."""
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import tiller

ROBOT = tiller.Robot.from_toml("pendulum")


def steer(seed: int) -> tuple[float, float]:
    """(estimated, true) mass after two seconds; the interpreter's lock is free while a controller thinks."""
    controller, plant = tiller.Controller(ROBOT), tiller.Plant(ROBOT, seed=seed)
    controller.arm()
    for measurement in tiller.lockstep(plant, seconds=2):
        plant.step(controller.tick(measurement.t, measurement))
    return float(controller.posterior.mean[0]), float(plant.true_params[0])


def main() -> float:
    """Steers the fleet; the largest relative error of a mass."""
    with ThreadPoolExecutor() as pool:
        masses = np.array(list(pool.map(steer, range(1, 9))))
    errors = np.abs(masses[:, 0] / masses[:, 1] - 1)
    print("masses, estimated and true [kg]\n", masses.round(4))
    params = np.tile(ROBOT.prior_centre, (len(masses), 1))
    params[:, 0] = masses[:, 0]
    ways = tiller.rollout(ROBOT, [0.5, 0.0], np.zeros((100, 1)), params)
    print("angles after two seconds of free swing", ways[:, -1, 0].round(3))
    return float(errors.max())


if __name__ == "__main__":
    assert main() < 0.1
