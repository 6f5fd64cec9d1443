"""What every viewer draws of a batch of rows: the robot's lines, the way of its tip, and histograms of particles."""

from __future__ import annotations

import numpy as np

from . import figure as fig

DRAWN_S = 1 / 30  # of robot time between two pictures of what is no curve
BINS = 32


class Scene:
    """The stick figure of [figure], if the robot file has one."""

    def __init__(self, hello: dict):
        self._columns = {f["name"]: f["columns"] for f in hello["fields"]}
        self._facts = hello["facts"]
        self._meta = self._facts.get("figure")
        self.sketch = fig.Sketch(self._meta) if self._meta else None
        self.view = self._meta["view"] if self._meta else "3d"

    @property
    def draws(self) -> bool:
        return self.sketch is not None and bool(self.sketch.shapes)

    def estimate(self, batch, rows: np.ndarray) -> np.ndarray:
        """(rows x points x 3)"""
        return self._points(self._named(batch, rows, "mean"), len(rows))

    def truth(self, batch, rows: np.ndarray) -> np.ndarray | None:
        if "true" not in batch or not np.isfinite(batch["true"][rows]).any():
            return None
        return self._points(self._named(batch, rows, "true") | self._meta["true_parameters"], len(rows))

    def goal(self, batch, rows: np.ndarray) -> np.ndarray | None:
        """The figure where the cost wants it; states without a weight stay where they are."""
        wanted = {name: batch["target"][rows, self._columns["target"].index(name)]
                  for name in self._facts.get("target", {})}
        if not any(name in fig.names_of(self._meta) for name in wanted):
            return None
        return self._points(self._named(batch, rows, "mean") | wanted, len(rows))

    def tip_plan(self, batch, row: int) -> np.ndarray | None:
        """(steps x 3): where the plan is expected to lead the tip."""
        if "predicted" not in batch:
            return None
        ahead = batch["predicted"][row]
        ahead = ahead[np.isfinite(ahead).all(axis=1)]
        if len(ahead) < 2:
            return None
        named = dict(self._meta["parameters"])
        named |= {name: float(batch["parameter"][row, i]) for i, name in enumerate(self._columns.get("parameter", []))}
        named |= {name: ahead[:, i] for i, name in enumerate(self._columns["predicted"])}
        return self.sketch.points(fig.Values(len(ahead), named))[:, self.sketch.tip]

    def _named(self, batch, rows: np.ndarray, states: str) -> dict:
        named = dict(self._meta["parameters"])
        for field in ("parameter", states):
            for i, name in enumerate(self._columns.get(field, [])):
                named[name] = batch[field][rows, i]
        return named

    def _points(self, named: dict, rows: int) -> np.ndarray:
        return self.sketch.points(fig.Values(rows, named))

    def lines(self, points: np.ndarray) -> list[np.ndarray]:
        """Of one row's points."""
        return [line for shape in self.sketch.shapes for line in fig.outline(shape, points)
                if np.isfinite(line).all()]


class Pace:
    """Rows at which pictures are drawn: no two nearer than DRAWN_S."""

    def __init__(self):
        self._next_s = -np.inf

    def rows(self, time_s: np.ndarray) -> np.ndarray:
        picked = []
        for i, at_s in enumerate(time_s):
            if at_s >= self._next_s - 1e-9:
                picked.append(i)
                self._next_s = at_s + DRAWN_S
        return np.array(picked, int)


class Histograms:
    """Shares of the particles' weight over a parameter's prior range, widened by the first particles."""

    def __init__(self, hello: dict):
        fields = {f["name"]: f["columns"] for f in hello["fields"]}
        self.names = fields.get("particles", ["weight"])[1:]
        self._priors = hello["facts"].get("priors", {})
        self._edges: dict[str, np.ndarray] = {}

    def of(self, batch, row: int, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Middles of the bins, and shares."""
        cloud = batch["particles"][row]
        values, weights = cloud[:, 1 + self.names.index(name)], cloud[:, 0]
        known = np.isfinite(values) & np.isfinite(weights)
        edges = self._edges_of(name, values[known])
        shares, _ = np.histogram(np.clip(values[known], edges[0], edges[-1]), edges, weights=weights[known])
        return (edges[1:] + edges[:-1]) / 2, shares / max(weights[known].sum(), 1e-300)

    def _edges_of(self, name: str, values: np.ndarray) -> np.ndarray:
        if name not in self._edges:
            ends = [*self._priors.get(name, []), *([values.min(), values.max()] if len(values) else [])] or [0.0, 1.0]
            low, high = min(ends), max(ends)
            self._edges[name] = np.linspace(low, high if high > low else low + max(abs(low), 1.0) * 1e-3, BINS + 1)
        return self._edges[name]


def band(mean: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two standard deviations to both sides."""
    return mean - 2 * sd, mean + 2 * sd
