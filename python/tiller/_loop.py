"""The loop around a plant."""
from __future__ import annotations

import math

from . import _core
from ._calls import public
from ._errors import make_argument_error

TYPE_CHECKING = False  # typing's own is not worth the time of its import

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ._core import Measurement, Plant


@public
def lockstep(plant: Plant, seconds: float) -> Iterator[Measurement]:
    """The plant's measurement at every tick for `seconds` of its time; Plant.step in the loop's body moves it on.

    A body that does not step the plant would see the same instant for ever: that is refused.
    """
    if not isinstance(plant, _core.Plant):
        raise make_argument_error("lockstep", "plant", f"{plant!r:.60}", "a tiller.Plant",
                                  "pass tiller.Plant(robot)", True)
    if isinstance(seconds, str) or not (seconds > 0 and math.isfinite(seconds)):
        raise make_argument_error("lockstep", "seconds", repr(seconds), "a positive number of seconds",
                                  "pass e.g. 8.0", False)
    return _ticks(plant, seconds)


def _ticks(plant: Plant, seconds: float) -> Iterator[Measurement]:
    end = plant.time_s + seconds - 1e-9
    while plant.time_s < end:
        now = plant.time_s
        yield plant.measurement
        if plant.time_s <= now:
            raise make_argument_error("lockstep", "plant", "at the same instant as before", "one step for each turn",
                                      "call plant.step(command) in the loop's body", False)
