# programs: bench_package tiller_python
"""./dev bench jax_rollout: the kernel inside JAX, beside the kernel, equations in JAX and MuJoCo's MJX.

    --rounds N     in which all take turns (11)
    --quick        without MJX, which compiles for minutes

One processor, one process, 4,096 lanes x 50 steps (MJX: 256). Values against tiller.rollout bit by bit and derivatives
against differences of it, over every robot that tiller ships; then nanoseconds of the processor for a lane and step,
the fastest of the rounds, and their ratios. The derivative is of the sum of squares of all states by start, inputs and
parameters.
"""
import argparse
import json
import os
import subprocess
import sys

from _driver import CORE, ONE_THREAD, PEERS, ROOT, need_environment, note, python_of, summary

PROGRAM, PACKAGE = ROOT / "build/release/bench/bench_package", ROOT / "build/release/python_package"
# of a matrix's largest entry: fourth-order differences in double leave some 1e-9
MOST_ERROR = 1e-6
# what a call may cost beside the kernel's own time
MOST_RATIO = 1.2


def row(rows, heading, what, figure, unit="", goal=None):
    met = None if goal is None else figure <= goal
    text = "" if goal is None else f"goal <= {goal:<6g} {'met' if met else 'short'}"
    print(f"  {what:<76} {figure:10.4g} {unit:<4} {text}", flush=True)
    if goal is not None:
        rows.append({"section": "jax_rollout", "heading": heading, "row": what, "figure": figure, "unit": unit,
                     "goal": f"<= {goal:g}", "met": met})


def run(rounds, quick):
    def pinned():
        os.sched_setaffinity(0, {CORE})
    environment = dict(os.environ, **ONE_THREAD, PYTHONPATH=str(PACKAGE), JAX_PLATFORMS="cpu")
    command = [python_of("jax"), PEERS / "jax_peer.py", PROGRAM, str(rounds), "1" if quick else "0"]
    with subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE, text=True, env=environment,
                          preexec_fn=pinned) as process:
        found = [json.loads(line) for line in process.stdout if line.startswith("{")]
    return found, process.returncode


def show_exactness(rows, found):
    heading = "exactness"
    print(heading)
    for f in (f for f in found if f["part"] == "bits"):
        what = f"{f['name']} values with other bits than tiller.rollout, of {f['compared']}"
        row(rows, heading, what, f["figure"], "", 0)
    gradients = [f for f in found if f["part"] == "gradients"]
    for f in gradients:
        row(rows, heading, f"{f['robot']}: derivatives against differences", f["figure"], "", MOST_ERROR)
    for f in (f for f in found if f["part"] == "apart"):
        other = f["name"] if f["name"] == "MJX" else f"equations in JAX, {f['name']}"
        row(rows, heading, f"{f['robot']}: states of 50 steps apart from those of {other}", f["figure"])


def show_speed(rows, found):
    for robot, kind in dict.fromkeys((f["robot"], f["type"]) for f in found if f["part"] == "speed"):
        heading = f"{robot}, {kind}"
        print(heading)
        times = {f["name"]: f for f in found if f["part"] == "speed" and (f["robot"], f["type"]) == (robot, kind)}
        for name, f in times.items():
            row(rows, heading, f"{name} (median {f['median']:.4g})", f["figure"], "ns")

        def ratio(over, under, goal=None):
            if over in times and under in times:
                row(rows, heading, f"{over} over {under}", times[over]["figure"] / times[under]["figure"], "", goal)
        ratio("tiller.jax", "kernel", MOST_RATIO)
        ratio("tiller.jax", "tiller.rollout", MOST_RATIO)
        ratio("equations in JAX", "tiller.jax")
        ratio("equations in JAX, gradient", "tiller.jax gradient")
        ratio("tiller.jax gradient", "tiller.jax")
        ratio("MJX", "tiller.jax")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    if not need_environment("jax"):
        return 1
    found, code = run(options.rounds, options.quick)
    rows = []
    show_exactness(rows, found)
    show_speed(rows, found)
    summary(rows)
    if code:
        note(f"the peer ended with {code}")
    return code


if __name__ == "__main__":
    sys.exit(main())
