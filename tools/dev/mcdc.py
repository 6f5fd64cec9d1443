"""mcdc.py BUILD_FOLDER LLVM_VERSION [--list]: which conditions of runtime the tests of a build with TILLER_MCDC decide.

A decision is what an `if`, a loop, `?:` or a value made of && and || asks; its conditions are the parts between && and
||. A condition is covered if tests show that it decides alone: two runs that differ in it and in the outcome, while the
others are equal or were not asked (masking MC/DC, clang's). A decision of one condition is covered if it came out both
ways, a case of a switch if it was taken and if it was not. What is compiled several times, by a template or for several
programs, counts once and is covered where any copy is.

Prints a row for each file and every condition that is not covered, writes both to BUILD_FOLDER/mcdc.txt, and ends
with 1 if fewer than the goal are covered, or if one is neither covered nor a row of docs/safety/conditions.md: file, the
text of the condition as it stands there, and why. --list: those conditions alone, as rows for that table.
"""
import collections
import json
import pathlib
import re
import subprocess
import sys

GOAL_PERCENT = 95.0
EXCUSES = pathlib.Path("docs/safety/conditions.md")
FOLDERS = ("safety", "executive", "abi", "io")


def export(build, version):
    """The coverage of every program that left counts, as llvm-cov has it."""
    profile = build / "mcdc.profdata"
    raw = sorted(str(p) for p in (build / "profiles").glob("*.profraw"))
    if not raw:
        sys.exit(f"mcdc: no counts in {build}/profiles; run the tests of that build first")
    subprocess.run([f"llvm-profdata-{version}", "merge", "-sparse", *raw, "-o", profile], check=True)
    programs = sorted(str(p) for p in build.glob("tests/*/*") if p.is_file() and p.stat().st_mode & 0o100)
    objects = [word for program in programs[1:] for word in ("-object", program)]
    command = [f"llvm-cov-{version}", "export", f"-instr-profile={profile}", programs[0], *objects]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)["data"][0]


def name_in_tree(filename, folders=FOLDERS):
    """Of a header, by the link that it was included through; None for what is not counted."""
    resolved = pathlib.Path(filename).resolve()
    root = pathlib.Path.cwd().resolve()
    if root not in resolved.parents:
        return None
    parts = resolved.relative_to(root).parts
    return "/".join(parts) if parts[0] == "runtime" and (folders is None or parts[1] in folders) else None


def collect(data):
    """{file: {span of a decision: [condition i covered]}} and {file: {span: [came out true, false, is part]}}."""
    decisions = collections.defaultdict(dict)
    branches = collections.defaultdict(dict)
    part_of_decision = 6  # llvm/ProfileData/Coverage/CoverageMapping.h: MCDCBranchRegion
    for function in data["functions"]:
        names = [name_in_tree(f) for f in function["filenames"]]
        for r in function.get("branches", []):
            if names[r[6]] is None:
                continue
            seen = branches[names[r[6]]].setdefault(tuple(r[:4]), [False, False, r[8] == part_of_decision])
            seen[0] |= r[4] > 0
            seen[1] |= r[5] > 0
        for r in function.get("mcdc_records", []):
            if names[r[4]] is None:
                continue
            covered = decisions[names[r[4]]].setdefault(tuple(r[:4]), [False] * len(r[6]))
            for i, yes in enumerate(r[6]):
                covered[i] |= bool(yes)
    return decisions, branches


def inside(span, decision):
    return decision[:2] <= span[:2] and span[2:] <= decision[2:]


def text_of(lines, span):
    first, begin, last, end = span
    if first == last:
        return lines[first - 1][begin - 1:end - 1]
    parts = [lines[first - 1][begin - 1:], *lines[first:last - 1], lines[last - 1][:end - 1]]
    return " ".join(" ".join(parts).split())


def conditions_of(name, decisions, branches):
    """[(line, text, covered)], and the number of decisions."""
    lines = pathlib.Path(name).read_text(encoding="utf-8").split("\n")
    left = dict(branches)
    found, count = [], 0
    # inner decisions first: a condition belongs to the smallest that holds it
    for decision, covered in sorted(decisions.items(), key=lambda d: (d[0][2] - d[0][0], d[0][3] - d[0][1])):
        spans = sorted(s for s, outcome in left.items() if outcome[2] and inside(s, decision))
        count += 1
        if len(spans) != len(covered):
            spans = [decision] * len(covered)
        for span, yes in zip(spans, covered):
            left.pop(span, None)
            found.append((span[0], text_of(lines, span), yes))
    for span, (true, false, _) in left.items():
        text = text_of(lines, span)
        # what a macro of the system asks, and the missing default of a switch over all values, which -Wswitch checks
        if not text or lines[span[0] - 1][:span[1] - 1].rstrip().endswith("switch ("):
            continue
        count += 1
        found.append((span[0], lines[span[0] - 1].strip() if text == ":" else text, true and false))
    return sorted(found), count


def excuses():
    rows = EXCUSES.read_text(encoding="utf-8").splitlines() if EXCUSES.exists() else []
    found = {}
    for row in rows:
        cells = re.match(r"\| `(\S+)` \| `(.+)` \| (\S.*) \|$", row)
        if cells:
            found[f"runtime/{cells[1]}", cells[2].replace("\\|", "|")] = cells[3]
    return found


def main():
    build, version = pathlib.Path(sys.argv[1]), sys.argv[2]
    decisions, branches = collect(export(build, version))
    allowed, used, report, missing, total = excuses(), set(), [], [], collections.Counter()
    report.append(f"{'runtime/':<40}{'decisions':>10}{'conditions':>12}{'covered':>9}{'%':>8}")
    folders = collections.defaultdict(collections.Counter)
    for name in sorted(set(decisions) | set(branches)):
        found, count = conditions_of(name, decisions[name], branches[name])
        row = collections.Counter(decisions=count, conditions=len(found), covered=sum(c[2] for c in found))
        folders[name.split("/")[1]].update(row)
        total.update(row)
        report.append(row_of(name.removeprefix("runtime/"), row))
        missing += [(name, line, text) for line, text, covered in found if not covered]
    report += [row_of(folder, folders[folder]) for folder in FOLDERS] + [row_of("total", total)]
    unexplained = [m for m in missing if (m[0], m[2]) not in allowed]
    used = {(m[0], m[2]) for m in missing}
    stale = [key for key in allowed if key not in used]
    if "--list" in sys.argv:
        for name, _, text in unexplained:
            print(f"| `{name.removeprefix('runtime/')}` | `{text.replace('|', chr(92) + '|')}` |  |")
        return 0
    report.append(f"\nnot covered: {len(missing)}, of which {len(missing) - len(unexplained)} stand in {EXCUSES}")
    report += [f"{name}:{line}: {text}" + ("" if (name, text) not in allowed else f"  ({allowed[name, text]})")
               for name, line, text in missing]
    report += [f"{EXCUSES}: covered, or not there any more: {name} {text}" for name, text in stale]
    print(*report, sep="\n")
    (build / "mcdc.txt").write_text("\n".join(report) + "\n", encoding="utf-8")
    met = 100.0 * total["covered"] >= GOAL_PERCENT * total["conditions"]
    return 0 if met and not unexplained and not stale else 1


def row_of(name, row):
    share = 100.0 * row["covered"] / row["conditions"] if row["conditions"] else 100.0
    return f"{name:<40}{row['decisions']:>10}{row['conditions']:>12}{row['covered']:>9}{share:>8.1f}"


if __name__ == "__main__":
    sys.exit(main())
