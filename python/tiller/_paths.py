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
    if INCLUDE.is_dir():
        os.environ.setdefault("TILLER_INCLUDE", os.pathsep.join((str(INCLUDE / "tiller/runtime"), str(INCLUDE))))
