#!/usr/bin/env python3
"""Draws the modules of the tree from what the build links, and checks their walls.

    modules.py BUILD/modules.txt            prints the table
    modules.py BUILD/modules.txt --check PAGE   fails where a wall is broken or the page's table is out of date
    modules.py BUILD/modules.txt --write PAGE   renews the table between the page's two marks

Three rules: a folder links only folders of its own level or below (LEVELS), folders that link each other form no
circle, and an #include reaches only folders that its own folder links, directly or through others. Tests may use
everything.
"""

import argparse
import collections
import pathlib
import re
import sys

LEVELS = ["runtime", "sim", "tools", "python", "harness", "bench", "tests"]
BEGIN, END = "<!-- modules: made by ./dev modules -->", "<!-- end of modules -->"
SOURCE = {".hpp", ".cpp", ".h", ".c", ".def", ".inc"}
LINES_MAY_DIFFER = 0.25  # a table that is wrong after every commit would only be in the way


def read_links(path):
    """folder -> folders whose targets its own targets link."""
    links = collections.defaultdict(set)
    for line in pathlib.Path(path).read_text().splitlines():
        head, _, to = line.partition(":")
        folder = head.split()[0]
        links[folder].update(to.split())
    return dict(links)


def closure(links, start):
    seen, open_ends = set(), [start]
    while open_ends:
        for below in links.get(open_ends.pop(), ()):
            if below not in seen:
                seen.add(below)
                open_ends.append(below)
    return seen


def level(folder):
    return LEVELS.index(folder.split("/")[0])


def upward_links(links):
    return [(a, b) for a, to in links.items() if not a.startswith(("tests", "examples")) for b in to if level(b) > level(a)]


def circles(links):
    return sorted(folder for folder in links if folder in closure(links, folder))


def sources_of(root, folder, folders):
    """Files of a folder, those of folders below it left out that have targets themselves."""
    for path in sorted((root / folder).rglob("*")):
        if path.suffix not in SOURCE:
            continue
        above = path.relative_to(root).parent
        owner = next(p for p in [above, *above.parents] if str(p) in folders or str(p) == ".")
        if str(owner) == folder:
            yield path


def owner_of_include(root, include, folders):
    for base in ("", "runtime/"):
        path = pathlib.PurePosixPath(base + include)
        if (root / path).is_file():
            return next((str(p) for p in path.parents if str(p) in folders), None)
    return None


def stray_includes(root, links):
    """(file, include) whose target's folder is not linked by the file's own."""
    folders = set(links)
    for folder in sorted(folders):
        if folder.startswith(("tests", "examples")):
            continue
        may = closure(links, folder) | {folder}
        for path in sources_of(root, folder, folders):
            for include in re.findall(r'^#include "([^"]+)"', path.read_text(errors="replace"), re.M):
                owner = owner_of_include(root, include, folders)
                if owner and owner not in may:
                    yield str(path.relative_to(root)), include


def code_lines(root, folder, folders):
    return sum(len(p.read_text(errors="replace").splitlines()) for p in sources_of(root, folder, folders))


def reduced(links, folder):
    """The links that no other link of the folder implies."""
    to = links[folder]
    return sorted(b for b in to if not any(b in closure(links, other) for other in to if other != b))


def table(root, links):
    folders = set(links)
    shown = [f for f in sorted(links, key=lambda f: (level(f), f)) if not f.startswith("tests")]
    depth = {f: len(closure(links, f)) for f in shown}
    shown.sort(key=lambda f: (level(f), depth[f], f))
    rows = ["| folder | lines | links, and what those link |", "|---|---|---|"]
    for folder in shown:
        rows.append(f"| {folder} | {code_lines(root, folder, folders):,} | {', '.join(reduced(links, folder))} |")
    tests = sum(code_lines(root, f, folders) for f in folders if f.startswith("tests"))
    rows.append(f"| tests | {tests:,} | any |")
    return rows


def stale(page_rows, rows):
    """What differs between two tables, lines of code within LINES_MAY_DIFFER."""
    def parse(all_rows):
        cells = [[c.strip() for c in row.strip("|").split("|")] for row in all_rows[2:]]
        return {c[0]: (int(c[1].replace(",", "")), c[2]) for c in cells}
    old, new = parse(page_rows), parse(rows)
    for folder in sorted(set(old) | set(new)):
        if folder not in old or folder not in new:
            yield f"{folder}: {'new' if folder in new else 'gone'}"
        elif old[folder][1] != new[folder][1]:
            yield f"{folder}: links {new[folder][1] or 'nothing'}, the page says {old[folder][1] or 'nothing'}"
        elif abs(old[folder][0] - new[folder][0]) > LINES_MAY_DIFFER * new[folder][0] + 50:
            yield f"{folder}: {new[folder][0]} lines, the page says {old[folder][0]}"


def page_parts(page):
    text = page.read_text()
    if BEGIN not in text or END not in text:
        sys.exit(f"{page}: the marks '{BEGIN}' and '{END}' are missing")
    before, rest = text.split(BEGIN, 1)
    inside, after = rest.split(END, 1)
    return before, inside.strip().splitlines(), after


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", help="modules.txt of a configured build")
    parser.add_argument("--check", metavar="PAGE", type=pathlib.Path)
    parser.add_argument("--write", metavar="PAGE", type=pathlib.Path)
    args = parser.parse_args()
    root = pathlib.Path(__file__).resolve().parents[2]
    links = {f: to for f, to in read_links(args.modules).items() if not f.startswith("examples")}
    rows = table(root, links)
    if args.write:
        before, _, after = page_parts(args.write)
        args.write.write_text(before + BEGIN + "\n" + "\n".join(rows) + "\n" + END + after)
    elif not args.check:
        print("\n".join(rows))
    broken = [f"{a} links {b}, a level above it" for a, b in upward_links(links)]
    broken += [f"{f} links itself through others" for f in circles(links)]
    broken += [f'{path} includes "{include}", which its folder does not link' for path, include in stray_includes(root, links)]
    if args.check:
        broken += [f"{args.check.name} is out of date: {why}; ./dev modules renews it"
                   for why in stale(page_parts(args.check)[1], rows)]
    for line in broken:
        print(line, file=sys.stderr)
    print(f"{len(links)} folders, {len(broken)} broken rules", file=sys.stderr)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
