"""What the laboratories import beside numpy, and a folder of their own for it where the interpreter lacks it."""
from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from .._errors import missing_extra
from .._paths import ABOVE

# module -> what pip installs; the extra `labs` of pyproject.toml is the same list (a test holds them together)
REQUIRES = {"jax": "jax>=0.7", "equinox": "equinox>=0.13", "optax": "optax>=0.2.3", "scipy": "scipy>=1.11",
            "cma": "cma>=4.0", "tomlkit": "tomlkit>=0.13"}
SIZE_MB = 550  # on disk, of jax 0.7 with what it brings
ASK = "TILLER_LABS_INSTALL"  # 0 in the environment: never install


def missing() -> list[str]:
    return [module for module in REQUIRES if find_spec(module) is None]


def check() -> None:
    """Raises MissingExtra for the first module that is not there."""
    for module in missing():
        raise missing_extra(module, "labs", "tiller.labs")


def folder() -> Path:
    """Of this Python's own environment for the laboratories: a virtual environment that only they use."""
    home = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share")
    return home / "tiller" / f"labs-{sys.version_info.major}.{sys.version_info.minor}"


def _is_complete(place: Path) -> bool:
    try:
        return (place / "complete").read_text(encoding="utf-8").split() == list(REQUIRES.values())
    except OSError:
        return False


def is_ready() -> bool:
    """Whether provide() has nothing to install."""
    return not missing() or _is_complete(folder())


def _install(place: Path) -> None:
    """Raises OSError or CalledProcessError; what is half done is done again by the next call."""
    print(f"the laboratories need {', '.join(REQUIRES)} ({SIZE_MB} MB). Installing them, once, into {place}; "
          f"{ASK}=0 prevents it.\nWheels in a folder serve without a network: PIP_NO_INDEX=1 PIP_FIND_LINKS=FOLDER",
          file=sys.stderr, flush=True)
    place.mkdir(parents=True, exist_ok=True)
    subprocess.run([sys.executable, "-m", "venv", "--clear", str(place)], check=True)
    subprocess.run([str(place / "bin/python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                    *REQUIRES.values()], check=True, stdout=sys.stderr)
    (place / "complete").write_text("\n".join(REQUIRES.values()) + "\n", encoding="utf-8")


def provide(arguments: list[str]) -> None:
    """Returns where this interpreter has all that is needed. Else this process becomes `python -m tiller.labs
    ARGUMENTS` of the laboratories' own environment, which is made where it is missing. Raises MissingExtra where that
    is not wanted or does not work."""
    if not missing():
        return
    place = folder()
    if Path(sys.prefix) == place or os.environ.get(ASK) == "0":
        check()
    if not _is_complete(place):
        try:
            _install(place)
        except (OSError, subprocess.CalledProcessError) as problem:
            print(f"{place}: {problem}", file=sys.stderr)
            check()
    python = str(place / "bin/python")
    paths = os.pathsep.join(filter(None, (ABOVE, os.environ.get("PYTHONPATH"))))
    os.execve(python, [python, "-m", "tiller.labs", *arguments],
              dict(os.environ, PYTHONPATH=paths, TILLER_PYTHON=python))
