"""A line for each robot and log as it is done, with the time left."""

from __future__ import annotations

import sys
import time


def span(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class Progress:
    def __init__(self, total: int, kept: int, quiet: bool, stream=sys.stderr):
        self.total, self.done, self.kept, self.quiet, self.stream = total, kept, kept, quiet, stream
        self.started = time.monotonic()
        if kept:
            print(f"fleet: {kept} of {total} are fitted already", file=stream, flush=True)

    def step(self, text: str) -> None:
        self.done += 1
        if self.quiet:
            return
        spent = time.monotonic() - self.started
        left = spent / (self.done - self.kept) * (self.total - self.done)
        tail = f"about {span(left)} left" if self.done < self.total else f"{span(spent)} in all"
        print(f"[{self.done:{len(str(self.total))}d}/{self.total}] {text}; {tail}", file=self.stream, flush=True)
