"""What tiller run writes, read by other people's readers: the Python packages mcap and lcm."""

import json
import os
import pathlib
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

import lcm
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

sys.path.insert(0, os.environ["TILLER_PYTHON"])
from tiller_lcm import forces_t  # noqa: E402

TILLER = os.environ["TILLER_COMMAND"]
ROBOTS = pathlib.Path(os.environ["TILLER_ROBOTS"])


def tiller(*arguments, cwd):
    return subprocess.run([TILLER, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=300,
                          check=False)


def messages_of(path):
    """Front to back, as a tool that recovers does: every message until the bytes end; whether they ended well."""
    found = []
    with open(path, "rb") as file:
        try:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Message):
                    found.append(record)
        except (EndOfFile, McapError, CRCValidationError, struct.error):  # of an index that is cut off
            return found, False
    return found, True


class Files(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.home = pathlib.Path(cls.folder.name)
        done = tiller("run", ROBOTS / "pendulum.toml", "--sim", "--seconds", "8", "--quiet", "--record", "run.rec",
                      "--record", "run.mcap", "--record", "run.lcm", "--log", "run.csv", cwd=cls.home)
        assert done.returncode == 0, done.stderr
        cls.rows = (cls.home / "run.csv").read_text().splitlines()[1:]

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_the_mcap_is_whole_and_says_what_it_holds(self):
        with open(self.home / "run.mcap", "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            summary = reader.get_summary()
            topics = {c.topic: summary.statistics.channel_message_counts[i] for i, c in summary.channels.items()}
            self.assertEqual(topics, {"/measurement": len(self.rows), "/command": len(self.rows), "/tick": len(self.rows)})
            ticks = {topic: [] for topic in topics}
            for schema, channel, message in reader.iter_messages():
                self.assertEqual((schema.encoding, channel.message_encoding), ("jsonschema", "json"))
                described = json.loads(schema.data)["properties"]
                content = json.loads(message.data)
                self.assertLessEqual(set(content), set(described), "every field has a type")
                kinds = {"number": (int, float), "integer": int, "string": str, "object": dict}
                for name, value in content.items():
                    self.assertIsInstance(value, kinds[described[name]["type"]])
                ticks[channel.topic].append(content)
            self.assertEqual({a.name for a in reader.iter_attachments()}, {"controller", "robot.toml"})
            toml = next(a.data for a in reader.iter_attachments() if a.name == "robot.toml")
            self.assertEqual(toml, (ROBOTS / "pendulum.toml").read_bytes())
        for row, measured, command in zip(self.rows, ticks["/measurement"], ticks["/command"]):
            cells = row.split(",")
            self.assertAlmostEqual(float(cells[1]), measured["angle_rad"], delta=1e-8 * max(1, abs(measured["angle_rad"])))
            self.assertAlmostEqual(float(cells[2]), command["torque_Nm"], delta=1e-8)

    def test_a_layout_for_foxglove_plots_what_the_file_has(self):
        package = ROBOTS.parent / "tools/python"
        command = [sys.executable, "-m", "tiller_tools.foxglove_layout", "run.mcap", "-o", "run.layout.json"]
        made = subprocess.run(command, cwd=self.home, env=dict(os.environ, PYTHONPATH=str(package)), check=False)
        self.assertEqual(made.returncode, 0)
        layout = json.loads((self.home / "run.layout.json").read_text())
        ticks = [json.loads(m.data) for m in messages_of(self.home / "run.mcap")[0] if b'"mean"' in m.data]
        drawn = {path["value"] for panel in layout["configById"].values() for path in panel.get("paths", [])}
        for name in ticks[0]["mean"]:
            self.assertIn("/tick.mean." + (f'"{name}"' if "." in name else name), drawn)

        def panels(part):
            return [part] if isinstance(part, str) else panels(part["first"]) + panels(part["second"])

        self.assertEqual(sorted(panels(layout["layout"])), sorted(layout["configById"]))

    def test_a_reader_that_seeks_finds_an_interval(self):
        with open(self.home / "run.mcap", "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            first = reader.get_summary().statistics.message_start_time
            found = list(reader.iter_messages(topics=["/tick"], starting_at=first + 2 * 10**9,
                                              ending_before=first + 3 * 10**9))
            self.assertEqual(len(found), 50)  # a second of 20 ms

    def test_cut_anywhere_it_opens_up_to_the_last_whole_chunk(self):
        whole = (self.home / "run.mcap").read_bytes()
        with open(self.home / "run.mcap", "rb") as file:
            ends = [c.chunk_start_offset + c.chunk_length for c in make_reader(file).get_summary().chunk_indexes]
            file.seek(0)
            counts = [sum(isinstance(r, Message) for r in breakup_chunk(record))
                      for record in StreamReader(file, emit_chunks=True).records if isinstance(record, Chunk)]
        self.assertEqual(sum(counts), 3 * len(self.rows))
        cut = self.home / "cut.mcap"
        for size in sorted({*range(0, len(whole), 9973), *(e + d for e in ends for d in (-1, 0, 1)), len(whole) - 1}):
            cut.write_bytes(whole[:size])
            found, ended_well = messages_of(cut)
            self.assertFalse(ended_well, size)
            self.assertEqual(len(found), sum(count for end, count in zip(ends, counts) if size >= end), size)

    def test_killed_it_is_a_finished_file_without_a_summary(self):
        """At ten instants: an unseekable and a seeking reader both take it, and the ticks replay. A kill in the midst
        of a write (the kernel looks for one at every page of it) leaves a file that is cut off there."""
        replayed = finished = 0
        for attempt in range(10):
            path, events_path = self.home / "killed.mcap", self.home / "killed.lcm"
            path.unlink(missing_ok=True)
            events_path.unlink(missing_ok=True)
            run = subprocess.Popen([TILLER, "run", str(ROBOTS / "pendulum.toml"), "--sim", "--quiet", "--record", str(path),
                                    "--record", str(events_path), "--alarm-seconds", "0"],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            until = time.monotonic() + 60
            size = 20000 + 7000 * attempt  # by what is on the disk, not by time
            # the files are written one after the other: an event log that nothing has reached yet has nothing to show
            enough = lambda file, bytes_: file.exists() and file.stat().st_size >= bytes_
            while not (enough(path, size) and enough(events_path, 4096)) and time.monotonic() < until:
                time.sleep(0.001)
            run.send_signal(signal.SIGKILL)
            run.wait()
            found, ended_well = messages_of(path)
            self.assertGreater(len(found), 0)
            finished += ended_well
            if ended_well:
                with open(path, "rb") as file:
                    reader = make_reader(file, validate_crcs=True)
                    self.assertIsNone(reader.get_summary())
                    self.assertEqual(sum(1 for _ in reader.iter_messages()), len(found))
            if attempt % 5 == 0:
                again = tiller("replay", path, ROBOTS / "pendulum.toml", cwd=self.home)
                self.assertEqual(again.returncode, 0, again.stdout + again.stderr)
                self.assertIn(", 0 different", again.stdout)
                replayed += 1
            events = sum(1 for _ in lcm.EventLog(str(events_path), "r"))
            self.assertGreater(events, 0)
        self.assertEqual(replayed, 2)
        self.assertGreaterEqual(finished, 7)

    def test_the_lcm_log_has_what_was_sent(self):
        counts = {}
        for event in lcm.EventLog(str(self.home / "run.lcm"), "r"):
            counts[event.channel] = counts.get(event.channel, 0) + 1
        rows = len(self.rows)
        self.assertEqual(counts, {"TILLER_MEASUREMENT": rows, "TILLER_COMMAND": rows, "TILLER_TELEMETRY": rows})

    def test_every_format_replays_to_the_last_bit_and_is_a_log(self):
        tables = set()
        for log in ("run.rec", "run.mcap", "run.lcm", "run.csv"):
            again = tiller("replay", log, ROBOTS / "pendulum.toml", cwd=self.home)
            self.assertEqual(again.returncode, 0, again.stdout + again.stderr)
            self.assertIn(f"{len(self.rows)} ticks replayed", again.stdout)
            learnt = tiller("identify", ROBOTS / "pendulum.toml", log, cwd=self.home)
            self.assertEqual(learnt.returncode, 0, learnt.stdout + learnt.stderr)
            if log != "run.csv":  # whose time_s has its own rounding
                tables.add(learnt.stdout.replace(log, "LOG"))
        self.assertEqual(len(tables), 1, "the same rows give the same posterior")
        found = [tiller("gap", ROBOTS / "pendulum.toml", log, "--json", cwd=self.home) for log in ("run.rec", "run.mcap")]
        self.assertLess(found[1].returncode, 4, found[1].stderr)
        strip = lambda text: {k: v for k, v in json.loads(text).items() if k in ("verdict", "effects", "explanations")}
        self.assertEqual(strip(found[0].stdout), strip(found[1].stdout))

    def test_forces_are_the_same_numbers_in_every_format(self):
        robot = self.home / "pushed.toml"
        robot.write_text((ROBOTS / "pendulum.toml").read_text() + "\n[posterior]\ndisturbance = true\n")
        done = tiller("run", robot, "--sim", "--seconds", "2", "--quiet", "--record", "pushed.mcap",
                      "--record", "pushed.lcm", "--log", "pushed.csv", cwd=self.home)
        self.assertEqual(done.returncode, 0, done.stderr)
        head, *rows = (line.split(",") for line in (self.home / "pushed.csv").read_text().splitlines())
        columns = [head.index(name) for name in ("force.mean.joint_Nm", "force.sd.joint_Nm", "touched")]
        wanted = [tuple(float(row[at]) for at in columns) for row in rows]
        self.assertGreater(len({row[0] for row in wanted}), 50, "or the comparison says nothing")
        ticks = [json.loads(m.data) for m in messages_of(self.home / "pushed.mcap")[0] if b'"force"' in m.data]
        forces = [tick["force"] for tick in ticks]
        self.assertEqual([(f["mean"]["joint_Nm"], f["sd"]["joint_Nm"], f["touched"]) for f in forces], wanted)
        sent = [forces_t.decode(event.data) for event in lcm.EventLog(str(self.home / "pushed.lcm"), "r")
                if event.channel == "TILLER_FORCES"]
        self.assertEqual([(f.mean[0], f.sd[0], f.touched) for f in sent], wanted)
        for log in ("pushed.mcap", "pushed.lcm", "pushed.csv"):
            again = tiller("replay", log, robot, cwd=self.home)
            self.assertEqual(again.returncode, 0, again.stdout + again.stderr)
            self.assertNotIn("forces beyond the model are not in it", again.stdout)
        older = tiller("replay", "run.lcm", robot, "--tolerance", "100", cwd=self.home)
        self.assertIn("run.lcm: the forces beyond the model are not in it", older.stdout)

    def test_a_log_of_another_run_differs_and_says_where(self):
        other = tiller("replay", "run.lcm", ROBOTS / "pendulum.toml", "--seed", "9", cwd=self.home)
        self.assertEqual(other.returncode, 4, other.stdout)
        self.assertRegex(other.stdout, r"first difference in tick 0, at 0.000000 s: recorded ACTIVE, replayed ACTIVE\n"
                                       r"  command   torque_Nm +recorded \S+ +replayed \S+ +\(\S+\)\n"
                                       r"  measured  angle_rad +\S+\n  state     angle_rad +recorded ")
        near = tiller("replay", "run.lcm", ROBOTS / "pendulum.toml", "--seed", "9", "--tolerance", "100", cwd=self.home)
        self.assertEqual(near.returncode, 0, near.stdout)
        self.assertIn("0 different by more than 100; largest difference", near.stdout)


if __name__ == "__main__":
    unittest.main(verbosity=2)
