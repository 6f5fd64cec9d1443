"""A run in Foxglove: a server that it connects to, or an MCAP file that it opens.

Topics, JSON but the first:
    /robot                    foxglove.SceneUpdate: the stick figures of estimate, plant and goal, and the tip's plan
    /measurement, /command    by name, as in an MCAP of `tiller run --record`
    /tick                     time, state and status in words, mean, sd, q05 and q95 of states and parameters, force,
                              slip
    /plan                     ahead_s, and each input's planned values
    /prediction               ahead_s, and of each state mean, low and high: the predicted band
    /particles                weight, and each parameter's values; histogram: of each parameter middles and shares
"""

from __future__ import annotations

import json
import sys
import time

import foxglove
import numpy as np
from foxglove.channels import SceneUpdateChannel
from foxglove.messages import (Color, Duration, LinePrimitive, LinePrimitiveLineType, Point3, Pose, Quaternion,
                               SceneEntity, SceneUpdate, Timestamp, Vector3)

from .foxglove_layout import plot, stacked
from .table import ReportError
from .view_scene import Histograms, Pace, Scene, band

PORT = 8765  # Foxglove's own default
COLOURS = {"estimate": (0.12, 0.47, 0.71), "truth": (0.47, 0.47, 0.47), "goal": (0.17, 0.63, 0.17),
           "plan": (0.84, 0.15, 0.16)}
WORLD = "world"


def numbers(names, values) -> dict:
    return {name: float(value) if np.isfinite(value) else None for name, value in zip(names, values)}


def object_of(names, kind: str = "number") -> dict:
    what = {"type": "array", "items": {"type": "number"}} if kind == "array" else {"type": kind}
    return {"type": "object", "properties": {name: what for name in names}}


class FoxgloveView:
    def __init__(self, hello: dict, file: str | None):
        self._hello, self.scene, self._pace, self._histograms = hello, Scene(hello), Pace(), Histograms(hello)
        self._columns = {f["name"]: f["columns"] for f in hello["fields"]}
        self._context = foxglove.Context()
        self._epoch_ns = time.time_ns()
        self._server = self._file = None
        self._open(file)
        self._channels = {topic: foxglove.Channel(f"/{topic}", schema=schema, message_encoding="json",
                                                  context=self._context)
                          for topic, schema in self._schemas().items()}
        self._robot = SceneUpdateChannel("/robot", context=self._context)

    def _open(self, file: str | None) -> None:
        if file:
            if not file.endswith(".mcap"):
                raise ReportError(f"{file}: Foxglove's files end in .mcap; name such a --view-file")
            self._file = foxglove.open_mcap(file, allow_overwrite=True, context=self._context)
            return
        try:
            self._server = foxglove.start_server(name=f"tiller {self._hello['title']}", port=PORT,
                                                 context=self._context)
        except RuntimeError as error:
            raise ReportError(f"port {PORT}: {error}; end the other server, or name a --view-file") from None
        print(f"view: in Foxglove, open a connection to ws://127.0.0.1:{PORT}", file=sys.stderr, flush=True)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
        if self._server is not None:
            self._server.stop()

    # ---- what there is ------------------------------------------------------------------------------------------

    def _of(self, field: str) -> list[str]:
        return self._columns.get(field, [])

    def _schemas(self) -> dict:
        estimated = [*self._of("mean"), *self._of("parameter")]
        tick = object_of(["time_s", "tick", "tick_us", "effective_samples", "noise_scale", "plan_cost",
                          "adequacy_statistic"])
        for name in ("state", "status"):
            tick["properties"][name] = {"type": "string"}
        for name, of in (("mean", estimated), ("sd", estimated), ("true", self._of("true")), ("q05", self._of("q05")),
                         ("q95", self._of("q95")), ("target", self._of("target"))):
            tick["properties"][name] = object_of(of)
        for name in ("force", "slip"):
            if self._of(name):
                tick["properties"][name] = {"type": "object", "properties": {
                    "mean": object_of(self._of(name)), "sd": object_of(self._of(name))}}
        schemas = {"measurement": object_of(self._of("measured")), "command": object_of(self._of("command")),
                   "tick": tick, "plan": object_of(["ahead_s", *self._of("plan")], "array")}
        if self._of("predicted"):
            schemas["prediction"] = object_of(["ahead_s"], "array")
            for name in self._of("predicted"):
                schemas["prediction"]["properties"][name] = object_of(["mean", "low", "high"], "array")
        if self._histograms.names:
            schemas["particles"] = object_of(["weight", *self._histograms.names], "array")
            schemas["particles"]["properties"]["histogram"] = {"type": "object", "properties": {
                name: object_of(["middle", "share"], "array") for name in self._histograms.names}}
        for topic, schema in schemas.items():
            schema["title"] = f"tiller.view.{topic}"
        return schemas

    def _send(self, topic: str, message: dict, at_ns: int) -> None:
        self._channels[topic].log(json.dumps(message).encode(), log_time=at_ns)

    def add(self, batch) -> None:
        drawn = set(self._pace.rows(batch.time_s).tolist())
        for row in range(batch.count):
            at_ns = self._epoch_ns + round(1e9 * float(batch.time_s[row]))
            if np.isfinite(batch["measured"][row]).any():
                self._send("measurement", numbers(self._of("measured"), batch["measured"][row]), at_ns)
            self._send("command", numbers(self._of("command"), batch["command"][row]), at_ns)
            self._send("tick", self._tick(batch, row), at_ns)
            if row in drawn:
                self._pictures(batch, row, at_ns)

    def _tick(self, batch, row: int) -> dict:
        words = {"state": "states", "status": "statuses"}
        message = numbers(batch.tick, [values[row] for values in batch.tick.values()])
        for name, table in words.items():
            code = str(int(batch.tick[name][row]))
            message[name] = self._hello[table].get(code, code)
        for name, states, parameters in (("mean", "mean", "parameter"), ("sd", "sd", "parameter_sd")):
            message[name] = numbers(self._of(states), batch[states][row])
            if parameters in batch:
                message[name] |= numbers(self._of(parameters), batch[parameters][row])
        for name in ("true", "q05", "q95", "target"):
            if name in batch:
                message[name] = numbers(self._of(name), batch[name][row])
        for name in ("force", "slip"):
            if name in batch:
                message[name] = {"mean": numbers(self._of(name), batch[name][row]),
                                 "sd": numbers(self._of(name), batch[f"{name}_sd"][row])}
        return message

    def _pictures(self, batch, row: int, at_ns: int) -> None:
        if self.scene.draws:
            self._robot.log(SceneUpdate(entities=self._entities(batch, row, at_ns)), log_time=at_ns)
        ahead_s = (np.arange(batch["plan"].shape[1]) * self._hello["period_s"] * self._hello["stride"]).tolist()
        if np.isfinite(batch["plan"][row]).all():
            self._send("plan", {"ahead_s": ahead_s} | {name: batch["plan"][row, :, i].tolist()
                                                       for i, name in enumerate(self._of("plan"))}, at_ns)
        if "predicted" in batch and np.isfinite(batch["predicted"][row]).all():
            message = {"ahead_s": ahead_s}
            for i, name in enumerate(self._of("predicted")):
                mean = batch["predicted"][row, :, i]
                low, high = band(mean, batch["predicted_sd"][row, :, i])
                message[name] = {"mean": mean.tolist(), "low": low.tolist(), "high": high.tolist()}
            self._send("prediction", message, at_ns)
        if self._histograms.names:
            self._send("particles", self._particles(batch, row), at_ns)

    def _particles(self, batch, row: int) -> dict:
        cloud = batch["particles"][row]
        cloud = cloud[np.isfinite(cloud).all(axis=1)]
        message = {name: cloud[:, i].tolist() for i, name in enumerate(self._of("particles"))}
        message["histogram"] = {}
        for name in self._histograms.names:
            middles, shares = self._histograms.of(batch, row, name)
            message["histogram"][name] = {"middle": middles.tolist(), "share": shares.tolist()}
        return message

    def _entities(self, batch, row: int, at_ns: int) -> list:
        rows = np.array([row])
        found = {"estimate": self.scene.estimate(batch, rows), "truth": self.scene.truth(batch, rows),
                 "goal": self.scene.goal(batch, rows)}
        made = [self._entity(name, self.scene.lines(points[0]), at_ns)
                for name, points in found.items() if points is not None]
        way = self.scene.tip_plan(batch, row)
        return made if way is None else [*made, self._entity("plan", [way], at_ns)]

    def _entity(self, name: str, lines: list, at_ns: int) -> SceneEntity:
        colour = Color(r=COLOURS[name][0], g=COLOURS[name][1], b=COLOURS[name][2], a=1.0)
        still = Pose(position=Vector3(x=0.0, y=0.0, z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))
        width = 4.0 if name == "estimate" else 2.0
        drawn = [LinePrimitive(type=LinePrimitiveLineType.LineStrip, pose=still, thickness=width, scale_invariant=True,
                               color=colour, points=[Point3(x=float(x), y=float(y), z=float(z)) for x, y, z in line])
                 for line in lines]
        stamp = Timestamp(sec=at_ns // 10**9, nsec=at_ns % 10**9)
        return SceneEntity(timestamp=stamp, frame_id=WORLD, id=name, lifetime=Duration(sec=0, nsec=0),
                           frame_locked=False, lines=drawn)

    # ---- how it is arranged -------------------------------------------------------------------------------------

    def layout(self) -> str:
        """A layout that Foxglove reads by "Import from file"."""
        made = {}
        if self.scene.draws:
            made["3D!robot"] = {"followTf": WORLD, "scene": {"enableStats": False}, "layers": {
                "grid": {"layerId": "foxglove.Grid", "visible": True, "frameLocked": True, "size": 4, "divisions": 8}},
                "topics": {"/robot": {"visible": True}}}
        measured = self._of("measured")
        for name in self._of("mean"):
            paths = [f"/measurement.{name}"] if name in measured else []
            made[f"Plot!{name}"] = plot(name, [*paths, f"/tick.mean.{name}", f"/tick.true.{name}"])
        made["Plot!command"] = plot("commands", [f"/command.{name}" for name in self._of("command")])
        for name in self._of("plan"):
            made[f"Plot!plan_{name}"] = over("plan: " + name, "/plan.ahead_s[:]", [f"/plan.{name}[:]"])
        for name in self._of("predicted"):
            made[f"Plot!predicted_{name}"] = over("predicted: " + name, "/prediction.ahead_s[:]", [
                f"/prediction.{name}.{kind}[:]" for kind in ("mean", "low", "high")])
        for name in self._histograms.names:
            quoted = f'"{name}"' if "." in name else name
            made[f"Plot!parameter_{name}"] = plot(name, [f"/tick.{kind}.{quoted}" for kind in ("mean", "q05", "q95")])
            made[f"Plot!particles_{name}"] = over("particles: " + name, f"/particles.histogram.{quoted}.middle[:]",
                                                  [f"/particles.histogram.{quoted}.share[:]"])
        for kind in ("force", "slip"):
            if self._of(kind) and (kind == "force" or not self._of("force")):
                made[f"Plot!{kind}"] = plot("beyond the model", [f"/tick.{kind}.{of}.{name}" for name in self._of(kind)
                                                                 for of in ("mean", "sd")])
        made["RawMessages!tick"] = {"topicPath": "/tick", "diffEnabled": False, "expansion": "none"}
        ids = list(made)
        columns = [ids[i::3] for i in range(3) if ids[i::3]]
        side_by_side = stacked(columns[-1])
        for left in reversed(columns[:-1]):
            side_by_side = {"first": stacked(left), "second": side_by_side, "direction": "row",
                            "splitPercentage": 100 / 3 if left is columns[0] else 50}
        return json.dumps({"configById": made, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1},
                           "layout": side_by_side}, indent=1) + "\n"


def over(title: str, x_path: str, paths: list[str]) -> dict:
    """Values of one message over others of it."""
    return plot(title, paths) | {"xAxisVal": "currentCustom", "xAxisPath": {"value": x_path, "enabled": True}}
