# programs: bench_deadline
"""./dev bench deadline: random deadlines against every planner (bench_deadline.cpp), then how even their work is.

    --calls N    plans a planner (100000)
    --plans N    plans a planner under valgrind, whose instructions are counted (200)
    --build DIR  the CMake build folder (build/release)

Time on a shared machine says little of the worst case; the number of instructions of a plan does not depend on the
machine. Worst over median of plans from random states. valgrind knows nothing of AVX-512: kernels are the AVX2 ones.
"""

import argparse
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
GOAL = 1.5  # worst over median; planners that stop when they have converged fall below the median, not above it


def planners():
    text = (ROOT / "runtime/planners/planners.def").read_text(encoding="utf-8")
    return re.findall(r"^TILLER_PLANNER\((\w+)", text, re.MULTILINE)


def instructions(program, planner, plans):
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/out", str(program), "--plans", planner,
             str(plans)], env=dict(os.environ, TILLER_ISA="avx2"), capture_output=True, text=True, check=False)
        if done.returncode != 0:
            return [], done.stderr.strip().splitlines()[-1:]
        counts = []
        for dump in pathlib.Path(folder).glob("out.*"):  # one a plan; "out" itself is what came after the last
            found = re.search(r"^(?:totals|summary): (\d+)", dump.read_text(encoding="utf-8"), re.MULTILINE)
            if found:
                counts.append(int(found.group(1)))
        return counts, []


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=100000)
    parser.add_argument("--plans", type=int, default=200)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args = parser.parse_args()
    program = args.build / "tools/bench/bench_deadline"
    subprocess.run([str(program), "--calls", str(args.calls)], check=True)
    print("\ninstructions of a plan, worst over median, no deadline (callgrind)")
    if shutil.which("valgrind") is None:
        print("  not measured: no valgrind here (apt-get install valgrind)")
        return
    for planner in planners():
        counts, trouble = instructions(program, planner, args.plans)
        if not counts:
            print(f"  {planner:<18} not measured: {' '.join(trouble)}")
            continue
        median, worst = statistics.median(counts), max(counts)
        print(f"  {planner:<18} median {median / 1e3:9.1f} k   worst {worst / 1e3:9.1f} k   {worst / median:5.2f} x   "
              f"goal <= {GOAL}  {'met' if worst <= GOAL * median else 'short'}   ({len(counts)} plans)")


main()
