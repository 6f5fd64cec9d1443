"""MCAP logs become the rows that were recorded."""

import csv
import io
import json
import os
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

from tiller_tools import mcap_csv, table  # noqa: E402

try:
    from mcap.writer import Writer
except ImportError:
    Writer = None


@unittest.skipUnless(Writer, "no Python package mcap: ./dev setup installs it")
class Mcap(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def write(self, messages: list, encoding: str = "json") -> Path:
        """(time in ms, topic, object) in any order."""
        path = self.folder / "run.mcap"
        with open(path, "wb") as file:
            writer = Writer(file)
            writer.start()
            channels = {topic: writer.register_channel(topic=topic, message_encoding=encoding, schema_id=0)
                        for topic in dict.fromkeys(topic for _, topic, _ in messages)}
            for at, topic, content in messages:
                writer.add_message(channels[topic], log_time=at * 1000000, publish_time=at * 1000000,
                                   data=json.dumps(content).encode())
            writer.finish()
        return path

    def rows(self, path: Path, states: list, inputs: list) -> list:
        return list(csv.DictReader(io.StringIO(mcap_csv.convert(path, states, inputs))))

    def test_rows_states_and_held_commands(self):
        messages = [(10 * k, "/arm/joint", {"angle_rad": 0.1 * k, "name": "x"}) for k in range(6)]
        messages += [(10 * k + 5, "/arm/rate", {"twist": {"z": [1.0 * k, 0]}}) for k in range(6)]
        # answers come 2 ms after what they answer; none to the first, and the one to number 3 is lost
        messages += [(10 * k + 2, "/arm/command", {"torque_Nm": 1.0 * k}) for k in (1, 2, 4, 5)]
        rows = self.rows(self.write(messages), ["angle_rad", "arm/rate.twist.z.0"], ["torque_Nm"])
        self.assertEqual([float(r["time_s"]) for r in rows], [0.01, 0.02, 0.03, 0.04, 0.05])
        self.assertEqual([float(r["torque_Nm"]) for r in rows], [1, 2, 2, 4, 5])
        self.assertAlmostEqual(float(rows[1]["angle_rad"]), 0.2)
        self.assertAlmostEqual(float(rows[1]["arm/rate.twist.z.0"]), 1.5)

    def test_what_is_wrong_is_told(self):
        def told(path, states, inputs):
            with self.assertRaises(table.ReportError) as caught:
                mcap_csv.convert(path, states, inputs)
            return str(caught.exception)

        path = self.write([(k, topic, {"x": k}) for k in range(9) for topic in ("/a", "/b")])
        self.assertIn("channel 'y' is not there: a.x, b.x", told(path, ["y"], []))
        self.assertIn("in several topics: a.x, b.x", told(path, ["x"], []))
        self.assertIn("no such file", told(self.folder / "none.mcap", ["x"], []))
        self.assertIn("no JSON messages; the file has /a (cdr)", told(self.write([(1, "/a", {})], "cdr"), ["x"], []))
        cut = self.folder / "cut.mcap"
        cut.write_bytes(path.read_bytes()[:60])
        self.assertIn("cannot be read", told(cut, ["x"], []))


if __name__ == "__main__":
    unittest.main(verbosity=2)
