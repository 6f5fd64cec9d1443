"""# What a model lacks, from logs of a real pendulum

`data/dfki_simple_pendulum` holds logs of a machine. The robot file's model has no friction but damping. `tiller.gap`
finds where model and logs disagree, and names the effect that explains it.
"""
# %%
import pathlib
from typing import Any

import tiller

TOP = pathlib.Path(globals().get("__file__", "examples/python/notebook")).resolve().parents[2]
logs = sorted((TOP / "data/dfki_simple_pendulum").glob("*_measured.csv"))
print([log.name for log in logs])

# %%
result = tiller.gap(TOP / "robots/dfki_pendulum_bare.toml", logs, max_effects=1)
print(result.sentence)
for row in result.rows()[:3]:
    print("  ", {key: value for key, value in list(row.items())[:5]})
print(f"exit code {result.exit_code}; the robot file with the effect: {result.robot_file}")
assert result.exit_code in (0, 1, 2)


# %% The picture: a log, the model as it was, and the model with what was found
def picture() -> Any:
    """A matplotlib figure."""
    figure = result.figure()
    figure.set_size_inches(7, 4)
    return figure
