"""Numbers that are read beside each other: as many digits as their difference needs."""

from __future__ import annotations

import math


def digits_that_show(width, largest, least: int = 4) -> int:
    """Significant digits of numbers as large as `largest` at which a difference of `width` shows with two of its own:
    with fewer an interval collapses to "1.2 .. 1.2". As digits_that_show in tools/base/interval_text.cpp."""
    if width is None or largest is None or not (math.isfinite(width) and math.isfinite(largest)) or 0 in (width, largest):
        return least
    needed = math.floor(math.log10(abs(largest))) - math.floor(math.log10(abs(width))) + 2
    return min(max(needed, least), 15)


def plain_interval(low: float, high: float, least: int = 4) -> str:
    """Both ends with the digits that the width needs, for terminals."""
    digits = digits_that_show(high - low, max(abs(low), abs(high)), least)
    return f"{low:.{digits}g} .. {high:.{digits}g}"
