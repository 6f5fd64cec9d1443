"""requirements.py [--write]: every safety requirement has tests, and a contract or the reason why none.

docs/safety/requirements.md has a row for each requirement: number, statement and hazards, by hand; then the tests and
the contracts that are marked with it,

    // Requirement: SR-3        above a TEST
    /* Requirement: SR-3 */     above a contract (ACSL) of runtime/safety

Where no contract is marked, the last cell says why, by hand: "none: ...". Fails where a cell is empty, a mark names a
requirement that there is not, or the page is not what --write would make of it.
"""
import collections
import pathlib
import re
import sys

PAGE = pathlib.Path("docs/safety/requirements.md")
MARK = re.compile(r"Requirement: (SR-\d+(?:, SR-\d+)*)")
NAME = re.compile(r"^(?:TEST(?:_F|_P)?\((\w+),\s*(\w+)\)|extern \"C\" int (LLVMFuzzer\w+)|(?:\w+ )+(tiller_\w+)\()")


def marked(path):
    """(requirement, name) of every mark: the name of what follows it."""
    waiting = []
    for line in path.read_text(encoding="utf-8").splitlines():
        mark = MARK.search(line)
        if mark:
            waiting += mark[1].split(", ")
            continue
        name = NAME.match(line)
        if name and waiting:
            text = f"{name[1]}.{name[2]}" if name[1] else path.stem if name[3] else name[4]
            yield from ((one, text) for one in waiting)
            waiting = []
    if waiting:
        sys.exit(f"{path}: a mark of {waiting} stands above no test and no function")


def collect(folder, pattern):
    """{requirement: {file: names}}"""
    found = collections.defaultdict(lambda: collections.defaultdict(list))
    for path in sorted(pathlib.Path(folder).glob(pattern)):
        for requirement, name in marked(path):
            found[requirement][path].append(name)
    return found


def links(files):
    """A link for each file, with the number of marks where there are several; names are too long for a table."""
    return ", ".join(f"[{path.stem}](../../{path.as_posix()})" + (f" ({len(names)})" if len(names) > 1 else "")
                     for path, names in sorted(files.items()))


def count(found):
    return sum(len(names) for files in found.values() for names in files.values())


def main():
    tests, contracts = collect("tests", "**/*.cpp"), collect("runtime/safety", "*.h")
    lines, numbers, wrong = [], set(), []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("| SR-") else []
        if cells:
            number = cells[0]
            numbers.add(number)
            cells[3] = links(tests[number])
            cells[4] = links(contracts[number]) or (cells[4] if cells[4].startswith("none: ") else "")
            whats = ("statement", "hazard", "test", "contract or reason")
            wrong += [f"{number}: no {what}" for what, cell in zip(whats, cells[1:]) if not cell]
            line = "| " + " | ".join(cells) + " |"
        lines.append(line)
    wrong += [f"{number} is marked and not in {PAGE}" for number in sorted((set(tests) | set(contracts)) - numbers)]
    made = "\n".join(lines) + "\n"
    if "--write" in sys.argv:
        PAGE.write_text(made, encoding="utf-8")
    elif made != PAGE.read_text(encoding="utf-8"):
        wrong.append(f"{PAGE} is not current: python3 tools/dev/requirements.py --write")
    print(*wrong, f"{len(numbers)} requirements, {count(tests)} marks of tests, "
                  f"{count(contracts)} of contracts", sep="\n")
    return 1 if wrong or not numbers else 0


if __name__ == "__main__":
    sys.exit(main())
