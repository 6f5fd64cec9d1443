"""A CSV of an MCAP file: python -m tiller_tools.mcap_csv run.mcap -o run.csv --states angle_rad --inputs torque_Nm

Messages are JSON objects (message encoding "json"). Every number in them is a channel "topic.field", nested fields and
lists as "topic.field.inner" and "topic.field.0"; the field's name alone is enough where only one topic has it. A row is
a message of the first state's topic, at its time in the log. States of other topics are interpolated to that time. An
input is the one in force from then on: the last that was logged before the next row.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from .table import ReportError, write_page


def _flatten(value, name: str, out: dict) -> None:
    if isinstance(value, bool) or isinstance(value, (int, float)):
        out[name] = float(value)
    elif isinstance(value, dict):
        for key, inner in value.items():
            _flatten(inner, f"{name}.{key}", out)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            _flatten(inner, f"{name}.{i}", out)


def read_channels(path: Path) -> dict:
    """Name "topic.field" -> (times in s, values), in the order of the log."""
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
    except ImportError:
        raise ReportError(f"{path}: reading MCAP needs the Python package mcap: run ./dev setup") from None
    channels: dict = {}
    others: dict = {}
    try:
        with open(path, "rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                if channel.message_encoding != "json":
                    others[channel.topic] = channel.message_encoding or "none"
                    continue
                numbers: dict = {}
                _flatten(json.loads(message.data), channel.topic.strip("/"), numbers)
                for name, value in numbers.items():
                    times, values = channels.setdefault(name, ([], []))
                    times.append(1e-9 * message.log_time)
                    values.append(value)
    except FileNotFoundError:
        raise ReportError(f"{path}: no such file") from None
    except (McapError, OSError, ValueError) as error:
        raise ReportError(f"{path}: cannot be read: {error}; the recording may be cut off: recover it with `mcap recover`") \
            from None
    if not channels:
        told = ", ".join(f"{topic} ({encoding})" for topic, encoding in sorted(others.items())) or "no message at all"
        raise ReportError(f"{path}: no JSON messages; the file has {told}. Record in JSON, or export as CSV")
    return {name: (np.array(times), np.array(values)) for name, (times, values) in channels.items()}


def _find(channels: dict, name: str, path: Path) -> str:
    matches = [key for key in channels if key == name or key.endswith("." + name)]
    if name in channels:
        return name
    if len(matches) == 1:
        return matches[0]
    known = ", ".join(sorted(matches or channels))
    problem = "is in several topics" if matches else "is not there"
    raise ReportError(f"{path}: channel '{name}' {problem}: {known}; name it in [log] columns = {{ ... = \"topic.field\" }}")


def convert(path: Path, states: list, inputs: list) -> str:
    """The CSV's text."""
    channels = read_channels(path)
    time = channels[_find(channels, states[0], path)][0]
    columns = [time - time[0]]
    for name in states:
        at, values = channels[_find(channels, name, path)]
        columns.append(values if at is time or np.array_equal(at, time)
                       else np.interp(time, at, values, left=np.nan, right=np.nan))
    until = np.append(time[1:], np.inf)
    first = 0
    for name in inputs:
        at, values = channels[_find(channels, name, path)]
        last = np.searchsorted(at, until, side="left") - 1
        first = max(first, int(np.argmax(last >= 0)))
        columns.append(values[np.maximum(last, 0)])
    lines = [",".join(["time_s", *states, *inputs])]
    for row in range(first, len(time)):  # before the first command nobody knows what acted
        cells = [f"{columns[0][row]:.9f}"] + ["" if np.isnan(c[row]) else f"{c[row]:.12g}" for c in columns[1:]]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.mcap_csv", description="A CSV of an MCAP file.")
    parser.add_argument("mcap")
    parser.add_argument("-o", "--out", required=True)
    parser.add_argument("--states", nargs="+", required=True, help="columns, the first one's topic gives the rows")
    parser.add_argument("--inputs", nargs="*", default=[], help="columns that are held until the next row")
    options = parser.parse_args(argv)
    try:
        write_page(options.out, convert(Path(options.mcap), options.states, options.inputs))
    except ReportError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
