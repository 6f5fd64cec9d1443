"""Where the package's own files are, and what the tools in the extension need to be told of them."""
from __future__ import annotations

import os
import sys

PACKAGE = os.path.dirname(os.path.abspath(__file__))
ABOVE = os.path.dirname(PACKAGE)
ROBOTS = os.path.join(PACKAGE, "robots")
INCLUDE = os.path.join(PACKAGE, "include")


def prepare() -> None:
    """Sets what the tools read from the environment, where the user has not: interpreter, robots, pages, headers."""
    os.environ.setdefault("TILLER_PYTHON", sys.executable)
    os.environ.setdefault("TILLER_ROBOTS", ROBOTS)
    os.environ.setdefault("TILLER_TOOLS", ABOVE)
    library = os.path.join(ABOVE, "lib/liblcm.so.1")  # where the Python package lcm has it
    if os.path.exists(library):
        os.environ.setdefault("TILLER_LIBLCM", library)
    if os.path.isdir(INCLUDE):
        os.environ.setdefault("TILLER_INCLUDE", os.pathsep.join((os.path.join(INCLUDE, "tiller/runtime"), INCLUDE)))
