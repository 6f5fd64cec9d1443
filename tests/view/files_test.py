"""What a viewer was shown, read back by the SDKs' own readers, is what the CSV of the same run says."""

import json
import math
import re
import unittest

import numpy as np
import rerun.chunk
from foxglove.mcap import MCAPWriter  # noqa: F401 - the SDK is there
from mcap.reader import make_reader
from rig import Run

from tiller_tools import view
from tiller_tools.table import ReportError


def curves(path):
    """By entity path: tick -> value, of everything that is a scalar."""
    found = {}
    for chunk in rerun.chunk.RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if name.endswith("Scalars:scalars")]
        if not names or chunk.is_static:
            continue
        ticks = batch.column("tick").to_pylist()
        for tick, value in zip(ticks, batch.column(names[0]).to_pylist()):
            found.setdefault(chunk.entity_path.lstrip("/").replace("\\", ""), {})[tick] = value[0]
    return found


def entities(path):
    return {chunk.entity_path.lstrip("/").replace("\\", "") for chunk in rerun.chunk.RrdReader(str(path)).stream()}


def messages(path):
    """By topic: a list of messages."""
    found = {}
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                found.setdefault(channel.topic, []).append(json.loads(message.data))
            else:
                found.setdefault(channel.topic, []).append(message.data)
    return found


class Rerun(Run):
    def compare(self, path, shown):
        rows = self.rows()
        found = curves(path)
        self.assertEqual(len(found["states/angle_rad/mean"]), shown)
        pairs = {"states/angle_rad/mean": "mean.angle_rad", "states/position_m/measured": "position_m",
                 "commands/force_N": "force_N", "parameters/pole_mass_kg/mean": "mean.pole_mass_kg",
                 "forces/cart_N/mean": "force.mean.cart_N"}
        pairs = {entity: column for entity, column in pairs.items() if column in rows[0]}
        self.assertGreaterEqual(len(pairs), 4)
        for entity, column in pairs.items():
            for tick, value in found[entity].items():
                self.assertEqual(value, float(rows[tick][column]), f"{entity} in tick {tick}")
        sd = [float(row["sd.angle_rad"]) for row in rows]
        for tick, high in found["states/angle_rad/high"].items():
            self.assertAlmostEqual(high - float(rows[tick]["mean.angle_rad"]), 2 * sd[tick], delta=1e-7)
        return found, rows

    def test_a_run(self):
        told = self.steer("--view", "rerun", "--view-file", "run.rrd", "--view-layout", "run.rbl")
        shown, dropped = self.counted(told)
        self.assertEqual(shown + dropped, len(self.rows()))
        self.assertGreater(shown, 0)
        found, rows = self.compare(self.folder / "run.rrd", shown)
        foreseen = [(tick, float(rows[tick]["foreseen.mean.angle_rad"]), float(rows[tick]["foreseen.sd.angle_rad"]))
                    for tick in found["states/angle_rad/foreseen_low"]]
        for tick, mean, sd in foreseen:
            self.assertAlmostEqual(found["states/angle_rad/foreseen_low"][tick], mean - 2 * sd, delta=1e-6)
        drawn = {"robot/estimate", "robot/truth", "robot/goal", "robot/plan", "planned/force_N", "predicted/angle_rad",
                 "particles/pole_mass_kg", "events"}
        self.assertEqual(drawn - entities(self.folder / "run.rrd"), set())
        self.assertGreater((self.folder / "run.rbl").stat().st_size, 0)

    def test_a_log(self):
        self.steer("--record", "run.mcap")
        done = self.tiller("view", "run.mcap", "--view-file", "log.rrd")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertEqual(self.counted(done.stdout), (len(self.rows()), 0), "a log has time")
        self.assertNotIn("are not the log's", done.stdout)
        self.compare(self.folder / "log.rrd", len(self.rows()))
        self.assertIn("particles/pole_mass_kg", entities(self.folder / "log.rrd"))


class Foxglove(Run):
    def test_a_run(self):
        told = self.steer("--view", "foxglove", "--view-file", "view.mcap", "--view-layout", "view.json")
        shown, dropped = self.counted(told)
        rows = self.rows()
        self.assertEqual(shown + dropped, len(rows))
        found = messages(self.folder / "view.mcap")
        self.assertEqual(len(found["/tick"]), shown)
        for tick, command in zip(found["/tick"], found["/command"]):
            row = rows[int(tick["tick"])]
            self.assertEqual(tick["state"], row["state"])
            self.assertEqual(tick["status"], row["status"])
            self.assertEqual(command["force_N"], float(row["force_N"]))
            for name, value in tick["mean"].items():
                self.assertEqual(value, float(row[f"mean.{name}"]), name)
            for name, value in tick["q95"].items():
                self.assertAlmostEqual(value, float(row[f"q95.{name}"]), delta=1e-8 * max(1, abs(value)))
        self.particles(found["/particles"], {int(t["tick"]): t for t in found["/tick"]})
        self.assertEqual(len(found["/prediction"][-1]["angle_rad"]["low"]), 25)
        self.assertTrue(any(len(scene) > 100 for scene in found["/robot"]))
        self.layout(found)

    def particles(self, clouds, ticks):
        """Their weighted mean is the posterior's, where the cloud is drawn whole."""
        last = clouds[-1]
        mean = np.average(last["pole_mass_kg"], weights=last["weight"])
        told = [tick["mean"]["pole_mass_kg"] for tick in ticks.values()]
        self.assertLess(min(abs(mean - t) for t in told[-2:]), 1e-9)
        self.assertTrue(math.isclose(sum(last["histogram"]["pole_mass_kg"]["share"]), 1, rel_tol=1e-9))

    def layout(self, found):
        """Every path of it leads to something."""
        made = json.loads((self.folder / "view.json").read_text(encoding="utf-8"))
        paths = [path["value"] for panel in made["configById"].values() for path in panel.get("paths", [])]
        self.assertGreater(len(paths), 10)
        for path in paths:
            node = found[re.match(r"/\w+", path)[0]][-1]
            for word in re.findall(r'\."([^"]+)"|\.([\w]+)', path):
                node = node[word[0] or word[1]]


class Packages(unittest.TestCase):
    def test_what_is_missing_comes_with_its_line(self):
        prefix = view.sys.prefix
        view.sys.prefix = "/nowhere"
        try:
            with self.assertRaisesRegex(ReportError, "-m pip install no-such-sdk"):
                view.need("no_such_sdk_at_all", "no-such-sdk")
        finally:
            view.sys.prefix = prefix


class Wrong(Run):
    def test_words(self):
        for arguments, says in ((["--view", "rviz"], "rerun"), (["--view-file", "a.rrd"], "--view rerun"),
                                (["--view", "rerun", "--view-file", "a.mcap"], "end in .rrd"),
                                (["--view", "foxglove", "--view-file", "none/a.mcap"], "does not exist")):
            done = self.tiller("run", "robot.toml", "--sim", "--quiet", "--seconds", "1", *arguments)
            self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
            self.assertIn(says, done.stderr)


if __name__ == "__main__":
    unittest.main()
