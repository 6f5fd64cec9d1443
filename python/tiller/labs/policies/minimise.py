"""SciPy's L-BFGS-B with the stopping rule of a search that has to end."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

Numbers = npt.NDArray[np.float64]
FIRST_STEP = 0.1  # length of the first trial step; the library's own is 1


def minimise(value_and_slope: Callable[[Numbers], tuple[float, Numbers]], x: Numbers, evaluations: int,
             decrease: float, least_slope: float = 1e-6) -> tuple[Numbers, float]:
    """The best point seen and its value. Ends after so many evaluations, or where five steps together gain less than
    this share. A value that is not finite counts as twice the first's size and flat: the line search comes back."""
    best, least, past = x, np.inf, [np.inf]

    def scaled(y: Numbers) -> tuple[float, Numbers]:
        nonlocal best, least
        value, slope = value_and_slope(y * FIRST_STEP)
        if not np.isfinite(value) or not np.isfinite(slope).all():
            return 2 * abs(past[0] if np.isfinite(past[0]) else 1e6) + 1, np.zeros_like(y)
        if value < least:
            best, least = y * FIRST_STEP, float(value)
        if not np.isfinite(past[0]):
            past[0] = float(value)
        return float(value), np.asarray(slope) * FIRST_STEP

    def after(_: Numbers) -> None:
        past.append(least)
        if len(past) > 6 and past[-6] - least < decrease * abs(least):
            raise StopIteration

    minimize(scaled, x / FIRST_STEP, jac=True, method="L-BFGS-B", callback=after,
             options={"maxfun": evaluations, "maxiter": evaluations, "maxcor": 20, "ftol": 0,
                      "gtol": least_slope * FIRST_STEP})
    return best, least
