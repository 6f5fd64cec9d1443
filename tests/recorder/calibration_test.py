"""A run that calibrates, then probes, replays to the last bit from each log that it leaves."""

import csv
import os
import pathlib
import subprocess
import sys
import tempfile

BOX = """
[probe]
weight = 1
box = { "angle_rad" = [-0.8, 0.8], "rate_rad_s" = [-6, 6] }
"""


def run(folder, *words):
    result = subprocess.run([os.environ["TILLER_COMMAND"], *words], cwd=folder, text=True, capture_output=True)
    print(" ".join(words), result.returncode, result.stdout[-400:], result.stderr[-400:], flush=True)
    return result


def main():
    source = pathlib.Path(os.environ["TILLER_ROBOTS"]) / "pendulum.toml"
    with tempfile.TemporaryDirectory() as folder:
        robot = pathlib.Path(folder) / "robot.toml"
        robot.write_text(source.read_text() + BOX)
        logs = ["run.csv", "run.rec", "run.mcap", "run.lcm"]
        for log in logs:
            option = "--log" if log.endswith("csv") else "--record"
            words = ("run", "robot.toml", "--sim", "--calibrate", "0.6", "--seconds", "1.2", option, log)
            assert run(folder, *words).returncode == 0, log
        with open(pathlib.Path(folder) / "run.csv") as file:
            rows = list(csv.DictReader(file))
        calibrating = [row for row in rows if row["probing"] == "2"]
        assert 20 <= len(calibrating) < len(rows), len(calibrating)
        assert float(rows[-1]["probe_allowed"]) > 0, "the task's account"
        for log in logs:
            told = run(folder, "replay", log, "robot.toml")
            assert told.returncode == 0 and f"{len(rows)} ticks replayed" in told.stdout, log
        # without the box nothing is repeated, and it says which line is missing
        robot.write_text(source.read_text())
        told = run(folder, "replay", "run.csv", "robot.toml")
        assert told.returncode == 1 and "[probe] box" in told.stdout + told.stderr, told
    return 0


if __name__ == "__main__":
    sys.exit(main())
