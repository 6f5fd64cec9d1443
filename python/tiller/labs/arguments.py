"""Types of command-line arguments."""
from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def number_between(kind: type[int] | type[float], least: float, most: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        value = kind(text)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text} is not in {least} .. {most}")
        return value
    return number


def can_write(path: Path) -> str:
    """Why the file cannot be written; "": it can. Makes its folder."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        there = path.exists()
        with open(path, "ab"):
            pass
        if not there:
            path.unlink()
    except OSError as problem:
        return f"{path}: {problem.strerror}"
    return ""
