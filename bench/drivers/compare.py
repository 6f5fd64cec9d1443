# programs:
"""./dev bench compare REV [options]: another revision beside this one, ratios of benchmark rows in one run.

    REV            what git understands: a commit, a tag, HEAD~3
    --rounds N     rounds in which both take turns (3)
    --only NAME    rollout, residual, planners, posterior or gap; may be given more than once
    --models LIST  models that are built, separated by semicolons (pendulum;cart_pole)
    --bound R      ratio from which on a row is marked (1.02)

Both are built below build/compare, for this processor's best instruction set alone. A figure is the median of the
rounds, all on one core, the two programs in turn; a row is marked where it is slower by more than the bound and by more
than the rounds differ among themselves. Rows that one of the two does not have are left out. Nothing in this tree is
touched; a revision's build stays for the next time.
"""

import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile

from _driver import CORE, ROOT, note

HOME = ROOT / "build/compare"
FRESH = "an empty folder for each run"
PROGRAMS = {"rollout": ["bench_rollout"], "residual": ["bench_residual"], "planners": ["bench_planners"],
            "posterior": ["bench_calibration", "--rows", "1 % outliers", "--runs", "12", "--references", "0",
                          "--threads", "1", "--seed", "100001"],
            "gap": ["bench_gap", "sealed", "--tune", "--seeds", "1", "--plants", "pendulum,cart_pole", "--kinds",
                    "coulomb_friction,input_delay", "--cases", "6", "--no-oracle", "--out", FRESH]}
TIMES = {"ns", "us", "ms", "s"}
RATES = {"M/s", "1/s", "k/s"}


def run(*command, **options):
    return subprocess.run([str(c) for c in command], check=True, text=True, **options)


def best_isa():
    flags = next((line for line in open("/proc/cpuinfo", encoding="utf-8") if line.startswith("flags")), "").split()
    if {"avx512f", "avx512cd", "avx512dq", "avx512bw", "avx512vl"} <= set(flags):
        return "avx512"
    return "avx2" if {"avx2", "fma"} <= set(flags) else "sse2"


def checkout(revision):
    """The revision's source folder."""
    found = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "--short=12", "--verify", revision + "^{commit}"],
                           capture_output=True, text=True, check=False)
    if found.returncode != 0:
        sys.exit(f"compare: git knows no revision '{revision}' here; git log lists them")
    source = HOME / found.stdout.strip() / "source"
    if not source.is_dir():
        note(f"taking {found.stdout.strip()} out of the repository")
        source.mkdir(parents=True)
        archive = subprocess.Popen(["git", "-C", str(ROOT), "archive", revision], stdout=subprocess.PIPE)
        run("tar", "-x", "-C", source, stdin=archive.stdout)
        archive.wait()
    return source


def build(source, folder, models, programs):
    """The programs that this revision has, by name."""
    note(f"building {folder.relative_to(ROOT)} (the first time takes minutes)")
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "build.log", "w", encoding="utf-8") as log:
        try:
            run("cmake", "-S", source, "-B", folder, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                f"-DTILLER_ISA_ONLY={best_isa()}", f"-DTILLER_MODELS={models}", "-DTILLER_BUILD_TESTS=OFF",
                f"-DTILLER_VENV={ROOT / 'build/venv'}", stdout=log, stderr=log)
        except subprocess.CalledProcessError:
            sys.exit(f"compare: {source} does not configure; see {folder / 'build.log'}")
        for program in programs:
            if subprocess.run(["cmake", "--build", str(folder), "--target", program], stdout=log, stderr=log,
                              check=False).returncode != 0:
                note(f"{program} does not build in {folder.relative_to(ROOT)}; its rows are left out")
    # revisions of before had them below tools
    places = {p: [folder / place / p for place in ("bench", "tools/bench")] for p in programs}
    return {p: next(f for f in files if f.exists()) for p, files in places.items() if any(f.exists() for f in files)}


def rows_of(program, arguments):
    """(heading, row) -> (figure, unit) of a program's table."""
    with tempfile.TemporaryDirectory() as folder:
        command = [str(program), *(folder if word is FRESH else word for word in arguments)]
        text = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False,
                              preexec_fn=lambda: os.sched_setaffinity(0, {CORE})).stdout
    rows, heading = {}, ""
    for line in text.splitlines():
        row = re.match(r" {2,}(\S.*?)\s{2,}(\S+) (\S+)", line)
        if row and row[3] in TIMES | RATES:
            try:
                rows[heading, row[1]] = float(row[2]), row[3]
            except ValueError:
                pass
        elif line.strip() and not line.startswith("  "):
            heading = line.strip()
    return rows


def seconds(figure, unit):
    return 1.0 / figure if unit in RATES else figure


def report(name, before, now, bound):
    """Prints a program's rows; how many are marked."""
    marked = 0
    print(f"\n{name}: before, now, now / before in time")
    for key in before[0]:
        if not all(key in r for r in before + now):
            continue
        unit = before[0][key][1]
        a, b = ([seconds(*r[key]) for r in side] for side in (before, now))
        ratios = [y / x for x, y in zip(a, b)]
        ratio, spread = statistics.median(ratios), max(max(a) / min(a), max(b) / min(b))
        slower = ratio > bound and min(b) > max(a)
        marked += slower
        figures = [statistics.median(r[key][0] for r in side) for side in (before, now)]
        print(f"  {(key[0] + ': ' + key[1])[:78]:78s} {figures[0]:9.4g} {figures[1]:9.4g} {unit:4s} {ratio:6.3f}"
              f"  spread {spread:.2f}{'  slower' if slower else ''}", flush=True)
    return marked


def main():
    parser = argparse.ArgumentParser(prog="./dev bench compare", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", metavar="REV")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", action="append", choices=sorted(PROGRAMS))
    parser.add_argument("--models", default="pendulum;cart_pole")
    parser.add_argument("--bound", type=float, default=1.02)
    options = parser.parse_args()
    if options.rounds < 1:
        parser.error("--rounds: one at least")
    chosen = {name: PROGRAMS[name] for name in options.only or PROGRAMS}
    programs = [command[0] for command in chosen.values()]
    source = checkout(options.revision)
    sides = [build(source, source.parent / "build", options.models, programs),
             build(ROOT, HOME / "now", options.models, programs)]
    marked = 0
    for name, (program, *arguments) in chosen.items():
        if not all(program in side for side in sides):
            continue
        results = [[], []]
        for turn in range(options.rounds):
            note(f"{name}, round {turn + 1} of {options.rounds}")
            for side, kept in zip(sides, results):
                kept.append(rows_of(side[program], arguments))
        marked += report(name, *results, options.bound)
    print(f"\n{marked} rows slower by more than {options.bound}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
