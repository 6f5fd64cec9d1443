#!/usr/bin/env python3
"""Seconds that a build spent, per source and per folder, from ninja's log.

    build_timings.py BUILD_FOLDER [SOURCES]

Seconds are those that a step took beside the others that ran with it; of a step that ran several times, the last. A
compiler cache makes them small: without one they are what a fresh machine waits for.
"""

import collections
import pathlib
import sys


def read_steps(log):
    """Output path -> seconds of its last run."""
    steps = {}
    for line in log.read_text().splitlines():
        fields = line.split("\t")
        if len(fields) == 5:
            steps[fields[3]] = (int(fields[1]) - int(fields[0])) / 1000.0
    return steps


def folder_of(output):
    """The source's folder: what stands before CMakeFiles."""
    return output.split("/CMakeFiles/")[0] if "/CMakeFiles/" in output else str(pathlib.PurePath(output).parent)


def source_of(output):
    return output.replace("CMakeFiles/", "").removesuffix(".o")


def main(arguments):
    if len(arguments) not in (1, 2) or arguments[0] in ("-h", "--help"):
        sys.exit(__doc__.strip())
    log = pathlib.Path(arguments[0]) / ".ninja_log"
    if not log.is_file():
        sys.exit(f"build_timings: {log}: no such file; build first: ./dev build")
    steps = read_steps(log)
    compiled = {output: seconds for output, seconds in steps.items() if output.endswith(".o")}
    print(f"{sum(steps.values()):8.0f} s in {len(steps)} steps, {len(compiled)} of them compiled")
    print("\nsources that took longest")
    for output, seconds in sorted(compiled.items(), key=lambda item: -item[1])[: int((arguments + ["25"])[1])]:
        print(f"{seconds:8.1f} s  {source_of(output)}")
    folders = collections.Counter()
    for output, seconds in compiled.items():
        folders[folder_of(output)] += seconds
    print("\nfolders")
    for folder, seconds in folders.most_common():
        print(f"{seconds:8.1f} s  {folder}")


if __name__ == "__main__":
    main(sys.argv[1:])
