"""branches.py BUILD_FOLDER LLVM_VERSION: which branches of runtime the tests of a build with TILLER_MCDC take.

A branch is one of the two outcomes of a condition as the source has it: of what an `if`, a loop or `?:` asks, of each
part between && and ||, of each case of a switch. What is compiled several times, by a template or for several programs,
counts once and is taken where any copy takes it; what is decided at compile time in every copy counts not at all.
(`./dev coverage` counts the compiler's branches instead: those of each copy, of the library's inline functions, and of
code that no line asks for.)

Prints branches and those taken of each folder, writes to BUILD_FOLDER/branches.txt those of each file and every
condition with an outcome that is not taken, and ends with 1 below the goal.
"""
import collections
import pathlib
import sys

import mcdc

GOAL_PERCENT = 90.0


def collect(data):
    """{file: {span of a condition: [came out true, came out false, was asked, is decided at run time]}}."""
    found = collections.defaultdict(dict)
    for function in data["functions"]:
        names = [mcdc.name_in_tree(f, None) for f in function["filenames"]]
        if not any(names):
            continue
        regions = collections.defaultdict(list)
        for r in function["regions"]:
            if r[7] == 0:  # code, not a gap or an expansion
                regions[r[5]].append((tuple(r[:2]), tuple(r[2:4]), r[4]))
        for r in function.get("branches", []):
            if names[r[6]] is None:
                continue
            seen = found[names[r[6]]].setdefault(tuple(r[:4]), [False, False, False])
            seen[0] |= r[4] > 0
            seen[1] |= r[5] > 0
            seen[2] |= r[4] == r[5] == 0 and count_at(regions[r[6]], tuple(r[:2]), tuple(r[2:4])) > 0
    return found


def count_at(regions, begin, end):
    """How often the smallest region around a condition ran."""
    around = [(last, first, count) for first, last, count in regions if first <= begin and end <= last]
    # of nested regions the one that begins last
    return max(around, key=lambda a: (a[1], tuple(-v for v in a[0])))[2] if around else 0


def conditions_of(name, spans):
    """[(line, text, outcomes that exist, outcomes taken, what is missing)]"""
    lines = pathlib.Path(name).read_text(encoding="utf-8").split("\n")
    found = []
    for span, (true, false, decided_early) in spans.items():
        text = mcdc.text_of(lines, span)
        before = lines[span[0] - 1][:span[1] - 1].rstrip()
        # what a macro of the system asks; the missing default of a switch over all values, which -Wswitch checks; a
        # condition that every copy which was run decides at compile time
        if not text or before.endswith("switch (") or (decided_early and not true and not false):
            continue
        missing = {(False, False): "never asked", (True, False): "never false", (False, True): "never true"}
        label = lines[span[0] - 1].strip() if text == ":" else text
        if text == ":" or text.startswith(("case ", "default")):  # of a case: taken or not
            found.append((span[0], label, 1, int(true), "" if true else "never taken"))
        else:
            found.append((span[0], label, 2, true + false, missing.get((true, false), "")))
    return sorted(found)


def main():
    build, version = pathlib.Path(sys.argv[1]), sys.argv[2]
    conditions = collect(mcdc.export(build, version))
    folders, total = collections.defaultdict(collections.Counter), collections.Counter()
    files, missing = [], []
    for name in sorted(conditions):
        found = conditions_of(name, conditions[name])
        row = collections.Counter(branches=sum(c[2] for c in found), taken=sum(c[3] for c in found))
        files.append(row_of(name.removeprefix("runtime/"), row))
        folders[name.split("/")[1]].update(row)
        total.update(row)
        missing += [f"{name}:{line}: {text}  ({why})" for line, text, _, _, why in found if why]
    report = [f"{'runtime/':<44}{'branches':>10}{'taken':>8}{'%':>8}"]
    report += [row_of(folder, folders[folder]) for folder in sorted(folders)] + [row_of("total", total)]
    print(*report, sep="\n")
    (build / "branches.txt").write_text("\n".join([*report, "", *files, "", *missing]) + "\n", encoding="utf-8")
    return 0 if 100.0 * total["taken"] >= GOAL_PERCENT * total["branches"] else 1


def row_of(name, row):
    share = 100.0 * row["taken"] / row["branches"] if row["branches"] else 100.0
    return f"{name:<44}{row['branches']:>10}{row['taken']:>8}{share:>8.1f}"


if __name__ == "__main__":
    sys.exit(main())
