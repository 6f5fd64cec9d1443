"""From what a caller has to a robot file: names of robots that come along, descriptions, model headers."""
from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from ._calls import public
from ._errors import make_argument_error
from ._paths import ROBOTS


@public
def robot_names() -> list[str]:
    """Names of the robot files that come with the package, for Robot.from_toml."""
    return sorted(file[:-5] for file in os.listdir(ROBOTS) if file.endswith(".toml"))


names = robot_names


def find(path: object) -> str:
    """The file that `path` names: a file of the caller's, or a robot that comes with the package."""
    try:
        text = os.fspath(path)  # type: ignore[call-overload]
    except TypeError:
        raise make_argument_error("Robot.from_toml", "path", repr(path), "a path or a name", "pass a str or a Path",
                                  True) from None
    own = os.path.join(ROBOTS, f"{text}.toml")
    if not os.path.exists(text) and "/" not in text and os.path.isfile(own):
        return own
    if not os.path.exists(text) and not text.endswith(".toml") and "/" not in text:
        raise make_argument_error("Robot.from_toml", "path", repr(text), "a robot file or one of " + ", ".join(names()),
                                  "pass the path of a .toml file, or a name of the list", False)
    return str(text)


def import_description(description: str, folder: object, options: Sequence[str]) -> str:
    """Runs `tiller import`; the robot file that it wrote. Without a folder one below the user's cache."""
    import tempfile
    from pathlib import Path

    from ._command import run

    if folder is None:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tiller"
        cache.mkdir(parents=True, exist_ok=True)
        folder = tempfile.mkdtemp(prefix="import-", dir=cache)
    run(["import", description, "-o", os.fspath(folder), "--force", *options])  # type: ignore[call-overload]
    return str(Path(os.fspath(folder)) / "robot.toml")  # type: ignore[call-overload]


def with_model_header(header: object, type_name: str, settings: object) -> tuple[str, str]:
    """(text, path) of a robot file with this header as its model; settings: the other sections, or their file."""
    from pathlib import Path

    from . import _toml

    path = Path(os.fspath(header)).resolve()  # type: ignore[call-overload]
    if not path.is_file():
        raise make_argument_error("Robot.from_model_header", "header", repr(str(header)), "an existing C++ header",
                                  "pass the path of a file with the model's struct; docs/guide/own_model.md", False)
    document = _sections(settings)
    model = document.get("model", {})
    document["model"] = {k: v for k, v in dict(model).items() if k != "name"}
    document["model"].update(file=path.name, type=type_name)
    document.setdefault("robot", {"name": path.stem})
    return _toml.dumps(document), str(path.parent / "robot.toml")


def _sections(settings: object) -> dict[str, dict[str, object]]:
    if isinstance(settings, Mapping):
        return {str(k): v for k, v in settings.items()}
    import tomllib

    try:
        with open(os.fspath(settings), "rb") as file:  # type: ignore[call-overload]
            return dict(tomllib.load(file))
    except (OSError, tomllib.TOMLDecodeError) as problem:
        raise make_argument_error("Robot.from_model_header", "settings", repr(settings), "a robot file",
                                  f"pass a file that can be read ({problem})", False) from problem
    except TypeError:
        raise make_argument_error("Robot.from_model_header", "settings", repr(settings), "a dictionary or a path",
                                  "pass the sections of a robot file, or the file that has them", True) from None
