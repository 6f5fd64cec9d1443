# programs: bench_deadline
"""./dev bench deadline: random deadlines against every planner (bench_deadline.cpp), then how even their work is.

    --calls N    plans a planner (100000)
    --plans N    plans a planner under valgrind, whose instructions are counted (200)
    --build DIR  the CMake build folder (build/release)

Time on a shared machine says little of the worst case; the number of instructions of a plan does not depend on the
machine. Worst over median of plans from random states. valgrind knows nothing of AVX-512: kernels are the AVX2 ones.
"""

import argparse
import pathlib
import re
import statistics
import subprocess

from _driver import ROOT, instructions

GOAL = 1.5  # worst over median; planners that stop when they have converged fall below the median, not above it


def planners():
    text = (ROOT / "runtime/include/tiller/planners.def").read_text(encoding="utf-8")
    return re.findall(r"^TILLER_PLANNER\((\w+)", text, re.MULTILINE)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=100000)
    parser.add_argument("--plans", type=int, default=200)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args = parser.parse_args()
    program = args.build / "bench/bench_deadline"
    subprocess.run([str(program), "--calls", str(args.calls)], check=True)
    print("\ninstructions of a plan, worst over median, no deadline (callgrind)")
    for planner in planners():
        counts, trouble = instructions([program, "--plans", planner, args.plans])
        if not counts:
            print(f"  {planner:<18} not measured: {trouble}")
            continue
        median, worst = statistics.median(counts), max(counts)
        print(f"  {planner:<18} median {median / 1e3:9.1f} k   worst {worst / 1e3:9.1f} k   {worst / median:5.2f} x   "
              f"goal <= {GOAL}  {'met' if worst <= GOAL * median else 'short'}   ({len(counts)} plans)")


main()
