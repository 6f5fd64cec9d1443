#!/usr/bin/env python3
"""Counts the instructions of fixed work under callgrind and compares them with instruction_counts.txt.

Instructions do not depend on how busy a machine is, so a change that makes a kernel, a planner or an engine do more
work shows in every run. They are not time: cache misses and latencies do not count. The SSE2 copy of the kernels is
what runs, because every processor and the emulator have it.

A row may differ by BOUND from its table: another version of the C library or of GCC 12 moves rows by some tenths of a
per cent, while what is worth noticing moves them by several. Rows that fall by more than the bound fail too: the table
is renewed, so that what was won is held. SLACK instructions are free: the C library clears and copies with what the
processor has, which costs 32 instructions more or less in every row. `TILLER_APPROVE=1 ctest -R instruction_counts`
writes the table.

usage: instructions_test.py VALGRIND PROGRAM COMPILER_VERSION TABLE FOLDER
"""

import os
import pathlib
import re
import subprocess
import sys

BOUND = 0.02
SLACK = 64
SKIPPED = 77


def counted(valgrind, program, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("callgrind.*"):
        old.unlink()
    command = [valgrind, "--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={folder}/callgrind.%p", program]
    run = subprocess.run(command, env={**os.environ, "TILLER_ISA": "sse2"}, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        sys.exit(f"{' '.join(command)} ended with {run.returncode}:\n{run.stdout}{run.stderr}")
    refused = [line for line in run.stdout.splitlines() if line.endswith("refused")]
    if refused:
        sys.exit("\n".join(refused))
    counts = {}
    for dump in folder.glob("callgrind.*"):
        text = dump.read_text()
        name = re.search(r"^desc: Trigger: Client Request: (\S+)$", text, re.MULTILINE)
        if name:
            counts[name.group(1)] = int(re.search(r"^(?:totals|summary): (\d+)", text, re.MULTILINE).group(1))
    return {name: counts[name] for name in run.stdout.split() if name in counts}


def read_table(path):
    lines = [line.split() for line in path.read_text().splitlines() if line and not line.startswith("#")]
    compiler = next(words[1] for words in lines if words[0] == "compiler")
    return compiler, {words[0]: int(words[1]) for words in lines if words[0] != "compiler"}


def write_table(path, compiler, counts):
    rows = "".join(f"{name} {count}\n" for name, count in counts.items())
    path.write_text(f"# Written by TILLER_APPROVE=1 ctest -R instruction_counts; see instructions_test.py.\n"
                    f"compiler {compiler}\n{rows}")


def complaints(counts, table):
    for name in sorted(set(counts) ^ set(table)):
        yield f"{name}: {'not in the table' if name in counts else 'in the table, but not counted'}"
    for name, count in counts.items():
        expected = table.get(name, count)
        if abs(count - expected) > BOUND * expected + SLACK:
            yield f"{name}: {count} instructions, {100 * (count / expected - 1.0):+.1f} % of {expected}"


def main():
    valgrind, program, compiler, table_file, folder = sys.argv[1:]
    table_path = pathlib.Path(table_file)
    compiler = compiler.split(".")[0]
    table_compiler, table = read_table(table_path) if table_path.exists() else (compiler, {})
    approve = os.environ.get("TILLER_APPROVE") == "1"
    if compiler != table_compiler and not approve:
        print(f"the table holds for GCC {table_compiler}, this build is made by {compiler}: nothing to compare with")
        return SKIPPED
    counts = counted(valgrind, program, pathlib.Path(folder))
    if approve:
        write_table(table_path, compiler, counts)
        print(f"{len(counts)} rows written to {table_path}")
        return 0
    for name, count in counts.items():
        print(f"{name} {count} ({count / table[name]:.4f})" if name in table else f"{name} {count}")
    wrong = list(complaints(counts, table))
    if wrong:
        print(f"\nmore than {100 * BOUND:.0f} % off {table_path.name}:\n  " + "\n  ".join(wrong))
        print("A change that is meant: TILLER_APPROVE=1 ctest -R instruction_counts, and the reason in the commit.")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
