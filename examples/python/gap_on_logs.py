"""# What a model lacks, from logs of a real pendulum

`data/dfki_simple_pendulum` holds logs of a machine. The robot file's model is bob and rod alone. `tiller.gap` finds
where model and logs disagree, names the effect that explains it, and says how sure that is: two swing-ups of five
seconds are little.
"""
# %%
import pathlib
from typing import Any

import tiller

TOP = pathlib.Path(globals().get("__file__", "examples/python/notebook")).resolve().parents[2]
logs = sorted((TOP / "data/dfki_simple_pendulum").glob("d*_measured.csv"))
print([log.name for log in logs])

# %%
result = tiller.gap(TOP / "robots/dfki_pendulum_bare.toml", logs)
print(result.sentence)
for row in result.rows()[:5]:
    print(f"{row['effects']:60} {row['gain_nats']:8.1f} nats, {row['remaining_sigma']:.2f} sigma remain")
if result.robot_file:  # written where the effect is proven
    print("the robot file with the effect:", result.robot_file)
# two swing-ups do not prove it, and the sentence says so; friction is among what explains them
assert any("friction (joint)" in row["effects"] for row in result.rows())


# %% The picture: a stretch that no fit has seen, beside what the model makes of its first state
def picture() -> Any:
    """A matplotlib figure."""
    figure = result.figure()
    figure.set_size_inches(7, 5)
    return figure
