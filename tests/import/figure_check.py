"""figure_check.py RUN.csv FRAME: the link FRAME of the run's figure stands and points where the model's own outputs say."""

import json
import os
import sys
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

import numpy as np  # noqa: E402

from tiller_tools import figure, table  # noqa: E402

path, frame = Path(sys.argv[1]), sys.argv[2]
log = table.read_table(path, text=("state", "status"))
facts = json.loads(path.with_suffix(".json").read_text())["figure"]
named = dict(facts["parameters"])
named |= {name: log[f"mean.{name}"] for name in figure.names_of(facts) if f"mean.{name}" in log}
poses = figure.poses(facts, figure.Values(len(log), named))
rotation, origin = poses[[link["name"] for link in facts["links"]].index(frame)]
worst = 0.0
for r, row in enumerate("xyz"):
    worst = max(worst, np.max(np.abs(origin[:, r] - log[f"out.{frame}_{row}_m"])))
    for c, column in enumerate("xyz"):
        worst = max(worst, np.max(np.abs(rotation[:, r, c] - log[f"out.{frame}_r{row}{column}"])))
moved = float(np.max(np.ptp(origin, axis=0)))
print(f"{len(log)} rows: {frame} moves {moved:.3f} m and is off by {worst:.1e} at most")
# the log and the robot file have nine digits
sys.exit(not (worst < 1e-7 and moved > 0.01))
