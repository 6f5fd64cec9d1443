"""Types of command-line arguments."""
from __future__ import annotations

import argparse
from collections.abc import Callable


def number_between(kind: type[int] | type[float], least: float, most: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        value = kind(text)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text} is not in {least} .. {most}")
        return value
    return number
