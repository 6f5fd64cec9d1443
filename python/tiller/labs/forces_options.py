"""What learning can be asked for, and what it is by default; without JAX."""
from __future__ import annotations

from dataclasses import dataclass, field

FORMS = ("auto", "effects", "network", "gaussian")
MOST_MEMBERS, MOST_WIDTH = 16, 64  # TILLER_MAX_NETWORK_MEMBERS, TILLER_MAX_NETWORK_WIDTH


@dataclass
class Options:
    form: str = "auto"
    members: int = 5
    hidden: list[int] = field(default_factory=lambda: [16, 16])
    inducing: int = 48
    hold_out: float = 0.25
    most_ratio: float = 0.9
    seed: int = 1
    catalogue: bool = True  # effects of the catalogue first
    beat_residual: bool = False  # refuse what nine weights at one joint do as well
    threads: int = 1
    passes: int = 3  # of smoothing beside what was learnt, and learning again
    steps: int = 3000  # of Adam
    batch: int = 256
    draws: int = 8  # members of the Gaussian process
