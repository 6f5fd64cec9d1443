"""# A swing-up whose pendulum is not known

The robot file gives mass and damping as priors. The plant is simulated by ODE, with a mass and a damping that the
controller is not told. It pumps the pendulum up and learns both on the way.
"""
# %%
import math
from typing import Any

import numpy as np

import tiller

robot = tiller.Robot.from_toml("pendulum")
controller = tiller.Controller(robot)
plant = tiller.Plant(robot)
learnt = [k for k, sd in enumerate(controller.posterior.sd) if sd > 0]  # the length is the drawing's
print([robot.params[k] for k in learnt], "true:", plant.true_params[learnt])

# %% The loop: a measurement in, a command out. prepare() does what need not wait for the next measurement.
seen = []
controller.arm()
for measurement in tiller.lockstep(plant, seconds=6):
    command = controller.tick(measurement.t, measurement)
    plant.step(command)
    controller.prepare()
    # what the controller shows are views of its own memory: copy what must stay
    band = controller.posterior.quantiles([0.05, 0.5, 0.95])[:, learnt]
    seen.append([measurement.t, plant.true_state[0], *band.ravel()])

# %% What it knows at the end
known = controller.posterior
for name, mean, sd, true in zip(robot.params, known.mean, known.sd, plant.true_params):
    print(f"{name:14} {mean:.4f} +- {sd:.4f}   true {true:.4f}")
error_rad = math.remainder(float(plant.true_state[0]) - math.pi, 2 * math.pi)
print(f"angle error {error_rad:+.4f} rad, last command {command}")
assert abs(error_rad) < 0.05


# %% The picture: the angle, and the 90 % interval of each parameter with the true value
def picture() -> Any:
    """A matplotlib figure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.subplots(1 + len(learnt), 1, sharex=True)
    rows = np.array(seen)
    t = rows[:, 0] - rows[0, 0]
    axes[0].plot(t, rows[:, 1])
    axes[0].axhline(math.pi, color="0.6", lw=1)
    axes[0].set_ylabel("angle [rad]")
    bands = rows[:, 2:].reshape(len(rows), 3, -1)
    for k, axis in enumerate(axes[1:]):
        axis.fill_between(t, bands[:, 0, k], bands[:, 2, k], alpha=0.25, label="90 % interval")
        axis.plot(t, bands[:, 1, k], label="median")
        axis.axhline(plant.true_params[learnt[k]], color="C1", ls="--", label="true")
        axis.set_ylabel(robot.params[learnt[k]])
    axes[1].legend()
    axes[-1].set_xlabel("time [s]")
    return figure
