"""Model and cost to second order along motions, and motions side by side."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

Array = Any  # of JAX, which has no types here

FREE, HIGH, LOW, GIVEN = 0, 1, -1, 2  # what an input is: free, at a limit, or the first one where its change costs


class Expansion(NamedTuple):
    """One motion of T periods, over z = (x, u before, u): m numbers, of which n stand for the state. The input before
    is a part of the state where changes of inputs cost. A group is what one coefficient of the cost multiplies."""
    slope: Array         # (T, n, m) of the next state
    defect: Array        # (T, n) model's next state minus the motion's
    gradient: Array      # (groups, T, m)
    hessian: Array       # (groups, T, m, m)
    end_gradient: Array  # (groups, T + 1, n) of each point as the end of a horizon
    end_hessian: Array   # (groups, T + 1, n, n)
    side: Array          # (T, nu) of FREE, HIGH, LOW, GIVEN

    @property
    def steps(self) -> int:
        return int(self.slope.shape[0])

    def has_slope(self) -> np.ndarray:
        """(groups) whether a group acts anywhere along the motion."""
        return np.asarray((self.gradient != 0).any((1, 2)) | (self.end_gradient != 0).any((1, 2)))


class Windows(NamedTuple):
    """Horizons along motions: of motion `motion` the periods from `first` to before `first + length`."""
    motion: Array  # (windows)
    first: Array
    length: Array
    whole: bool    # every input of a window is judged, else the first alone
    longest: int


def side_by_side(all_motions: Sequence[Expansion]) -> Expansion:
    """A motion each, as long as the longest: what stands behind an end is zero."""
    longest = max(e.steps for e in all_motions)

    def padded(name: str, axis: int) -> Array:
        rows = [getattr(e, name) for e in all_motions]
        return jnp.stack([jnp.pad(r, [(0, longest - e.steps if i == axis else 0) for i in range(r.ndim)])
                          for r, e in zip(rows, all_motions, strict=True)])

    axes = {"slope": 0, "defect": 0, "side": 0}
    return Expansion(**{name: padded(name, axes.get(name, 1)) for name in Expansion._fields})


def windows_of(all_motions: Sequence[Expansion], horizon: int, every: int) -> Windows:
    """Whole motions (horizon 0), or a horizon from each `every`-th period on that has one and whose input is free."""
    rows = []
    for index, e in enumerate(all_motions):
        if horizon == 0:
            rows.append((index, 0, e.steps))
            continue
        begin = int(bool((e.side[0] == GIVEN).any()))
        rows += [(index, first, horizon) for first in range(begin, e.steps - horizon + 1, every)]
    motion, first, length = np.array(rows, np.int32).reshape(-1, 3).T
    return Windows(jnp.asarray(motion), jnp.asarray(first), jnp.asarray(length), horizon == 0,
                   max(e.steps for e in all_motions) if horizon == 0 else horizon)
