"""kernel_bounds_test.py LARGE.o WIDE.o FOLDER COMPILER SOURCE FLAGS...: what kernels of many states cost to compile.

Memory, of the model of thirty-two states (SOURCE): a robot's computer of 2 GB has 1 GB for a compiler. Bytes, of the
objects that the build has made of twelve and of thirty-two: they grow with what is unrolled, and the seconds with them;
the bounds are half as much again as the kernels have. Seconds are not judged: a machine may be busy.
"""

import resource
import subprocess
import sys
from pathlib import Path

MOST_MEMORY_BYTES = 1 << 30
MOST_OBJECT_BYTES = {"twelve states": 1_200_000, "thirty-two states": 1_900_000}


def main(large: str, wide: str, folder: str, compiler: str, source: str, *flags: str) -> int:
    built = Path(folder) / "kernel_bounds.o"
    subprocess.run([compiler, *flags, "-c", source, "-o", str(built)], check=True)
    built.unlink()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    memory = used.ru_maxrss * 1024
    print(f"thirty-two states: {memory / 1e6:.0f} MB of {MOST_MEMORY_BYTES / 1e6:.0f}, {used.ru_utime:.0f} s")
    too_much = memory > MOST_MEMORY_BYTES
    for (name, most), path in zip(MOST_OBJECT_BYTES.items(), (large, wide)):
        size = Path(path).stat().st_size
        print(f"{name}: {size / 1e3:.0f} KB of {most / 1e3:.0f}")
        too_much |= size > most
    return int(too_much)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
