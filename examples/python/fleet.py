"""# A fleet

Eight pendulums with different true masses, a controller for each, in threads: a controller that thinks leaves Python's
lock to the others. Then all of their motions in one batch.
"""
# %%
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

import tiller

robot = tiller.Robot.from_toml("pendulum")


def steer(seed: int) -> tuple[float, float, float, float]:
    """Two seconds of one robot: 5 %, median and 95 % of its mass, and the true one."""
    controller, plant = tiller.Controller(robot), tiller.Plant(robot, seed=seed)
    controller.arm()
    for measurement in tiller.lockstep(plant, seconds=2):
        plant.step(controller.tick(measurement.t, measurement))
    low, middle, high = controller.posterior.quantiles([0.05, 0.5, 0.95])[:, 0]
    return float(low), float(middle), float(high), float(plant.true_params[0])


# %%
with ThreadPoolExecutor() as pool:
    masses = np.array(list(pool.map(steer, range(1, 9))))
print("masses, 5 %, median, 95 %, true [kg]\n", masses.round(4))
assert np.abs(masses[:, 1] / masses[:, 3] - 1).max() < 0.1

# %% Let go, each of them swings in its own way: eight motions in one call
params = np.tile(robot.prior_centre, (len(masses), 1))
params[:, 0] = masses[:, 1]
ways = tiller.rollout(robot, [0.5, 0.0], np.zeros((150, 1)), params)
print("angles at the end of a free swing", ways[:, -1, 0].round(3))


# %% The picture: what is known of each robot, and the swings
def picture() -> Any:
    """A matplotlib figure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    above, below = figure.subplots(2, 1)
    numbers = np.arange(1, len(masses) + 1)
    off = 100 * (masses[:, :3] / masses[:, 3:] - 1)
    above.vlines(numbers, off[:, 0], off[:, 2], lw=6, alpha=0.4, label="90 % interval")
    above.plot(numbers, off[:, 1], "C0o", label="median")
    above.axhline(0, color="C1", ls="--", label="true")
    above.set_xlabel("robot")
    above.set_ylabel("mass, error [%]")
    above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    below.plot(np.arange(ways.shape[1]) * robot.period_s, ways[:, :, 0].T, lw=1)
    below.set_xlabel("time [s]")
    below.set_ylabel("angle [rad]")
    return figure
