"""A run in Rerun: entities by what they are, curves for every tick, pictures thirty times a second of robot time.

    robot/estimate, truth, goal, plan    lines in 3D; `plan` is the tip's predicted way
    states/<state>/mean, low, high, measured, true, foreseen_low, foreseen_high
    commands/<input>, planned/<input> (bars over the plan's steps)
    predicted/<state>                    the band over the horizon: to the right the time ahead, upwards the state
    parameters/<name>/mean, low, high, particles/<name> (bars of a histogram)
    forces/<joint>/mean, low, high, slips/<state>/mean, low, high
    tick/us, tick/effective_samples, tick/adequacy, and the controller's state and reason as text at `events`
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_cli

from .table import ReportError
from .view_scene import Histograms, Pace, Scene, band

BLUE, GREY, GREEN, RED, LIGHT = (31, 119, 180), (120, 120, 120), (44, 160, 44), (214, 39, 40), (160, 200, 230)
NO_LEGEND = rrb.PlotLegend(visible=False)  # it would cover the curves; docs/guide/live_view.md tells their colours
LOOK = {"mean": (BLUE, 2.0), "low": (LIGHT, 1.0), "high": (LIGHT, 1.0), "measured": (GREEN, 1.0), "true": (GREY, 1.0),
        "foreseen_low": (RED, 0.7), "foreseen_high": (RED, 0.7)}


class RerunView:
    def __init__(self, hello: dict, file: str | None):
        self._hello, self.scene, self._pace, self._histograms = hello, Scene(hello), Pace(), Histograms(hello)
        self._columns = {f["name"]: f["columns"] for f in hello["fields"]}
        self._styled: set[str] = set()
        self._scale: dict[str, float] = {}
        self._last_event = None
        self._server: subprocess.Popen | None = None
        self._stream = rr.RecordingStream(f"tiller {hello['title']}")
        self._open(file)
        self._stream.send_blueprint(self.blueprint())
        self._stream.log("robot", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    # ---- where it goes ------------------------------------------------------------------------------------------

    def _open(self, file: str | None) -> None:
        if file:
            if not file.endswith(".rrd"):
                raise ReportError(f"{file}: Rerun's files end in .rrd; name such a --view-file")
            self._stream.save(file)
        elif os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform == "darwin":
            self._stream.spawn()
        else:
            self._serve()

    def _serve(self) -> None:
        """No display: Rerun's own server, for a browser on this machine or at the end of a tunnel."""
        program = str(Path(rerun_cli.__file__).with_name("rerun"))  # itself, not the script that would start it
        port, web_port = free_port(), free_port()
        self._server = subprocess.Popen([program, "--serve-web", "--bind", "127.0.0.1", "--port", str(port),
                                         "--web-viewer-port", str(web_port)], stdin=subprocess.DEVNULL,
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if not answers(port):
            self._server.terminate()
            raise ReportError("Rerun's server does not answer; name a --view-file")
        self._stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")
        print(f"view: no display here; open http://127.0.0.1:{web_port}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port}%2F"
              "proxy", file=sys.stderr, flush=True)

    def close(self) -> None:
        self._stream.flush()
        self._stream.disconnect()
        if self._server is None:
            return
        if sys.stderr.isatty():
            print("view: Rerun's server goes on without the run; end it with "
                  f"kill {self._server.pid}", file=sys.stderr, flush=True)
        else:
            self._server.terminate()

    # ---- how it is arranged -------------------------------------------------------------------------------------

    def blueprint(self) -> rrb.Blueprint:
        curves = [curves_of(f"states/{name}", name) for name in self._columns["mean"]]
        curves.append(curves_of("commands", "commands"))
        beliefs = [curves_of(f"parameters/{name}", name) for name in self._columns.get("parameter", [])]
        clouds = [rrb.BarChartView(origin=f"particles/{name}", name=f"particles: {name}", plot_legend=NO_LEGEND)
                  for name in self._histograms.names]
        plans = [rrb.BarChartView(origin=f"planned/{name}", name=f"plan: {name}", plot_legend=NO_LEGEND)
                 for name in self._columns["plan"]]
        plans += [rrb.Spatial2DView(origin=f"predicted/{name}", name=name)
                  for name in self._columns.get("predicted", [])]
        pushes = [curves_of(f"{kind}/{name}", f"{kind}: {name}")
                  for kind, field in (("forces", "force"), ("slips", "slip")) for name in self._columns.get(field, [])
                  if kind == "forces" or not self._columns.get("force")]
        pages = [rrb.Grid(*plans, name="plan and predicted bands"), rrb.Grid(*beliefs, *clouds, name="posterior")]
        pages += [rrb.Grid(*pushes, name="disturbance")] if pushes else []
        pages.append(rrb.Vertical(rrb.TimeSeriesView(origin="tick", name="microseconds, effective samples, adequacy"),
                                  rrb.TextLogView(origin="events", name="events"), name="tick"))
        left = [rrb.Spatial3DView(origin="robot", name="robot")] if self.scene.draws else []
        return rrb.Blueprint(rrb.Horizontal(rrb.Vertical(*left, rrb.Tabs(*pages), row_shares=[3, 2][:1 + len(left)]),
                                            rrb.Vertical(*curves), column_shares=[3, 2]),
                             rrb.TimePanel(state="collapsed", timeline="robot_time", play_state="following"),
                             rrb.SelectionPanel(state="collapsed"), rrb.BlueprintPanel(state="collapsed"))

    def save_layout(self, path: str) -> None:
        try:
            self.blueprint().save(f"tiller {self._hello['title']}", path)
        except OSError as error:
            raise ReportError(f"{path}: cannot be written: {error}") from None

    # ---- what is shown ------------------------------------------------------------------------------------------

    def add(self, batch) -> None:
        self._states(batch)
        for i, name in enumerate(self._columns["command"]):
            self._curve(f"commands/{name}", batch, batch["command"][:, i])
        for field, path in (("parameter", "parameters"), ("force", "forces"), ("slip", "slips")):
            for i, name in enumerate(self._columns.get(field, [])):
                self._with_band(f"{path}/{name}", batch, batch[field][:, i], batch[f"{field}_sd"][:, i])
        for name, path in (("tick_us", "us"), ("effective_samples", "effective_samples"),
                           ("adequacy_statistic", "adequacy")):
            self._curve(f"tick/{path}", batch, batch.tick[name])
        self._events(batch)
        rows = self._pace.rows(batch.time_s)
        if len(rows):
            self._pictures(batch, rows)

    def _states(self, batch) -> None:
        measured = self._columns["measured"]
        for i, name in enumerate(self._columns["mean"]):
            self._with_band(f"states/{name}", batch, batch["mean"][:, i], batch["sd"][:, i])
            if name in measured:
                self._curve(f"states/{name}/measured", batch, batch["measured"][:, measured.index(name)])
            self._curve(f"states/{name}/true", batch, batch["true"][:, i])
            if "foreseen" in batch:
                low, high = band(batch["foreseen"][:, i], batch["foreseen_sd"][:, i])
                self._curve(f"states/{name}/foreseen_low", batch, low)
                self._curve(f"states/{name}/foreseen_high", batch, high)

    def _with_band(self, path: str, batch, mean: np.ndarray, sd: np.ndarray) -> None:
        low, high = band(mean, sd)
        for name, values in (("mean", mean), ("low", low), ("high", high)):
            self._curve(f"{path}/{name}", batch, values)

    def _curve(self, path: str, batch, values: np.ndarray) -> None:
        """Of every tick; what is not there is left out."""
        known = np.isfinite(values)
        if not known.any():
            return
        if path not in self._styled:
            self._styled.add(path)
            name = path.rsplit("/", 1)[1]
            colour, width = LOOK.get(name, (None, None))
            self._stream.log(path, rr.SeriesLines(names=name, colors=colour, widths=width), static=True)
        times = [rr.TimeColumn("robot_time", duration=batch.time_s[known]),
                 rr.TimeColumn("tick", sequence=batch.tick["tick"][known].astype(np.int64))]
        rr.send_columns(path, times, rr.Scalars.columns(scalars=values[known]), recording=self._stream)

    def _at(self, batch, row: int) -> None:
        self._stream.set_time("robot_time", duration=float(batch.time_s[row]))
        self._stream.set_time("tick", sequence=int(batch.tick["tick"][row]))

    def _events(self, batch) -> None:
        """The controller's state with its reason, where one of them changes."""
        for row in range(batch.count):
            state, status = int(batch.tick["state"][row]), int(batch.tick["status"][row])
            if (state, status) == self._last_event:
                continue
            self._last_event = (state, status)
            level = "ERROR" if state == 4 else "WARN" if state == 3 or 100 <= status < 200 else "INFO"
            self._at(batch, row)
            self._stream.log("events", rr.TextLog(f"{self._hello['states'].get(str(state), state)}: "
                                                  f"{self._hello['statuses'].get(str(status), status)}", level=level))

    def _pictures(self, batch, rows: np.ndarray) -> None:
        figures = self._figures(batch, rows)
        for at, row in enumerate(rows):
            self._at(batch, row)
            for name, (points, colour, radius) in figures.items():
                self._stream.log(f"robot/{name}", rr.LineStrips3D(self.scene.lines(points[at]), colors=colour,
                                                                  radii=rr.Radius.ui_points(radius)))
            way = self.scene.tip_plan(batch, row) if self.scene.draws else None
            if way is not None:
                self._stream.log("robot/plan", rr.LineStrips3D([way], colors=RED, radii=rr.Radius.ui_points(1.5)))
            self._plan(batch, row)
            for name in self._histograms.names:
                middles, shares = self._histograms.of(batch, row, name)
                self._stream.log(f"particles/{name}", bars(middles, shares))

    def _figures(self, batch, rows: np.ndarray) -> dict:
        if not self.scene.draws:
            return {}
        found = {"estimate": (self.scene.estimate(batch, rows), BLUE, 3.0),
                 "truth": (self.scene.truth(batch, rows), GREY, 1.5),
                 "goal": (self.scene.goal(batch, rows), GREEN, 1.0)}
        return {name: of for name, of in found.items() if of[0] is not None}

    def _plan(self, batch, row: int) -> None:
        ahead_s = np.arange(batch["plan"].shape[1]) * self._hello["period_s"] * self._hello["stride"]
        for i, name in enumerate(self._columns["plan"]):
            values = batch["plan"][row, :, i]
            if np.isfinite(values).all():
                self._stream.log(f"planned/{name}", bars(ahead_s, values))
        for i, name in enumerate(self._columns.get("predicted", [])):
            mean, sd = batch["predicted"][row, :, i], batch["predicted_sd"][row, :, i]
            if not np.isfinite(mean).all():
                continue
            low, high = band(mean, sd)
            # as wide as two, and as high as one where the first prediction ended: pixels of a picture, y downwards
            scale = self._scale.setdefault(name, max(float(np.abs([low, high]).max()), 1e-9))
            strips = [np.stack([2 * ahead_s / max(ahead_s[-1], 1e-9), -values / scale], axis=1)
                      for values in (mean, low, high)]
            self._stream.log(f"predicted/{name}", rr.LineStrips2D(strips, colors=[BLUE, LIGHT, LIGHT],
                                                                  radii=rr.Radius.ui_points([2.0, 1.0, 1.0])))


def curves_of(origin: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=NO_LEGEND)


def bars(middles: np.ndarray, heights: np.ndarray) -> rr.BarChart:
    """That touch each other."""
    width = middles[1] - middles[0] if len(middles) > 1 else 1.0
    return rr.BarChart(heights, abscissa=middles, widths=np.full(len(middles), width), color=BLUE)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def answers(port: int, patience_s: float = 20.0) -> bool:
    until_s = time.monotonic() + patience_s
    while time.monotonic() < until_s:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return True
        except OSError:
            time.sleep(0.1)
    return False
