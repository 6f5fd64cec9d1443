"""The robot as a stick figure that moves: a canvas with its script inside the page, and a still picture beside it.

Positions of all points are computed here (figure.py); the page only projects and draws them.
"""

from __future__ import annotations

import base64
import html
import json
from pathlib import Path

import numpy as np

from . import figure as fig
from . import page

MOST_FRAMES = 600  # of the animation, however long the run was
_MOST_NUMBERS = 120_000  # coordinates in a page: 320 kB of text
_LEAST_FRAMES = 40
_STILLS = 8
# As animation.js has them: degrees about the vertical, and above the horizon.
_VIEWS = {"side": (0.0, 0.0), "top": (0.0, 90.0), "3d": (35.0, 22.0)}
_AXES = {"side": ("x (m)", "z (m)"), "top": ("x (m)", "y (m)"), "3d": ("to the right (m)", "up (m)")}
_FAR = 300.0  # figures away from the rest: of a run that diverged


class Scene:
    """What moves in a run: points (frames x points x 3) of the estimate, of the plant and of the goal, where known."""

    def __init__(self, run):
        meta = run.meta["figure"]
        self.view = meta["view"]
        self.sketch = fig.Sketch(meta)
        self.rows = _some_rows(len(run.time), self.sketch.point_count)
        self.time = run.time[self.rows]
        self.estimate = self.sketch.points(self._values(self._believed(run, meta)))
        self.truth = self._truth(run, meta)
        self.goal = self._goal(run, meta)
        self.frames = [self._frame(run, frame) for frame in run.frames]
        self.marks = [points for points in (self._mark(run, meta, goal) for goal in meta["goals_m"])
                      if points is not None]
        self.obstacles = self._obstacles(run, meta)
        self._drop_what_is_far()

    def _column(self, run, name: str) -> np.ndarray | None:
        values = run.column(name)
        return None if values is None else values[self.rows]

    def _values(self, named: dict) -> fig.Values:
        return fig.Values(len(self.rows), named)

    def _believed(self, run, meta: dict) -> dict:
        named = dict(meta["parameters"])
        for name in fig.names_of(meta):
            values = self._column(run, f"mean.{name}")
            if values is not None:
                named[name] = values
        return named

    def _truth(self, run, meta: dict) -> np.ndarray | None:
        """Where the plant is in this process; lengths that nobody tells are those that are believed."""
        named = self._believed(run, meta) | meta["true_parameters"]
        for name in fig.names_of(meta):
            if name not in run.states:
                continue
            values = self._column(run, f"true.{name}")
            if values is None:
                return None
            named[name] = values
        return self.sketch.points(self._values(named))

    def _wanted(self, run, name: str) -> np.ndarray | None:
        """Where a state is wanted; None: nowhere."""
        if name in run.tracked:
            return self._column(run, f"ref.{name}")
        if name not in run.meta.get("target", {}):
            return None
        rows = self._column(run, f"goal.{name}")
        return rows if rows is not None else np.full(len(self.rows), float(run.meta["target"][name]))

    def _goal(self, run, meta: dict) -> np.ndarray | None:
        """The figure where the cost wants it; states without a target stay where they are."""
        wanted = {name: self._wanted(run, name) for name in fig.names_of(meta) if name in run.states}
        wanted = {name: values for name, values in wanted.items() if values is not None}
        if not wanted:
            return None
        return self.sketch.points(self._values(self._believed(run, meta) | wanted))

    def _output_goal(self, run, name: str) -> np.ndarray:
        return run.output_goal(name)[self.rows]

    def _frame(self, run, frame: dict) -> np.ndarray:
        """(frames x 4 x 3): the origin that is wanted, and its axes' directions (NaN: any)."""
        name = frame["name"]
        out = np.full((len(self.rows), 4, 3), np.nan)
        out[:, 0] = np.stack([self._output_goal(run, f"{name}_{axis}_m") for axis in "xyz"], axis=1)
        if not frame["moves"]:  # only its rotation is asked for: it is drawn where the frame is
            out[:, 0] = np.stack([run.table[f"out.{name}_{axis}_m"][self.rows] for axis in "xyz"], axis=1)
        if frame["turns"]:
            for column, of in enumerate("xyz"):
                out[:, 1 + column] = np.stack([self._output_goal(run, f"{name}_r{row}{of}") for row in "xyz"], axis=1)
        return out

    def _mark(self, run, meta: dict, three: list) -> np.ndarray | None:
        named = self._believed(run, meta)
        for terms in three:
            for _, name in terms:
                if name in run.outputs:
                    named[name] = self._output_goal(run, name)
                elif name in run.meta.get("output_target", {}):
                    named[name] = self._column(run, f"out.{name}")
                elif name and name in run.states:
                    wanted = self._wanted(run, name)
                    named[name] = wanted if wanted is not None else self._column(run, f"mean.{name}")
                elif name and name not in named:
                    return None  # an output that no cost asks for is not in the log
        return self._values(named).point(three)

    def _obstacles(self, run, meta: dict) -> list[list[float]]:
        """Circles in the plane that a link's position spans: centre, and the two radii."""
        plane = run.meta.get("plane") or {"obstacles": []}
        if not plane["obstacles"]:
            return []
        for link in meta["links"]:
            axes = [k for name in (plane["x"], plane["y"])
                    for k, terms in enumerate(link["position_m"]) if terms == [[1, name]]]
            if link["parent"] < 0 and len(axes) == 2:
                out = []
                for x, y, radius in plane["obstacles"]:
                    points = np.zeros((3, 3))
                    points[:, axes[0]] = x
                    points[:, axes[1]] = y
                    points[1, axes[0]] += radius
                    points[2, axes[1]] += radius
                    out.append(points.tolist())
                return out
        return []

    def _drop_what_is_far(self) -> None:
        """What diverged would leave nothing of the rest but a dot."""
        anchor = self.truth if self.truth is not None else self.estimate
        known = anchor[np.all(np.isfinite(anchor), axis=(1, 2))]
        if not len(known):
            known = self.estimate[np.all(np.isfinite(self.estimate), axis=(1, 2))]
        if not len(known):
            return
        middle = np.median(known, axis=(0, 1))
        reach = _FAR * max(np.median(np.max(np.ptp(known, axis=1), axis=1)),
                           np.median(np.abs(known - middle)), 1e-3)
        for points in self.moving():
            with np.errstate(invalid="ignore"):
                points[~(np.abs(points - middle) < reach).all(axis=-1)] = np.nan

    def moving(self) -> list[np.ndarray]:
        return [points for points in (self.estimate, self.truth, self.goal) if points is not None]

    def empty(self) -> bool:
        return not self.sketch.shapes or not np.isfinite(self.estimate).all(axis=-1).any()


def _some_rows(count: int, points: int) -> np.ndarray:
    """Rows that are shown, the first and the last among them."""
    most = max(_LEAST_FRAMES, min(MOST_FRAMES, _MOST_NUMBERS // max(1, 9 * points)))
    return np.unique(np.round(np.linspace(0, count - 1, min(count, most))).astype(int))


# ---- the page's data ---------------------------------------------------------------------------------


def _packed(points: np.ndarray, middle: np.ndarray, step: float) -> str:
    """Steps of 1/32000 of the scene's half width as 16-bit numbers, base64; -32768: not known."""
    steps = np.round((points - middle) / step)
    steps[~np.isfinite(steps)] = -32768
    return base64.b64encode(steps.astype("<i2").tobytes()).decode()


def _constant(points: np.ndarray) -> np.ndarray:
    """One frame where all are the same."""
    return points[:1] if np.array_equal(points, np.broadcast_to(points[:1], points.shape), equal_nan=True) else points


def data(scene: Scene) -> dict:
    size = _figure_size(scene.estimate)
    triads = [_axes(frame, 0.2 * size) for frame in scene.frames]
    everything = np.concatenate([np.reshape(points, (-1, 3)) for points in
                                 [*scene.moving(), *triads, *scene.marks, scene.obstacles]])
    everything = everything[np.isfinite(everything).all(axis=1)]
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, half = (low + high) / 2, max(float(np.max(high - low)) / 2, 1e-3)
    step = half / 32000
    tracks = {"estimate": scene.estimate, "truth": scene.truth,
              "goal": None if scene.goal is None else _constant(scene.goal)}
    return {"view": _VIEWS[scene.view], "time": [round(float(t), 4) for t in scene.time],
            "middle": middle.tolist(), "step": step, "low": low.tolist(), "high": high.tolist(), "size": size,
            "points": scene.estimate.shape[1], "shapes": scene.sketch.shapes, "tip": scene.sketch.tip,
            "tracks": {name: _packed(points, middle, step) for name, points in tracks.items() if points is not None},
            "frames": [_packed(_constant(triad), middle, step) for triad in triads],
            "marks": [_packed(_constant(mark), middle, step) for mark in scene.marks],
            "obstacles": scene.obstacles,
            "colours": {"estimate": page.ESTIMATE, "truth": page.TRUTH, "goal": page.INK, "ground": "#dfe3e8",
                        "obstacle": page.LIMIT, "trace": page.BAND}}


def _axes(frame: np.ndarray, length: float) -> np.ndarray:
    """A frame's origin and the ends of its axes."""
    ends = frame.copy()
    ends[:, 1:] = frame[:, :1] + length * frame[:, 1:]
    return ends


def _figure_size(points: np.ndarray) -> float:
    known = points[np.isfinite(points).all(axis=(1, 2))]
    return float(np.median(np.max(np.ptp(known, axis=1), axis=1))) if len(known) else 1.0


_SCRIPT = Path(__file__).with_name("animation.js")


def stage(scene: Scene) -> str:
    """The canvas with its controls."""
    shown = data(scene)
    known = [("estimate", "estimate", ""), ("truth", "truth", "dashed"), ("goal", "goal", "dotted")]
    has_goal = scene.frames or scene.marks or "goal" in shown["tracks"]
    legend = "".join(
        f'<span><i style="border-top:3px {style or "solid"} {shown["colours"][name]}"></i>{label}</span>'
        for name, label, style in known if name in shown["tracks"] or (name == "goal" and has_goal))
    text = json.dumps(shown, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    last = len(scene.time) - 1
    return (f'<div class=stage><h3>animation</h3><canvas id=robot-canvas role=img '
            f'aria-label="stick figure of the robot over the run"></canvas>'
            f'<div class=controls><button type=button id=robot-play>Play</button>'
            f'<input type=range id=robot-slider min=0 max={last} value=0 step=1 aria-label="time">'
            f'<output id=robot-time>{html.escape(f"{scene.time[0]:.2f} s")}</output>'
            f'<select id=robot-speed aria-label="speed"><option value=0.1>0.1 ×</option>'
            f'<option value=0.25>0.25 ×</option><option value=1 selected>1 ×</option>'
            f'<option value=4>4 ×</option><option value=16>16 ×</option></select></div>'
            f'<p class=legend>{legend}<span class=hint>drag to turn, double click to turn back</span></p>'
            f'<script type="application/json" id=robot-data>{text}</script>'
            f'<script>{_SCRIPT.read_text(encoding="utf-8")}</script></div>')


# ---- the still picture -------------------------------------------------------------------------------


def project(points: np.ndarray, view: str) -> np.ndarray:
    """(... x 2): to the right and up, as the page begins."""
    azimuth, elevation = np.radians(_VIEWS[view])
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    ahead = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    up = np.sin(elevation) * ahead + np.cos(elevation) * np.array([0, 0, 1])
    return points @ np.stack([right, up], axis=1)


def _spread_out(points: np.ndarray) -> np.ndarray:
    """Frames between which the figure moved equally far: a robot that has arrived is shown once."""
    known = np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))
    if not len(known):
        return known
    moved = np.mean(np.linalg.norm(np.diff(points[known], axis=0), axis=2), axis=1)
    way = np.concatenate([[0], np.cumsum(moved)])
    wanted = np.linspace(0, way[-1], _STILLS)
    picked = np.searchsorted(way, wanted).clip(0, len(known) - 1)
    return np.unique(known[np.append(picked, len(known) - 1)])


def still(scene: Scene) -> str:
    """Some poses of the estimate over one another, later ones darker."""
    across, up = _AXES[scene.view]
    figure, ax = page.axes("poses", up, across, height=4.6)
    frames = _spread_out(scene.estimate)
    for i, frame in enumerate(frames):
        last = i == len(frames) - 1
        shade = 0.15 + 0.45 * i / max(1, len(frames) - 1)
        for k, shape in enumerate(scene.sketch.shapes):
            for line in fig.outline(shape, scene.estimate[frame]):
                ax.plot(*project(line, scene.view).T, color=page.ESTIMATE, alpha=1 if last else shade,
                        linewidth=2.4 if last else 1.6, solid_capstyle="round",
                        label="estimate at the end" if last and k == 0 else None)
    _draw_goal(ax, scene)
    for points in scene.obstacles:
        for line in fig.outline(["circle", 0, 1, 2], np.array(points)):
            ax.fill(*project(line, scene.view).T, color=page.LIMIT, alpha=0.35, linewidth=0)
    ax.margins(0.08)
    ax.set_aspect("equal", adjustable="datalim")
    _one_of_each_label(ax)
    times = ", ".join(page.number(scene.time[frame], 3) for frame in frames)
    return page.svg(figure, f"At {times} s; later is darker.")


def _draw_goal(ax, scene: Scene) -> None:
    style = {"color": page.INK, "linewidth": 1.2, "linestyle": (0, (1, 1.2))}
    if scene.goal is not None:
        for shape in scene.sketch.shapes:
            for line in fig.outline(shape, scene.goal[-1]):
                ax.plot(*project(line, scene.view).T, label="goal", **style)
    for point in [frame[-1, 0] for frame in scene.frames] + [mark[-1] for mark in scene.marks]:
        ax.plot(*project(point[None], scene.view).T, "+", color=page.INK, markersize=9, label="goal")


def _one_of_each_label(ax) -> None:
    seen = set()
    for line in ax.lines:
        if line.get_label() in seen:
            line.set_label("_nolegend_")
        seen.add(line.get_label())
    page.legend(ax)


def section(run) -> str:
    """The robot over the run; empty where its robot file draws none, or nothing of it is known."""
    if not run.meta.get("figure"):
        return ""
    scene = Scene(run)
    if scene.empty():
        return ""
    return f"<h2>The robot</h2><div class=robot>{stage(scene)}{still(scene)}</div>"
