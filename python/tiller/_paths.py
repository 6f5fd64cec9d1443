"""Where the package's own files are, and what the tools in the extension need to be told of them."""
from __future__ import annotations

import os
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent
ROBOTS = PACKAGE / "robots"
INCLUDE = PACKAGE / "include"


def prepare() -> None:
    """Sets what the tools read from the environment, where the user has not: interpreter, robots and headers."""
    os.environ.setdefault("TILLER_PYTHON", sys.executable)
    os.environ.setdefault("TILLER_ROBOTS", str(ROBOTS))
    os.environ.setdefault("TILLER_TOOLS", str(PACKAGE.parent))
    library = PACKAGE.parent / "lib/liblcm.so.1"  # where the Python package lcm has it
    if library.exists():
        os.environ.setdefault("TILLER_LIBLCM", str(library))
    if INCLUDE.is_dir():
        os.environ.setdefault("TILLER_INCLUDE", os.pathsep.join((str(INCLUDE / "tiller/runtime"), str(INCLUDE))))
