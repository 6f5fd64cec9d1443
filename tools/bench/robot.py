# programs: bench_robot
"""./dev bench robot: what a robot may rely on. Every row has its figure, its goal, and met or short.

    ./dev bench robot                    all sections (about an hour)
    ./dev bench robot faults gate        some of them
    ./dev bench robot --quick            a fixed small part of each (minutes)

Sections:
    faults     every kind of fault from 20 seeds on two plants; --page writes the table of docs/faults.md
    gate       1e8 random and adversarial commands into the output gate
    mutants    one-line mistakes in gate, state machine and sensor guard: do the tests notice?
    loss       the pendulum over an emulated bus that loses and delays frames
    soak       24 hours at 100 Hz in lockstep, twice
    integrity  own frames: flips, losses, repetitions, order; keyed messages
    heap       no call to the heap after init
    buses      the tests over virtual CAN and LCM: processes killed and stopped, interfaces down, queues full
    recorder   logs that survive crashes, and the same commands from them
    fuzz       libFuzzer with ASan and UBSan on whatever reads bytes
    targets    aarch64, armhf, Cortex-M7: tests under emulators, and the same commands bit by bit

    --quick        smaller numbers; goals of size are short then
    --page         write docs/faults.md's table from this run
    --build DIR    the CMake build folder (build/release)

A section is a function here that returns rows; a row is printed by a program (bench_table.hpp's form), or says how many
tests of a kind passed. A short row is no error; a program that fails is.
"""

import argparse
import pathlib
import re
import subprocess
import sys

from _driver import ROOT, note, run_table, summary

SECTIONS = {}


def section(title):
    def add(function):
        SECTIONS[function.__name__] = (title, function)
        return function
    return add


# ---- rows ------------------------------------------------------------------------------------------


def row(name, heading, what, figure, unit, relation, bound):
    """One row, printed as the programs print theirs."""
    met = figure >= bound if relation == ">=" else figure <= bound
    goal = f"goal {relation} {bound:.4g}"
    print(f"  {what:<58} {figure:10.4g} {unit:<8} {goal:<16} {'met' if met else 'short'}", flush=True)
    return {"section": name, "heading": heading, "row": what, "figure": figure, "unit": unit,
            "goal": f"{relation} {bound:.4g}", "met": met}


def tests(args, name, heading, what, pattern):
    """A row: the share of the tests whose name matches that pass, of those that this build has."""
    out = subprocess.run(["ctest", "--test-dir", args.build, "-R", pattern, "--output-on-failure"],
                         capture_output=True, text=True, check=False).stdout
    print("".join(f"    {line}\n" for line in out.splitlines() if re.search(r"Test +#\d+", line)), end="")
    counted = re.search(r"(\d+) tests failed out of (\d+)", out)
    total = int(counted[2]) if counted else 0
    if total == 0:
        print(f"  not measured: this build has no test like {pattern}")
        return []
    return [row(name, heading, f"{what}: {total} tests", 100.0 * (total - int(counted[1])) / total, "%", ">=", 100.0)]


def command(name, heading, what, argv, pattern=None, bound=1.0, unit=""):
    """A row from a command that says by its exit code that it went well: 1, or the number that `pattern` finds."""
    note(" ".join(map(str, argv)))
    with subprocess.Popen([str(a) for a in argv], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True) as process:
        lines = []
        for line in process.stdout:
            print(f"    {line}", end="", flush=True)
            lines.append(line)
    good = process.returncode == 0
    found = re.findall(pattern, "".join(lines)) if pattern else []
    figure = float(min(map(float, found))) if found else float(good and pattern is None)
    return [row(name, heading, what, figure if good else 0.0, unit, ">=", bound)]


def program(args, name, *arguments):
    rows, ended = run_table(name, args.build / "tools/bench/bench_robot", [name, *map(str, arguments)])
    args.failed += not ended
    return rows


# ---- sections --------------------------------------------------------------------------------------


@section("fault matrix")
def faults(args):
    page = ["--page", ROOT / "docs/faults.md"] if args.page else []
    return program(args, "faults", "--seeds", 2 if args.quick else 20, *page)


@section("output gate")
def gate(args):
    return program(args, "gate", "--commands", 1000000 if args.quick else 100000000)


@section("mutants")
def mutants(args):
    rows, _ = run_table("mutants", pathlib.Path(sys.executable),
                        [str(ROOT / "tools/bench/mutants.py"), "--every", "8" if args.quick else "1"])
    return rows


@section("loss")
def loss(args):
    return program(args, "loss", "--seeds", 2 if args.quick else 20)


@section("soak")
def soak(args):
    return program(args, "soak", "--ticks", 100000 if args.quick else 8640000)


@section("integrity of own frames and messages")
def integrity(args):
    return (tests(args, "integrity", "own frames", "flips, losses, repetitions, order", "^(core|io)_test$") +
            tests(args, "integrity", "LCM messages", "codec, key, replays, other people's programs", "^lcm_"))


@section("heap")
def heap(args):
    return tests(args, "heap", "runtime and io", "no call after init", "heap")


@section("buses and processes")
def buses(args):
    return (tests(args, "buses", "virtual CAN", "error frames, queues, interfaces, drives", "^vcan_|^can_") +
            tests(args, "buses", "processes", "killed, stopped and gone on", "^loop_(lcm|can)"))


@section("recorder and replay")
def recorder(args):
    return tests(args, "recorder", "logs", "cut at every byte, disk full, replayed", "recorder|replay|over_lcm")


@section("fuzzers")
def fuzz(args):
    return command("fuzz", "libFuzzer, ASan, UBSan", "executions of the slowest fuzzer, none with a finding",
                   [ROOT / "dev", "fuzz", "5" if args.quick else "900"], r"fuzz_\w+: (\d+) executions", 1e7)


@section("other targets")
def targets(args):
    return command("targets", "emulated", "build, tests and the same bits",
                   [ROOT / "dev", "cross", *(["small"] if args.quick else [])])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--page", action="store_true")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args = parser.parse_args()
    if unknown := [s for s in args.sections if s not in SECTIONS]:
        parser.error(f"unknown section {unknown[0]}; there are {', '.join(SECTIONS)}")
    args.build = args.build.resolve()
    args.failed = 0
    rows = []
    for name in args.sections or SECTIONS:
        title, function = SECTIONS[name]
        print(f"\n==== {title}", flush=True)
        rows += function(args)
    summary(rows)
    return 1 if args.failed else 0


if __name__ == "__main__":
    sys.exit(main())
