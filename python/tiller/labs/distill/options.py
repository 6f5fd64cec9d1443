"""What `tiller distill` can be asked for; nothing here imports JAX."""
from __future__ import annotations

import os
from dataclasses import dataclass, field


@dataclass
class Options:
    teacher: str = ""  # planner's name; "": the robot file's
    as_it_is: bool = False  # the teacher with the file's own rollouts and iterations, and not in closed loop
    hidden: list[int] = field(default_factory=lambda: [32, 32])
    reads: int = 0  # tiller_policy_input_t, added up; 0: default_reads()
    iterations: int = 6  # rounds: the first under the teacher, the others more and more under the policy
    episodes: int = 40  # of a round
    seconds: float = 5.0  # robot time of each
    validation: int = 16  # undisturbed episodes after each round, which choose the round that is kept
    test: int = 12  # whole controllers on held-out draws in the end
    seed: int = 1
    threads: int = len(os.sched_getaffinity(0))  # episodes side by side; the results are the same bits
    power: float = 0.0  # of the cost to go, by which a sample counts in the fit
