"""MCAP with JSON messages: fields of topics, each with its stamps."""

import json
import os
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

from tiller_tools import channels, table  # noqa: E402

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

    def read(self, path: Path, *columns: str) -> tuple:
        """Column -> (times, values), and what is wrong."""
        _, clocks, found, _, problems, self.note = channels.read(str(path), list(columns))
        return {name: (clocks[clock], values) for name, clock, values in found}, problems

    def test_fields_have_the_stamps_of_their_messages(self):
        messages = [(10 * k, "/arm/joint", {"angle_rad": 0.1 * k, "name": "x"}) for k in range(6)]
        messages += [(10 * k + 5, "/arm/rate", {"twist": {"z": [1.0 * k, 0]}}) for k in range(6)]
        messages += [(10 * k + 2, "/arm/command", {"torque_Nm": 1.0 * k}) for k in (1, 2, 4, 5)]
        columns, problems = self.read(self.write(messages), "angle_rad", "arm/rate.twist.z.0", "torque_Nm")
        self.assertEqual(problems, {})
        for name, at, values in (("angle_rad", [0, 10, 20, 30, 40, 50], [0, 0.1, 0.2, 0.3, 0.4, 0.5]),
                                 ("arm/rate.twist.z.0", [5, 15, 25, 35, 45, 55], [0, 1, 2, 3, 4, 5]),
                                 ("torque_Nm", [12, 22, 42, 52], [1, 2, 4, 5])):
            np.testing.assert_allclose(columns[name][0], np.array(at) * 1e-3, atol=1e-12)
            np.testing.assert_allclose(columns[name][1], values)
        self.assertEqual(self.note, "stamps are times of receipt")

    def test_what_is_wrong_is_told(self):
        path = self.write([(k, topic, {"x": k}) for k in range(9) for topic in ("/a", "/b")])
        self.assertIn("there is no such field; the log has /a (JSON, 9): x; /b (JSON, 9): x", self.read(path, "y")[1]["y"])
        self.assertIn("several topics have that field: /a.x, /b.x", self.read(path, "x")[1]["x"])
        self.assertIn("no message of /a has a field z", self.read(path, "/a.z")[1]["/a.z"])
        cut = self.folder / "cut.mcap"
        cut.write_bytes(path.read_bytes()[:60])
        for wrong, said in ((self.folder / "none.mcap", "no such file"), (cut, "cannot be read")):
            with self.assertRaisesRegex(table.ReportError, said):
                self.read(wrong, "x")


if __name__ == "__main__":
    unittest.main(verbosity=2)
