"""identify, gap, excite and learn as functions: each runs the command of that name in a process of its own and reads
the JSON that it writes, so that result, page and exit code are the command's."""
from __future__ import annotations

import csv
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, Union

from . import _core
from ._calls import public
from ._command import failed, run
from ._errors import make_argument_error, missing_extra

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import pandas as pd
    from matplotlib.figure import Figure

PathLike = Union[str, "os.PathLike[str]"]
Logs = Union[PathLike, Sequence[PathLike]]
Option = Union[bool, int, float, str, "os.PathLike[str]", Sequence[Union[int, float, str, "os.PathLike[str]"]], None]


class Result:
    """What a command found: `json` as it wrote it, `folder` with all that it wrote, `text` with what it printed, and
    `exit_code`. A temporary folder is removed with the result."""

    @public
    def __init__(self, document: dict[str, Any], folder: Path, text: str, exit_code: int,
                 keep: tempfile.TemporaryDirectory[str] | None) -> None:
        self.json = document
        self.folder = folder
        self.text = text
        self.exit_code = exit_code
        self._keep = keep

    def _file(self, suffix: str) -> Path | None:
        return next(iter(sorted(self.folder.glob(f"*{suffix}"))), None)

    @property
    def page(self) -> Path | None:
        """The page (HTML); None where it was not drawn: that takes the extra `pages`."""
        return self._file(".html")

    def rows(self) -> list[dict[str, Any]]:
        """The table behind dataframe(), as dictionaries."""
        raise NotImplementedError

    def dataframe(self) -> pd.DataFrame:
        """The result as a pandas data frame (extra `pages`)."""
        try:
            import pandas
        except ImportError:
            raise missing_extra("pandas", "pages", "dataframe()") from None
        return pandas.DataFrame(self.rows())

    def figure(self) -> Figure:
        """The result as a matplotlib figure (extra `pages`)."""
        figure = _figure()
        self._draw(figure)
        return figure

    def _draw(self, figure: Figure) -> None:
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<tiller.{type(self).__name__} exit code {self.exit_code}, {self.folder}>"


def _figure() -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise missing_extra("matplotlib", "pages", "figure()") from None
    return Figure(layout="constrained")


class IdentifyResult(Result):
    """`candidates`: the nominal model, the fitted one, then with an effect more at a time."""

    @property
    def candidates(self) -> list[dict[str, Any]]:
        return list(self.json["candidates"])

    @public
    def parameters(self, candidate: int = -1) -> dict[str, dict[str, Any]]:
        """name -> mean, sd, interval_90, ... of one candidate, the last one by default."""
        count = len(self.candidates)
        if not -count <= candidate < count:
            raise make_argument_error("IdentifyResult.parameters", "candidate", repr(candidate),
                                      f"an index of the {count} candidates", "pass -1 for the last one", False)
        return {p["name"]: p for p in self.candidates[candidate]["parameters"]}

    @property
    def posterior_file(self) -> Path | None:
        """For [posterior] prior_file of a robot file."""
        return self._file("posterior.json")

    def rows(self) -> list[dict[str, Any]]:
        rows = []
        for candidate in self.candidates:
            for p in candidate["parameters"]:
                low, high = p.get("interval_90", (None, None))
                rows.append({"candidate": candidate["name"], "parameter": p["name"], "unit": p["unit"],
                             "fixed": p["fixed"], "mean": p["mean"], "sd": p.get("sd"), "low_90": low, "high_90": high})
        return rows

    def _draw(self, figure: Figure) -> None:
        learnt = [p for p in self.candidates[-1]["parameters"] if not p["fixed"]]
        axes = figure.subplots(max(1, len(learnt)), 1, squeeze=False)[:, 0]
        for axis, p in zip(axes, learnt):
            names = [c["name"] for c in self.candidates if c["learns"]]
            for k, name in enumerate(names):
                candidate = next(c for c in self.candidates if c["name"] == name)
                of = next((q for q in candidate["parameters"] if q["name"] == p["name"]), None)
                if of and not of["fixed"]:
                    axis.plot(of["interval_90"], [k, k], lw=2, color="C0")
                    axis.plot(of["mean"], k, "o", color="C0")
            axis.set_yticks(range(len(names)), names)
            axis.set_xlabel(f"{p['name']} [{p['unit']}]" if p["unit"] else p["name"])


class GapResult(Result):
    """`verdict` and `sentence` say what was found; `ranking` has the effects that explain it, best first."""

    @property
    def verdict(self) -> str:
        return str(self.json["verdict"])

    @property
    def sentence(self) -> str:
        return str(self.json["sentence"])

    @property
    def ranking(self) -> list[dict[str, Any]]:
        return list(self.json["ranking"])

    @property
    def robot_file(self) -> Path | None:
        """The robot file with what was found."""
        return self._file("_gap.toml")

    def rows(self) -> list[dict[str, Any]]:
        rows = []
        for one in self.ranking:
            names = [f"{e['kind']} ({e['port']})" if e.get("port") else e["kind"] for e in one["effects"]]
            rows.append({"effects": " + ".join(names) or "none", **_flat(one)})
        return rows

    def _draw(self, figure: Figure) -> None:
        """A held-out stretch: measured, rolled out without and with what was found."""
        figure.suptitle(self.sentence, fontsize="small", wrap=True)
        if not self.json["overlays"]:
            figure.subplots().set_axis_off()
            return
        overlay, channels = self.json["overlays"][0], self.json["data"]["channels"]
        axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
        for k, (axis, channel) in enumerate(zip(axes, channels)):
            axis.plot(overlay["time_s"], overlay["measured"][k], "k.", ms=3, label="measured")
            found = overlay["after"][k] != overlay["before"][k]
            name = "before" if found else "the model as it is"
            axis.plot(overlay["time_s"], overlay["before"][k], "C1--", label=name)
            if found:
                axis.plot(overlay["time_s"], overlay["after"][k], "C0", label="after")
            axis.set_ylabel(channel["name"])
        axes[0].legend()
        axes[-1].set_xlabel("time [s]")


class ExciteResult(Result):
    """The sequence: `time_s` (rows) and `inputs` (rows, nu), each in force until the next row."""

    @public
    def __init__(self, document: dict[str, Any], folder: Path, text: str, exit_code: int,
                 keep: tempfile.TemporaryDirectory[str] | None) -> None:
        super().__init__(document, folder, text, exit_code, keep)
        self.names: list[str] = document["columns"][1:]

    @property
    def separable(self) -> bool:
        """Every pair of candidates can be told apart by what this sequence records."""
        return self.exit_code == 0

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        import numpy

        return numpy.asarray(self.json["rows"], dtype=float)[:, 0]

    @property
    def inputs(self) -> npt.NDArray[np.float64]:
        import numpy

        return numpy.asarray(self.json["rows"], dtype=float)[:, 1:]

    def rows(self) -> list[dict[str, Any]]:
        return [dict(zip(self.json["columns"], row)) for row in self.json["rows"]]

    def _draw(self, figure: Figure) -> None:
        axis = figure.subplots()
        for k, name in enumerate(self.names):
            axis.step(self.time_s, self.inputs[:, k], where="post", label=name)
        axis.set_xlabel("time [s]")
        axis.legend()


class LearnResult(Result):
    """`learnt`: what was learnt earned its place; `why` says by which figures."""

    @property
    def learnt(self) -> bool:
        return self.exit_code == 0

    @property
    def why(self) -> str:
        return str(self.json["why"])

    @property
    def robot_file(self) -> Path | None:
        """The robot file with the learnt forces."""
        return self._file("_learnt.toml")

    def rows(self) -> list[dict[str, Any]]:
        return [_flat(one) for one in self.json["candidates"]]

    def _draw(self, figure: Figure) -> None:
        axis = figure.subplots()
        candidates = [c for c in self.json["candidates"] if c["ratio"] is not None]  # the others were not rolled out
        axis.bar([c["name"] for c in candidates], [c["ratio"] for c in candidates])
        axis.axhline(1.0, color="black", lw=0.8)
        axis.set_ylabel("rollout error, with over without")


def _flat(record: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Numbers, text and flags of a record, those of dictionaries in it under "outer.inner"."""
    flat: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{prefix}{key}."))
        elif not isinstance(value, list):
            flat[prefix + key] = value
    return flat


# ---- running the commands --------------------------------------------------------------------------

Kind = TypeVar("Kind", bound=Result)


def _robot_path(robot: object, function: str) -> str:
    from ._robots import find

    if isinstance(robot, _core.Robot):
        if not os.path.isfile(robot.path):
            raise make_argument_error(function, "robot", repr(robot), "a robot that was read from a file",
                                      "write the robot file, and pass its path", False)
        return str(robot.path)
    return find(robot)


def _log_paths(logs: object, function: str, argument: str = "logs") -> list[str]:
    several = [logs] if isinstance(logs, (str, os.PathLike)) else logs
    try:
        paths = [os.fspath(log) for log in several]  # type: ignore[attr-defined]
    except TypeError:
        raise make_argument_error(function, argument, f"{logs!r:.80}", "a path or a list of paths",
                                  "pass the log's file name, or a list of them", True) from None
    for path in paths:
        if not os.path.isfile(path):
            raise make_argument_error(function, argument, repr(path), "an existing file", "check the path", False)
    if not paths:
        raise make_argument_error(function, argument, "an empty list", "one log at least", "pass its path", False)
    return paths


def _options(options: Mapping[str, Option]) -> list[str]:
    """Keyword arguments as the command's options: hold_out=[...] is --hold-out ...; True is the bare option."""
    words: list[str] = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        words.append(option)
        if value is True:
            continue
        several = [value] if isinstance(value, (str, int, float, os.PathLike)) else value
        words.extend(os.fspath(v) if isinstance(v, os.PathLike) else str(v) for v in several)
    return words


def _run(kind: type[Kind], command: str, words: Sequence[str], out: PathLike | None, good: Sequence[int]) -> Kind:
    keep = tempfile.TemporaryDirectory(prefix=f"tiller-{command}-") if out is None else None
    folder = Path(keep.name if keep else os.fspath(out))  # type: ignore[arg-type]
    code, text = run([command, *words, "-o", str(folder)], good=good)
    found = folder / f"{command}.json"
    if not found.is_file():  # an exit code may also say that the arguments are wrong
        raise failed(command, code, text)
    with open(found, encoding="utf-8") as file:
        return kind(json.load(file), folder, text, code, keep)


@public
def identify(robot: _core.Robot | PathLike, logs: Logs, *, hold_out: Logs = (), out: PathLike | None = None,
             **options: Option) -> IdentifyResult:
    """Learns the parameters of a robot file from logs of the real robot; `tiller identify --help` has the options
    (particles=512, method="reps", ...). `out`: folder for JSON, page and posterior; None: a temporary one."""
    words = [_robot_path(robot, "identify"), *_log_paths(logs, "identify"), *_options(options)]
    if hold_out:
        words += ["--hold-out", *_log_paths(hold_out, "identify", "hold_out")]
    return _run(IdentifyResult, "identify", words, out, (0, 2))


@public
def gap(robot: _core.Robot | PathLike, logs: Logs, *, hold_out: Logs = (), out: PathLike | None = None,
        **options: Option) -> GapResult:
    """Finds where model and logs disagree and names the missing effect; `tiller gap --help` has the options
    (budget=1.1, only=["coulomb_friction"], threads=4, ...). Logs that cannot answer come back with exit_code 3."""
    words = [_robot_path(robot, "gap"), *_log_paths(logs, "gap"), *_options(options)]
    if hold_out:
        words += ["--hold-out", *_log_paths(hold_out, "gap", "hold_out")]
    return _run(GapResult, "gap", words, out, (0, 1, 2, 3, 5))


@public
def excite(robot: _core.Robot | PathLike, *, out: PathLike | None = None, **options: Option) -> ExciteResult:
    """Proposes the input sequence that tells candidate effects apart; `tiller excite --help` has the options
    (gap="report/gap.json" or candidates="input_delay:delay_s=0.02,...", seconds=10, keep="angle_rad=2", ...)."""
    keep = tempfile.TemporaryDirectory(prefix="tiller-excite-") if out is None else None
    file = Path(keep.name) / "excite.csv" if keep else Path(os.fspath(out))  # type: ignore[arg-type]
    code, text = run(["excite", _robot_path(robot, "excite"), *_options(options), "-o", str(file)], good=(0, 2))
    with open(file, encoding="utf-8", newline="") as opened:
        lines = [line for line in csv.reader(opened) if line and not line[0].startswith("#")]
    document = {"columns": lines[0], "rows": [[float(cell) for cell in line] for line in lines[1:]]}
    return ExciteResult(document, file.parent, text, code, keep)


@public
def learn(robot: _core.Robot | PathLike, logs: Logs, *, out: PathLike | None = None, **options: Option) -> LearnResult:
    """Learns forces that no known effect explains; `tiller learn --help` has the options (form="gaussian",
    members=5, ...). What does not earn its place comes back with exit_code 2, logs that cannot answer raise."""
    words = [_robot_path(robot, "learn"), *_log_paths(logs, "learn"), *_options(options)]
    return _run(LearnResult, "learn", words, out, (0, 2))
