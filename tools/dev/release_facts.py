"""What a release says of itself: its version in every file that states one, and the contracts of the C headers.

    release_facts.py [ROOT]      prints what disagrees, and exits with 1 if something does
"""

import pathlib
import re
import sys

HEADERS = "runtime/include/tiller"
POLICY = "docs/project/abi_policy.md"
CHANGELOG = "docs/project/changelog.md"
# Where the version stands, beside CMakeLists.txt, whose word counts.
WHOLE = (("pyproject.toml", r'^version = "([^"]+)"'),
         ("python/tiller/__init__.py", r'^__version__ = "([^"]+)"'),
         ("tools/packaging/changelog", r"^tiller \(([^)]+)\)"),
         ("tools/packaging/tiller.1", r'^\.TH TILLER 1 "[^"]*" "tiller ([^"]+)"'),
         (CHANGELOG, r"^## (\d[^, ]*)"),
         (POLICY, r"^\| (\d+\.\d+\.\d+) \|"),
         ("README.md", r"\bVersion (\d+\.\d+\.\d+)\b"),
         ("docs/guide/fit.md", r"^Version (\d+\.\d+\.\d+)\b"),
         ("docs/guide/building.md", r"tiller-tools_([^_]+)_"))
# Its first two numbers.
MINOR = ((f"{HEADERS}/tiller.h", r"^#define TILLER_VERSION_MAJOR (\d+)\n#define TILLER_VERSION_MINOR (\d+)$"),
         ("tests/abi/lifecycle_test.cpp", r'tiller_version\(\), "([0-9.]+)"'),
         ("tests/package/consumer/CMakeLists.txt", r"^find_package\(tiller (\S+) "),
         ("docs/guide/building.md", r"find_package\(tiller (\S+) "),
         ("docs/guide/building.md", r"`libtiller\.so\.([0-9.]+)`"),
         ("tools/packaging/lintian-overrides", r"^libtiller([0-9.]+):"))
CONTRACTS = (("tiller.h", "TILLER_CONFIG_VERSION"), ("model.h", "TILLER_MODEL_VERSION"),
             ("transport.h", "TILLER_TRANSPORT_VERSION"))


def read(root, name):
    return (root / name).read_text(encoding="utf-8")


def version(root):
    return re.search(r"^project\(tiller VERSION (\d+\.\d+\.\d+)\b", read(root, "CMakeLists.txt"), re.M).group(1)


def disagreements(root):
    """A sentence for each place that states another version."""
    whole = version(root)
    for wanted, places in ((whole, WHOLE), (whole.rpartition(".")[0], MINOR)):
        for name, pattern in places:
            found = re.search(pattern, read(root, name), re.M)
            stated = ".".join(found.groups()) if found else None
            if stated is None:
                yield f"{name}: states no version (looked for {pattern}); CMakeLists.txt has {whole}"
            elif stated != wanted:
                yield f"{name}: states {stated}, and CMakeLists.txt {whole}; write {wanted}"


def contracts(root):
    """The numbers of the C headers, in the order of the policy's table."""
    return [int(re.search(rf"^#define {macro} (\d+)u$", read(root, f"{HEADERS}/{header}"), re.M).group(1))
            for header, macro in CONTRACTS]


def recorded_contracts(root):
    """[(version, [configuration, model, transport])], newest first: the table of the policy."""
    rows = re.findall(r"^\| (\d+\.\d+\.\d+) \| (\d+) \| (\d+) \| (\d+) \|", read(root, POLICY), re.M)
    return [(row[0], [int(n) for n in row[1:]]) for row in rows]


def broken_policy(root):
    """A sentence where the headers differ from the table of the policy, or a version promises what it does not keep."""
    rows = recorded_contracts(root)
    if not rows or rows[0][0] != version(root):
        return  # disagreements() says so
    if rows[0][1] != contracts(root):
        now = ", ".join(f"{macro} {n}" for (_, macro), n in zip(CONTRACTS, contracts(root)))
        yield f"{POLICY}: the row of {rows[0][0]} has {rows[0][1]}; the headers have {now}: write these numbers there"
    for (new, ours), (old, theirs) in zip(rows, rows[1:]):
        if new.split(".")[:2] == old.split(".")[:2] and ours != theirs:
            yield f"{POLICY}: {new} changes a contract of {old}, which only another second number may"
    newest = re.search(r"^## (\d+) to (\d+)", read(root, "docs/project/upgrade.md"), re.M)
    if newest is None or int(newest.group(2)) != contracts(root)[0]:
        yield (f"docs/project/upgrade.md: its first step is not one to TILLER_CONFIG_VERSION {contracts(root)[0]}; "
               "add what changed")


def notes(root):
    """(date or "not released", text) of the newest version of the changelog."""
    heading, text = re.search(r"^## \S+, (.+?)\n(.*?)(?=^## |\Z)", read(root, CHANGELOG), re.M | re.S).groups()
    return heading.strip(), text.strip()


def undated(root):
    date, debian = notes(root)[0], read(root, "tools/packaging/changelog")
    if not re.fullmatch(r"\d{4}-\d\d-\d\d", date):
        yield f"{CHANGELOG}: {version(root)} is '{date}'; write the day of the release"
    elif "UNRELEASED" in debian.splitlines()[0]:
        yield f"tools/packaging/changelog: {version(root)} is UNRELEASED; write stable, and the day at its end"


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parents[2]).resolve()
    faults = [*disagreements(root), *broken_policy(root)]
    print("\n".join(faults) if faults else f"tiller {version(root)}: {len(WHOLE) + len(MINOR)} places agree")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
