# programs: bench_robot
"""./dev bench robot: what a robot may rely on. Every row has its figure, its goal, and met or short.

    ./dev bench robot                    all sections (about three hours)
    ./dev bench robot faults gate        some of them
    ./dev bench robot --quick            a fixed small part of each (minutes)

Sections:
    faults     every kind of fault from 20 seeds on two plants; --page writes the table of docs/evidence/faults.md
    gate       1e8 random and adversarial commands into the output gate
    mutants    mistakes in gate, state machine and sensor guard: do the tests notice? (of others: ./dev bench mutants)
    loss       the pendulum over an emulated bus that loses and delays frames
    soak       24 hours at 100 Hz in lockstep, twice
    events     the same while something happens every few seconds
    integrity  own frames: flips, losses, repetitions, order; keyed messages
    heap       no call to the heap after init
    buses      faults on real sockets from 20 seeds on two plants: queues, interfaces, gateway, processes; the tests over
               virtual CAN and LCM; --page writes the second table of docs/evidence/faults.md
    recorder   logs that survive crashes, and the same commands from them
    fuzz       libFuzzer with ASan and UBSan on whatever reads bytes
    targets    aarch64, armhf, Cortex-M7: tests under emulators, and the same commands bit by bit

    --quick        smaller numbers; goals of size are short then
    --page         write docs/evidence/faults.md's tables from this run
    --build DIR    the CMake build folder (build/release)

A section is a function here that returns rows; a row is printed by a program (bench_table.hpp's form), or says how many
tests of a kind passed. A short row is no error; a section that cannot be measured is, and the others are run all the
same.
"""

import argparse
import math
import os
import pathlib
import re
import subprocess
import sys

from _driver import ROOT, note, run_table, summary

SECTIONS = {}
RELEASE = ROOT / "build/release"
FAULTS = ROOT / "docs/evidence/faults.md"


class NotMeasured(Exception):
    """A section's figures cannot be had; the text says why."""


def section(title):
    def add(function):
        SECTIONS[function.__name__] = (title, function)
        return function
    return add


# ---- rows ------------------------------------------------------------------------------------------


def row(name, heading, what, figure, unit, relation, bound):
    """One row, printed as the programs print theirs. A figure that is not known (NaN) is short."""
    met = figure >= bound if relation == ">=" else figure <= bound
    goal = f"goal {relation} {bound:.4g}"
    print(f"  {what:<58} {figure:10.4g} {unit:<8} {goal:<16} {'met' if met else 'short'}", flush=True)
    return {"section": name, "heading": heading, "row": what, "figure": figure, "unit": unit,
            "goal": f"{relation} {bound:.4g}", "met": met}


def streamed(argv, shown=r""):
    """(exit code, what it printed); lines in which `shown` is found appear as they come."""
    lines = []
    with subprocess.Popen([str(a) for a in argv], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, errors="replace") as process:
        for line in process.stdout:
            if re.search(shown, line):
                print(f"    {line}", end="", flush=True)
            lines.append(line)
    return process.returncode, "".join(lines)


def smallest(pattern, text):
    """The smallest number that the pattern's group finds, or NaN."""
    return min((float(n) for n in re.findall(pattern, text, re.MULTILINE)), default=math.nan)


# ---- tests as rows ---------------------------------------------------------------------------------


def need_tests(args):
    """Builds every test, once."""
    if args.tests_built:
        return
    steps = [[ROOT / "dev", "setup"], [ROOT / "dev", "build", "release"]] if args.build == RELEASE else [
        ["cmake", "--build", args.build]]
    for argv in steps:
        code, said = streamed(argv, "^dev:")
        if code != 0:
            raise NotMeasured(f"{' '.join(map(str, argv))} failed:\n{said[-2000:]}")
    args.tests_built = True


def tests(args, name, heading, what, pattern):
    """A row: the share of the tests whose name matches that pass. A build without such a test is short."""
    need_tests(args)
    argv = ["ctest", "--test-dir", args.build, "-R", pattern, "-j", os.environ.get("TILLER_JOBS", os.cpu_count()),
            "--timeout", 1800, "--output-on-failure", *(["-LE", "^slow$"] if args.quick else [])]
    code, said = streamed(argv, r"Test +#\d+: ")
    counted = re.search(r"(\d+) tests failed out of (\d+)", said)
    total = int(counted[2]) if counted else 0
    if total == 0:
        print(f"  this build has no test like {pattern}")
        return [row(name, heading, f"{what}: tests", 0, "", ">=", 1)]
    if code != 0:
        log = args.build / f"robot_{name}.log"
        log.write_text(said, encoding="utf-8")
        print(f"  what the failing ones say is in {log}")
    return [row(name, heading, f"{what}: {total} tests", 100.0 * (total - int(counted[1])) / total, "%", ">=", 100.0)]


def program(args, name, *arguments):
    rows, ended = run_table(name, args.build / "bench/bench_robot", [name, *map(str, arguments)])
    if not ended or not rows:
        args.failed.append(name)
    return rows


# ---- sections --------------------------------------------------------------------------------------


@section("fault matrix")
def faults(args):
    page = ["--page", FAULTS] if args.page else []
    rows = program(args, "faults", "--seeds", 2 if args.quick else 20, *page)
    if args.page:
        FAULTS.write_text(join_rows(FAULTS.read_text(encoding="utf-8")), encoding="utf-8")
    return rows


@section("output gate")
def gate(args):
    return program(args, "gate", "--commands", 1000000 if args.quick else 100000000)


@section("mutants")
def mutants(args):
    rows, _ = run_table("mutants", pathlib.Path(sys.executable),
                        [str(ROOT / "bench/drivers/mutants.py"), "--folder", "safety", "--count", "40" if args.quick else "0",
                         "--build", str(args.build)])
    if not rows:
        raise NotMeasured("bench/drivers/mutants.py did not come to its end")
    return rows


@section("loss")
def loss(args):
    return program(args, "loss", "--seeds", 2 if args.quick else 20)


@section("soak")
def soak(args):
    return program(args, "soak", "--ticks", 100000 if args.quick else 8640000)


@section("events")
def events(args):
    return program(args, "events", "--ticks", 16000 if args.quick else 8640000)


@section("integrity of own frames and messages")
def integrity(args):
    return (program(args, "integrity", "--trials", 100000 if args.quick else 1000000) +
            tests(args, "integrity", "own frames", "flips, losses, repetitions, order", "^(core|io)_test$") +
            tests(args, "integrity", "LCM messages", "codec, key, replays, other people's programs", "^lcm_"))


@section("heap")
def heap(args):
    return tests(args, "heap", "runtime and io", "no call after init", "heap")


def faults_on_sockets(args):
    """The kinds that need a kernel's sockets, queues and interfaces, in the guest of tests/vcan."""
    need_tests(args)
    kernel = re.search(r"^TILLER_KERNEL:PATH=(.*)$", (args.build / "CMakeCache.txt").read_text(), re.MULTILINE)[1]
    code, said = streamed([ROOT / "tests/vcan/bus_faults.sh", kernel, args.build / "tests/vcan/bus_fault_test", "--page",
                           "--seeds", 1 if args.quick else 20], r" runs |judges|failed|virtual CAN: ")
    counted = re.search(r"^(\d+) kinds, (\d+) runs, (\d+) wrong", said, re.MULTILINE)
    if not counted:
        raise NotMeasured(f"bus_faults.sh ended with {code}:\n{said[-2000:]}")
    kinds, runs, wrong = map(int, counted.groups())
    if args.page:
        write_between_marks(FAULTS, "buses", join_rows("".join(
            f"{line}\n" for line in ["| group | fault | over | what tiller does | stopped after, worst | allowed |",
                                     "|---|---|---|---|---|---|", *re.findall(r"^PAGE (.*)$", said, re.MULTILINE)])))
    heading = f"faults on real sockets, virtual CAN, {kinds} kinds"
    return [row("buses", heading, f"safe in time, limits held, nothing stale sent: {runs} runs",
                100.0 * (runs - wrong) / runs, "%", ">=", 100.0)]


def join_rows(text):
    """Rows of a table of faults that differ in the drive alone, or are refused configurations, are one row."""
    lines, places = [], {}
    for line in text.splitlines(keepends=True):
        found = (re.match(r"(\| drives \| )([^:|]+)(: .*)", line, re.DOTALL) or
                 re.match(r"(\| configuration \| )(.*?)( \| - \| refused .*)", line, re.DOTALL))
        if found and found[3] in places:
            place, names = places[found[3]]
            names.append(found[2])
            lines[place] = found[1] + "; ".join(names) + found[3]
            continue
        if found:
            places[found[3]] = (len(lines), [found[2]])
        lines.append(line)
    return "".join(lines)


def write_between_marks(path, name, text):
    begin, end = f"<!-- made by ./dev bench robot {name} -->\n", "<!-- end -->\n"
    page = path.read_text(encoding="utf-8")
    head, rest = page.split(begin)
    path.write_text(head + begin + text + end + rest.split(end, 1)[1], encoding="utf-8")


@section("buses and processes")
def buses(args):
    return (faults_on_sockets(args) +
            tests(args, "buses", "virtual CAN", "error frames, queues, interfaces, drives", "^vcan_|^can_") +
            tests(args, "buses", "processes", "killed, stopped and gone on", "^loop_(lcm|can)"))


@section("recorder and replay")
def recorder(args):
    return tests(args, "recorder", "logs", "cut at every byte, disk full, replayed", "recorder|replay")


def fuzz_rows(code, said):
    """Rows from what `./dev fuzz` printed and how it ended."""
    heading = "libFuzzer, ASan, UBSan"
    runs = re.findall(r"fuzz_(\w+): (\d+) executions, no finding", said)
    findings = re.search(r"findings in: *(.*?);", said)
    if code != 0 and findings is None or not runs and findings is None:
        raise NotMeasured("./dev fuzz failed:\n" + said[-2000:])
    return [*(row("fuzz", heading, f"executions: {name}", float(count), "", ">=", 1e7) for name, count in runs),
            row("fuzz", heading, "fuzzers with a finding", len(findings[1].split()) if findings else 0, "", "<=", 0)]


@section("fuzzers")
def fuzz(args):
    return fuzz_rows(*streamed([ROOT / "dev", "fuzz", 5 if args.quick else 900], "^dev:|ERROR|SUMMARY"))


def target_rows(code, said, presets, builds):
    """Rows from what `./dev cross` printed: so many presets tested, so many builds compared."""
    if code != 0:
        raise NotMeasured("./dev cross failed:\n" + said[-2000:])
    same = r"the same bits over (\d+) ticks in"
    rows = [row("targets", "emulated", "presets whose tests pass", len(re.findall(r"dev: testing build/", said)), "",
                ">=", presets),
            row("targets", "emulated", "ticks with the same bits", smallest(same, said), "", ">=", 1e4),
            row("targets", "emulated", "targets with the same bits", smallest(same.replace(r"(\d+)", r"\d+") +
                                                                             r" (\d+) builds", said), "", ">=", builds),
            row("targets", "Cortex-M7", "RAM", smallest(r"ram_bytes (\d+)", said) / 1024, "KiB", "<=", 256),
            row("targets", "Cortex-M7", "flash", smallest(r"flash_bytes (\d+)", said) / 1024, "KiB", "<=", 512)]
    most = max((float(n) for n in re.findall(r"instructions_per_tick_most (\d+)", said)), default=math.nan)
    print(f"  {'Cortex-M7: the longest tick, plant included':<58} {most:10.4g} instructions")
    return rows


@section("other targets")
def targets(args):
    if args.quick:
        return target_rows(*streamed([ROOT / "dev", "cross", "small"], "^dev:|^  "), presets=2, builds=3)
    code, said = streamed([ROOT / "dev", "cross"], "^dev:|^  ")
    rows = target_rows(code, said, presets=5, builds=4)
    # tests/cross/hil.sh compares twice: two loops, then the log of one replayed
    same = float("hardware in the loop" in said and ", 0 different" in said)
    return [*rows, row("targets", "hardware in the loop", "aarch64 controller, native plant, LCM: same commands", same,
                       "", ">=", 1)]


def run_section(args, name):
    title, function = SECTIONS[name]
    print(f"\n==== {title}", flush=True)
    try:
        return function(args)
    except (NotMeasured, OSError, ValueError) as error:
        args.failed.append(name)
        print(f"  not measured: {error}", flush=True)
        return []


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--page", action="store_true")
    parser.add_argument("--build", type=pathlib.Path, default=RELEASE)
    args = parser.parse_args()
    if unknown := [s for s in args.sections if s not in SECTIONS]:
        parser.error(f"unknown section {unknown[0]}; there are {', '.join(SECTIONS)}")
    args.build = args.build.resolve()
    args.failed = []
    args.tests_built = False
    rows = []
    try:
        for name in args.sections or SECTIONS:
            rows += run_section(args, name)
    except KeyboardInterrupt:
        note("interrupted; the rows so far:")
        args.failed.append("the rest")
    summary(rows)
    if args.failed:
        print(f"not measured, or not to the end: {', '.join(args.failed)}")
    return 1 if args.failed else 0


if __name__ == "__main__":
    sys.exit(main())
