"""misra.py: what cppcheck's addon for MISRA C:2012 finds in the C core, against docs/safety/misra.md.

The page has a row for each file and rule: how many, and why they stand. Fails where the two differ: a finding that no
row allows, or a row that allows more than there are.
"""
import collections
import pathlib
import re
import subprocess
import sys

PAGE = pathlib.Path("docs/safety/misra.md")
SOURCES = ("gate.c", "machine.c", "answer.c")


def found():
    counts, seen = collections.Counter(), set()
    for source in SOURCES:
        done = subprocess.run(["cppcheck", "--addon=misra", "--std=c99", "-Iruntime/include", "-Iruntime", "--quiet",
                               f"runtime/safety/{source}"], capture_output=True, text=True, check=True)
        finding = r"^(\S+):(\d+):(\d+): .*\[misra-c2012-([\d.]+)\]$"
        for place in re.findall(finding, done.stderr, re.MULTILINE):
            path, _, _, rule = place
            counts[path.removeprefix("runtime/"), rule] += place not in seen  # a header is read with each of the sources
            seen.add(place)
    return counts


def allowed():
    rows = re.findall(r"^\| `(\S+)` \| ([\d.]+) \| (\d+) \| (\S.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return collections.Counter({(path, rule): int(count) for path, rule, count, _ in rows})


def main():
    is_there, stands = found(), allowed()
    wrong = [key for key in sorted(set(is_there) | set(stands)) if is_there[key] != stands[key]]
    for path, rule in wrong:
        print(f"{path}: rule {rule}: {is_there[path, rule]} found, {stands[path, rule]} in {PAGE}")
    print(f"MISRA C:2012 in {', '.join(SOURCES)} and their headers: {sum(is_there.values())} findings of "
          f"{len({rule for _, rule in is_there})} rules, {len(wrong)} without their row")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
