"""kernel_bounds_test.py COMPILER SOURCE WORK_FOLDER FLAGS...: what the kernel of a model of twelve states costs to compile.

Memory: a robot's computer of 2 GB has 1 GB for a compiler. Bytes: they grow with what is unrolled, and the seconds with
them; 1,200 KB is half as much again as the kernel has now. Seconds are not judged: a machine may be busy.
"""

import resource
import subprocess
import sys
from pathlib import Path

MOST_MEMORY_BYTES = 1 << 30
MOST_OBJECT_BYTES = 1_200_000


def main(compiler: str, source: str, folder: str, *flags: str) -> int:
    built = Path(folder) / "kernel_bounds.o"
    subprocess.run([compiler, *flags, "-c", source, "-o", str(built)], check=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    memory, size = used.ru_maxrss * 1024, built.stat().st_size
    built.unlink()
    print(f"{memory / 1e6:.0f} MB of {MOST_MEMORY_BYTES / 1e6:.0f}, {size / 1e3:.0f} KB of {MOST_OBJECT_BYTES / 1e3:.0f}, "
          f"{used.ru_utime:.0f} s")
    return int(memory > MOST_MEMORY_BYTES or size > MOST_OBJECT_BYTES)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
