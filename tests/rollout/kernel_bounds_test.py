"""kernel_bounds_test.py COST: what the kernel of a model of twelve states costs to compile, as compile_cost.py wrote it down
when it was built.

Memory: a robot's computer of 2 GB has 1 GB for a compiler. Bytes: they grow with what is unrolled, and the seconds with
them; 1,200 KB is half as much again as the kernel has now. Seconds are not judged: a machine may be busy.
"""

import json
import sys
from pathlib import Path

MOST_MEMORY_BYTES = 1 << 30
MOST_OBJECT_BYTES = 1_200_000


def main(file: str) -> int:
    cost = json.loads(Path(file).read_text(encoding="utf-8"))
    built = Path(cost["folder"]) / cost["object"]
    memory, size = cost["memory_bytes"], built.stat().st_size
    print(f"{memory / 1e6:.0f} MB of {MOST_MEMORY_BYTES / 1e6:.0f}, {size / 1e3:.0f} KB of {MOST_OBJECT_BYTES / 1e3:.0f}, "
          f"{cost['seconds']:.0f} s")
    return int(memory > MOST_MEMORY_BYTES or size > MOST_OBJECT_BYTES)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
