"""kernel_bounds_test.py LARGE.cost WIDE.cost: what kernels of many states cost to compile, as compile_cost.py wrote it
down when they were built.

Memory: a robot's computer of 2 GB has 1 GB for a compiler. Bytes: they grow with what is unrolled, and the seconds with
them; the bounds are half as much again as the kernels have. Seconds are not judged: a machine may be busy.
"""

import json
import sys
from pathlib import Path

MOST_MEMORY_BYTES = 1 << 30
MOST_OBJECT_BYTES = {"twelve states": 1_200_000, "thirty-two states": 1_900_000}


def main(*files: str) -> int:
    too_much = False
    for (name, most_bytes), file in zip(MOST_OBJECT_BYTES.items(), files, strict=True):
        cost = json.loads(Path(file).read_text(encoding="utf-8"))
        memory, size = cost["memory_bytes"], (Path(cost["folder"]) / cost["object"]).stat().st_size
        print(f"{name}: {memory / 1e6:.0f} MB of {MOST_MEMORY_BYTES / 1e6:.0f}, {size / 1e3:.0f} KB of "
              f"{most_bytes / 1e3:.0f}, {cost['seconds']:.0f} s")
        too_much |= memory > MOST_MEMORY_BYTES or size > most_bytes
    return int(too_much)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
