"""# An arm from its URDF

Three joints, described by a URDF. `tiller import` writes model and robot file from it; both are compiled, rolled out,
and steered in an ODE plant of the same description. Needs a C++ compiler.
"""
# %%
import pathlib
import tempfile
from typing import Any

import numpy as np

import tiller

TOP = pathlib.Path(globals().get("__file__", "examples/python/notebook")).resolve().parents[2]
imported = tempfile.TemporaryDirectory()
robot = tiller.Robot.from_urdf(TOP / "examples/from_urdf/my_arm.urdf", imported.name)
joints = len(robot.inputs)
print(robot)

# %% Left alone, it falls: one rollout, which may as well be thousands
falls = tiller.rollout(robot, robot.initial_state, np.zeros((round(4 / robot.period_s), joints)))
print("left alone, the joints go to", falls[-1, :joints].round(3))

# %% Steered to the target of its robot file
controller, plant = tiller.Controller(robot), tiller.Plant(robot)
controller.arm()
seen = []
for measurement in tiller.lockstep(plant, seconds=4):
    plant.step(controller.tick(measurement.t, measurement))
    seen.append([measurement.t, *plant.true_state[:joints]])
error = np.abs(plant.true_state - robot.target)[:joints]
print("joint errors", error.round(4))
assert error.max() < 0.2


# %% The picture: the joints, steered and left alone
def picture() -> Any:
    """A matplotlib figure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    rows = np.array(seen)
    for k, axis in enumerate(figure.subplots(joints, 1, sharex=True)):
        axis.plot(rows[:, 0] - rows[0, 0], rows[:, 1 + k], label="steered")
        axis.plot(np.arange(len(falls)) * robot.period_s, falls[:, k], color="0.6", label="left alone")
        axis.axhline(robot.target[k], color="C1", ls="--", label="target")
        axis.set_ylabel(robot.states[k])
        if k == 0:
            axis.legend(loc="upper right", ncols=3)
    axis.set_xlabel("time [s]")
    return figure
