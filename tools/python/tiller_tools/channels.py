"""Named columns of a log that is no CSV: python -m tiller_tools.channels FILE -o OUT [--columns NAME ...]

    ROS bags (1; 2 as SQLite or MCAP, file or folder)   package rosbags
    PX4 ULog                                            package pyulog
    MCAP with JSON messages                             package mcap
    MAT (to version 7), NPZ, Parquet                    packages scipy, numpy, pyarrow

Of messages a column is "topic.field": /imu.angular_velocity.z, vehicle_angular_velocity.xyz[1], /cmd.data.0. An entry of
a list may be named where the message has names: /joint_states.position[elbow]. The slash in front, and the topic where
only one has the field, may be left out. ULog's second instance of a topic is topic[1]. Of arrays, a vector is a column
of its name, a matrix one for each of its shorter side, "name.0", "name.1"; the length that most vectors have is the
log's. FILE#2 is element 2 (from 0) of a MAT file's cell arrays.

A sample's time is when it was measured: the message's header.stamp (ROS), timestamp_sample (ULog). Messages without one
have the time when they were received (ROS) or published (ULog); where that is another clock, as with simulated time, it is
put on the headers' clock by a topic that has both. Where the headers' clock was set, or there are several, all times are
those of receipt. Samples are put in order of time; of messages with one stamp the last counts.

OUT is a line of JSON, then the numbers as 64-bit floats: each clock's times in s, then each channel's values.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import difflib
import io
import json
import re
import sys
import zipfile
from pathlib import Path

import numpy as np

from .table import ReportError

CLOCKS_AGREE_NS = 10**9  # further apart, they are not one clock with a message on its way
MOST_ENTRIES = 32  # of a list, to tell of: an image has more
MOST_LOOKED_AT = 20  # messages of JSON, whose first ones may lack a number
NAMES = ("name", "names", "joint_names", "actuator_names")


def needs(package: str, what: str, path: Path) -> ReportError:
    return ReportError(f"{path}: {what} is read by the Python package {package}, which {sys.executable} lacks; install it "
                       f"once: {sys.executable} -m pip install {package} (or set TILLER_PYTHON to an interpreter that has "
                       "it)")


# ---- arrays ----


def _load_mat(path: Path) -> dict:
    try:
        import scipy.io
    except ImportError:
        raise needs("scipy", "MAT", path) from None
    try:
        data = scipy.io.loadmat(path)
    except NotImplementedError:
        raise ReportError(f"{path}: MAT of version 7.3 is HDF5; save it with -v7") from None
    return {name: value for name, value in data.items() if not name.startswith("__")}


def _load_parquet(path: Path) -> dict:
    try:
        import pyarrow.parquet
    except ImportError:
        raise needs("pyarrow", "Parquet", path) from None
    table = pyarrow.parquet.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def load_arrays(path: Path, first: bytes) -> dict:
    """Name -> array."""
    try:
        if first[:4] == b"PAR1":
            return _load_parquet(path)
        if first[:2] == b"PK":
            with np.load(path, allow_pickle=False) as data:
                return {name: data[name] for name in data.files}
        return _load_mat(path)
    except (OSError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise ReportError(f"{path}: cannot be read: {error}") from None


def _element(value: np.ndarray, element: int) -> np.ndarray:
    """Of a cell array the one that was asked for, nothing where it has fewer; of anything else itself."""
    if value.dtype != object:
        return value
    cells = value.ravel()
    return np.asarray(cells[element]) if element < len(cells) else np.empty(0)


def _check_element(arrays: dict, element: int | None, path: Path) -> None:
    runs = max((np.asarray(v).size for v in arrays.values() if np.asarray(v).dtype == object), default=0)
    if element is None and runs > 1:
        raise ReportError(f"{path}: holds {runs} runs; name one, from {path}#0 to {path}#{runs - 1}")
    if element is not None and element >= runs:
        raise ReportError(f"{path}: there is no #{element}: " +
                          (f"its runs are #0 to #{runs - 1}" if runs else "it holds one log, without cell arrays of runs"))


def columns_of(arrays: dict, element: int | None, path: Path) -> dict:
    """Name -> values of one length."""
    _check_element(arrays, element, path)
    numbers = {}
    for name, value in arrays.items():
        inner = _element(np.asarray(value), element or 0)
        if inner.dtype.kind in "fiub" and 0 < inner.ndim <= 2 and inner.size > 1:
            numbers[name] = np.squeeze(inner.astype(float))
    lengths = collections.Counter(max(value.shape) for value in numbers.values())
    if not lengths:
        raise ReportError(f"{path}: holds no vector of numbers; it has: {', '.join(sorted(arrays)) or 'nothing'}")
    rows = max(lengths, key=lambda n: (lengths[n], n))
    columns = {}
    for name, value in numbers.items():
        if max(value.shape) != rows:
            continue
        if value.ndim == 1:
            columns[name] = value
            continue
        table = value if value.shape[0] == rows else value.T
        columns.update({f"{name}.{i}": table[:, i] for i in range(table.shape[1])})
    return columns


# ---- fields of messages ----


def tokens_of(field: str) -> list:
    """"position[elbow]" -> ["position", "elbow"], "xyz.0.x" -> ["xyz", "0", "x"]."""
    return [token for token in re.split(r"[.\[\]]+", field) if token]


def _member(value, name: str):
    if isinstance(value, dict):
        return value.get(name)
    return None if name.startswith("_") else getattr(value, name, None)


def _is_list(value) -> bool:
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def value_at(message, tokens: list):
    """The number at the field, or None."""
    above, value = [], message
    for token in tokens:
        if not _is_list(value):
            above.append(value)
            value = _member(value, token)
        elif token.isdigit():
            value = value[int(token)] if int(token) < len(value) else None
        else:  # by the names that this message has, or the one around it
            lists = (_member(m, names) for m in reversed(above) for names in NAMES)
            index = next((list(names).index(token) for names in lists if _is_list(names) and token in list(names)), None)
            value = value[index] if index is not None and index < len(value) else None
        if value is None:
            return None
    return float(value) if isinstance(value, (bool, int, float, np.generic)) else None


def fields_of(message, prefix: str = "", names: list | None = None) -> list:
    """Every number of a message, as a column would name it."""
    if isinstance(message, (bool, int, float, np.number, np.bool_)):
        return [prefix]
    if _is_list(message):
        if len(message) > MOST_ENTRIES:
            return [f"{prefix}[0] .. [{len(message) - 1}]"]
        labels = names if names is not None and len(names) == len(message) else range(len(message))
        return [f for label, inner in zip(labels, message) for f in fields_of(inner, f"{prefix}[{label}]")]
    if isinstance(message, dict):
        members = message
    elif hasattr(message, "__dataclass_fields__"):
        members = {name: getattr(message, name) for name in message.__dataclass_fields__ if not name.startswith("_")}
    else:
        return []
    named = next((list(members[n]) for n in NAMES if n in members and _is_list(members[n]) and
                  all(isinstance(x, str) for x in members[n])), None)
    dot = prefix + "." if prefix else ""
    return [f for name, inner in members.items() for f in fields_of(inner, dot + name, named)]


def stamp_of(message) -> int:
    """header.stamp in ns; 0: none."""
    stamp = _member(_member(message, "header"), "stamp")
    if stamp is None:
        return 0
    pick = lambda *names: next((v for v in (_member(stamp, n) for n in names) if v is not None), 0)
    return int(pick("sec", "secs")) * 10**9 + int(pick("nanosec", "nsec", "nsecs"))


class Topic:
    """Of one topic: what its first message has, and the samples of the fields that were asked for."""

    def __init__(self, name: str, kind: str, count: int):
        self.name, self.kind, self.count = name, kind, count
        self.fields: list = []  # that the first message has
        self.wanted: dict = {}  # column -> field
        self.received: list = []  # ns
        self.measured: list = []  # ns; 0: the message does not say
        self.values: dict = {}

    def take(self, message, received_ns: int, tokens: list) -> None:
        """`tokens`: (column, tokens) of what is wanted."""
        self.received.append(received_ns)
        self.measured.append(stamp_of(message))
        for column, field in tokens:
            value = value_at(message, field)
            self.values[column].append(np.nan if value is None else value)

    def text(self) -> str:
        """For messages: entries of a list as its range, without the header."""
        lists: dict = {}
        for field in self.fields:
            stem, bracket, entry = field.partition("[")
            if not field.startswith("header."):
                lists.setdefault(stem if bracket and entry[:-1].isdigit() else field, []).append(field)
        short = [f"{stem}[0] .. [{len(f) - 1}]" if len(f) > 2 else ", ".join(f) for stem, f in lists.items()]
        return f"{self.name} ({self.kind}, {self.count}): {', '.join(short) or 'no number'}"


def assign(topics: dict, columns: list) -> dict:
    """Gives each column to its topic. Returns what is wrong: column -> text."""
    problems = {}
    by_length = sorted(topics.values(), key=lambda topic: -len(topic.name))
    for column in columns:
        plain = column.lstrip("/")
        owner = next((t for t in by_length if plain.startswith(t.name.lstrip("/") + ".")), None)
        if owner is not None:
            owner.wanted[column] = plain[len(owner.name.lstrip("/")) + 1:]
            continue
        tokens = tokens_of(plain)
        hits = [(t, f) for t in topics.values() for f in t.fields if tokens_of(f)[-len(tokens):] == tokens]
        if len(hits) == 1:
            hits[0][0].wanted[column] = hits[0][1]
        elif hits:
            problems[column] = "several topics have that field: " + ", ".join(f"{t.name}.{f}" for t, f in hits)
        else:
            problems[column] = "there is no such field" + nearest(column, topics)
    return problems


def nearest(column: str, topics: dict) -> str:
    known = [f"{t.name}.{f}" for t in topics.values() for f in t.fields]
    near = difflib.get_close_matches(column, known, 1)
    asked = f" (did you mean '{near[0]}'?)" if near else ""
    return asked + "; the log has " + ("; ".join(t.text() for t in topics.values()) or "no message at all")


# ---- sources of messages: topics(), then read() of those with wanted columns ----


class JsonMcap:
    clocks = ("header stamps", "times of receipt")

    def __init__(self, path: Path, file, reader, channels):
        self.path, self.reader, self.channels, self.close = path, reader, channels, file.close

    def topics(self) -> dict:
        found: dict = {}
        for channel in self.channels:
            kind = "JSON" if channel.message_encoding == "json" else (channel.message_encoding or "no encoding")
            found[channel.topic] = Topic(channel.topic, kind, 0)
        for channel, message in self._messages(None):
            topic = found[channel.topic]
            topic.count += 1
            if topic.count <= MOST_LOOKED_AT and channel.message_encoding == "json":
                topic.fields = list(dict.fromkeys(topic.fields + fields_of(json.loads(message.data))))
        return found

    def _messages(self, topics):
        from mcap.exceptions import McapError
        try:
            for _, channel, message in self.reader.iter_messages(topics=topics):
                yield channel, message
        except (McapError, OSError, ValueError) as error:
            raise ReportError(f"{self.path}: cannot be read: {error}; the recording may be cut off: recover it with "
                              "`mcap recover`") from None

    def read(self, topics: dict) -> None:
        wanted = {name: [(c, tokens_of(f)) for c, f in t.wanted.items()] for name, t in topics.items() if t.wanted}
        for channel, message in self._messages(list(wanted)):
            if channel.message_encoding == "json":
                topics[channel.topic].take(json.loads(message.data), message.log_time, wanted[channel.topic])


class Bag:
    clocks = ("header stamps", "times of receipt")

    def __init__(self, path: Path):
        try:
            from rosbags.highlevel import AnyReader, AnyReaderError
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise needs("rosbags", "a ROS bag", path) from None
        self.path, self.errors = path, (AnyReaderError, OSError, ValueError, KeyError, AssertionError, EOFError)
        self.close = lambda: self.reader.close()
        try:
            self.reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
            self.reader.open()
        except self.errors as error:
            raise self.unreadable(error) from None

    def unreadable(self, error) -> ReportError:
        return ReportError(f"{self.path}: cannot be read as a ROS bag: {error}; a recording that was cut off is mended by "
                           "`rosbag reindex`, `ros2 bag reindex` or `mcap recover`")

    def _messages(self, connections):
        try:
            for connection, time_ns, data in self.reader.messages(connections=connections):
                yield connection, time_ns, data
        except Exception as error:  # of SQLite and of decompressors too
            raise self.unreadable(error) from None

    def topics(self) -> dict:
        found = {name: Topic(name, info.msgtype or "several types", info.msgcount)
                 for name, info in self.reader.topics.items()}
        for connection in self.reader.connections:
            for _, _, data in self._messages([connection]):
                with contextlib.suppress(Exception):  # of a type that nobody knows there is nothing to tell
                    found[connection.topic].fields = fields_of(self.reader.deserialize(data, connection.msgtype))
                break
        return found

    def read(self, topics: dict) -> None:
        wanted = {name: [(c, tokens_of(f)) for c, f in t.wanted.items()] for name, t in topics.items() if t.wanted}
        connections = [c for c in self.reader.connections if c.topic in wanted]
        for connection, time_ns, data in self._messages(connections) if connections else ():
            try:
                message = self.reader.deserialize(data, connection.msgtype)
            except Exception as error:
                raise ReportError(f"{self.path}: a message of {connection.topic} ({connection.msgtype}) cannot be "
                                  f"decoded: {error!r}") from None
            topics[connection.topic].take(message, time_ns, wanted[connection.topic])


class ULogFile:
    clocks = ("timestamp_sample", "timestamp")

    def __init__(self, path: Path):
        try:
            import pyulog
        except ImportError:
            raise needs("pyulog", "ULog", path) from None
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                self.log = pyulog.ULog(str(path))
        except Exception as error:  # whatever damaged bytes lead to
            raise ReportError(f"{path}: cannot be read as ULog: {error!r}; the file is damaged or empty") from None
        self.close = lambda: None
        self.note = "the file is damaged, and read as far as it goes" if self.log.file_corruption else ""

    def topics(self) -> dict:
        found = {}
        for data in self.log.data_list:
            name = data.name + (f"[{data.multi_id}]" if data.multi_id else "")
            found[name] = Topic(name, "ULog", len(data.data["timestamp"]))
            found[name].fields = [field for field in data.data if not field.startswith("_padding")]
            found[name].data = data.data
        return found

    def read(self, topics: dict) -> None:
        for topic in topics.values():
            if not topic.wanted:
                continue
            by_tokens = {tuple(tokens_of(field)): values for field, values in topic.data.items()}
            topic.received = 1000 * topic.data["timestamp"].astype(np.int64)
            sampled = topic.data.get("timestamp_sample")
            topic.measured = np.zeros_like(topic.received) if sampled is None else 1000 * sampled.astype(np.int64)
            for column, field in topic.wanted.items():
                values = by_tokens.get(tuple(tokens_of(field)))
                topic.values[column] = np.full(topic.count, np.nan) if values is None else values


# ---- stamps ----


def _was_set(topic: Topic) -> bool:
    """Whether the clock of the header stamps goes back, or ahead by more than the receipts do. Not while a simulation
    pauses: then the receipts alone go on."""
    steps = np.diff(topic.measured)
    return bool(np.any(steps < -CLOCKS_AGREE_NS) or np.any(steps - np.diff(topic.received) > CLOCKS_AGREE_NS))


def _on_clock_of(topic: Topic, received: np.ndarray) -> np.ndarray:
    """Times of receipt as times of the clock that stamps `topic`; beyond its ends both go equally fast."""
    first_r, first_m, last_r, last_m = topic.received[0], topic.measured[0], topic.received[-1], topic.measured[-1]
    inside = np.interp(received - first_r, topic.received - first_r, np.maximum.accumulate(topic.measured - first_m))
    return np.where(received < first_r, first_m + received - first_r,
                    np.where(received > last_r, last_m + received - last_r, first_m + np.round(inside).astype(np.int64)))


def stamps_of(topics: list, clocks: tuple) -> tuple:
    """Topic name -> stamps in ns, and a note that says which they are."""
    measured, received = clocks
    headed = [t for t in topics if len(t.measured) and np.all(t.measured != 0)]
    bare = [t for t in topics if t not in headed]
    all_received = {t.name: t.received for t in topics}
    if not headed:
        return all_received, f"stamps are {received}"
    most = max(headed, key=lambda t: len(t.received))
    apart = [np.median(np.abs(_on_clock_of(most, t.received) - t.measured)) for t in headed]
    if any(_was_set(t) for t in headed) or max(apart) > CLOCKS_AGREE_NS:
        return all_received, f"stamps are {received}: {measured} are of several clocks, or their clock was set"
    stamps = {t.name: t.measured for t in headed}
    one_clock = np.max(np.abs(most.received - most.measured)) <= CLOCKS_AGREE_NS
    stamps.update({t.name: t.received if one_clock else _on_clock_of(most, t.received) for t in bare})
    note = f"stamps are {measured}" + (f", of {', '.join(t.name for t in bare)} {received}" if bare else "")
    return stamps, note + (f", put on the clock of {most.name}" if bare and not one_clock else "")


def put_in_order(topic: Topic, stamps: np.ndarray, path: Path) -> tuple:
    """Stamps that rise, the values that belong to them, and what was done to get there."""
    steps, notes = np.diff(stamps), []
    if len(steps) and steps.min() < -CLOCKS_AGREE_NS:
        at = int(np.argmin(steps))
        raise ReportError(f"{path}: the time of {topic.name} goes back by {-1e-9 * steps[at]:.6g} s at its message "
                          f"{at + 2}: a second run, or a clock that was set; cut the recording there")
    order = np.argsort(stamps, kind="stable")
    if late := int(np.sum(steps < 0)):
        notes.append(f"{late} messages of {topic.name} came late and are put in order")
    stamps = stamps[order]
    values = {column: np.asarray(v, dtype=float)[order] for column, v in topic.values.items()}
    last = np.append(np.diff(stamps) > 0, True)
    if repeated := int(np.sum(~last)):
        notes.append(f"{repeated} messages of {topic.name} have the stamp of the next one, which counts")
    return stamps[last], {column: v[last] for column, v in values.items()}, notes


# ---- all of it ----


def open_source(path: Path, first: bytes):
    if first.startswith(b"ULog\x01\x12\x35"):
        return ULogFile(path)
    if first.startswith(b"\x89MCAP0\r\n"):
        try:
            from mcap.exceptions import McapError
            from mcap.reader import make_reader
        except ImportError:
            return Bag(path)  # reads all but JSON
        file = open(path, "rb")
        try:
            reader = make_reader(file)
            summary = reader.get_summary()
            channels = list(summary.channels.values()) if summary else []
        except (McapError, OSError, ValueError, EOFError) as error:
            file.close()
            raise ReportError(f"{path}: cannot be read: {error}; the recording may be cut off: recover it with "
                              "`mcap recover`") from None
        if not channels or any(c.message_encoding == "json" for c in channels):
            return JsonMcap(path, file, reader, channels)
        file.close()
    return Bag(path)


def first_bytes(path: Path) -> bytes:
    if path.is_dir():
        return b""
    try:
        with open(path, "rb") as file:
            return file.read(16)
    except FileNotFoundError:
        raise ReportError(f"{path}: no such file") from None
    except OSError as error:
        raise ReportError(f"{path}: cannot be read: {error.strerror}") from None


def field_names(path: Path) -> list:
    """"topic.field" of every number in a log of messages."""
    source = open_source(path, first_bytes(path))
    topics = source.topics()
    source.close()
    return [f"{t.name.lstrip('/')}.{f}" for t in topics.values() for f in t.fields]


def read_messages(path: Path, first: bytes, columns: list) -> tuple:
    """True (of topics), clocks (s), columns as (name, clock, values), every name, problems by column, note."""
    source = open_source(path, first)
    topics = source.topics()
    problems = assign(topics, columns)
    names = [f"{t.name}.{f}" for t in topics.values() for f in t.fields]
    for topic in topics.values():
        topic.values = {column: [] for column in topic.wanted}
    source.read(topics)
    source.close()
    used = []
    for topic in (t for t in topics.values() if t.wanted):
        for column, field in topic.wanted.items():
            if not len(topic.received):
                problems[column] = f"{topic.name} has no message" + \
                    (f"; it is {topic.kind}, which is not read: record JSON or CDR" if topic.count else "")
            elif np.all(np.isnan(topic.values[column])):
                problems[column] = f"no message of {topic.name} has a field {field}" + nearest(column, {topic.name: topic})
        topic.received, topic.measured = np.asarray(topic.received, np.int64), np.asarray(topic.measured, np.int64)
        used += [topic] if len(topic.received) else []
    stamps, note = stamps_of(used, source.clocks)
    notes = [n for n in (getattr(source, "note", ""), note if used else "") if n]
    start = min((int(s.min()) for s in stamps.values()), default=0)
    clocks, channels = [], []
    for topic in used:
        at, values, done = put_in_order(topic, stamps[topic.name], path)
        notes += done
        channels += [(column, len(clocks), v) for column, v in values.items()]
        clocks.append(1e-9 * (at - start))
    return True, clocks, channels, names, problems, "; ".join(notes)


def read_arrays(path: Path, first: bytes, element: int | None, columns: list) -> tuple:
    """The same of arrays; their stamps are a column, so that the clock is of no numbers."""
    found = columns_of(load_arrays(path, first), element, path)
    near = {c: difflib.get_close_matches(c, found, 1) for c in columns if c not in found}
    problems = {c: f"it has: {', '.join(found)}" + (f" (did you mean '{n[0]}'?)" if n else "") for c, n in near.items()}
    return False, [], [(c, -1, found[c]) for c in columns if c in found], list(found), problems, ""


def write(out: Path, topics: bool, clocks: list, channels: list, names: list, problems: dict, note: str) -> None:
    head = {"topics": topics, "clocks": [len(c) for c in clocks], "names": names, "problems": problems, "note": note,
            "channels": [{"name": name, "clock": clock, "rows": len(v)} for name, clock, v in channels]}
    try:
        with open(out, "wb") as file:
            file.write(json.dumps(head).encode() + b"\n")
            for values in [*clocks, *(v for _, _, v in channels)]:
                file.write(np.ascontiguousarray(values, "<f8").tobytes())
    except OSError as error:
        raise ReportError(f"{out}: cannot be written: {error.strerror}") from None


def read(name: str, columns: list) -> tuple:
    stem, mark, number = name.rpartition("#")
    element = int(number) if mark and number.isdigit() and not Path(name).exists() else None
    path = Path(stem if element is not None else name)
    first = first_bytes(path)
    if first[:8] == b"MATLAB 5" or first[:2] == b"PK" or first[:4] == b"PAR1":
        return read_arrays(path, first, element, columns)
    return read_messages(path, first, columns)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.channels", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("-o", "--out", required=True, type=Path)
    parser.add_argument("--columns", nargs="*", default=[], metavar="NAME")
    options = parser.parse_args(argv)
    try:
        write(options.out, *read(options.file, list(dict.fromkeys(options.columns))))
    except ReportError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
