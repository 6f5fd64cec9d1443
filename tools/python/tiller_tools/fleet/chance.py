"""Tail probabilities, without a library for them."""

from __future__ import annotations

import math

import numpy as np


def normal_tail(z: float) -> float:
    """P(|N(0, 1)| > |z|)."""
    return math.erfc(abs(z) / math.sqrt(2))


def chi_square_tail(x, degrees: int) -> np.ndarray:
    """P(chi-square of `degrees` > x), by the recurrence Q(k + 2) = Q(k) + (x/2)^(k/2) e^(-x/2) / Gamma(k/2 + 1)."""
    x = np.maximum(np.asarray(x, dtype=float), 0.0)
    if degrees % 2:
        tail, k = np.vectorize(lambda v: math.erfc(math.sqrt(v / 2)), otypes=[float])(x), 1
    else:
        tail, k = np.exp(-x / 2), 2
    while k < degrees:
        with np.errstate(divide="ignore"):
            tail = tail + np.exp(0.5 * k * np.log(x / 2) - x / 2 - math.lgamma(0.5 * k + 1))
        k += 2
    return np.minimum(tail, 1.0)
