"""Every file states the same version, and a file that states another one is named: facts_test.py ROOT"""

import pathlib
import re
import shutil
import sys
import tempfile

ROOT = pathlib.Path(sys.argv[1]).resolve()
sys.path.insert(0, str(ROOT / "tools/dev"))

import release_facts as facts  # noqa: E402

FILES = {"CMakeLists.txt", "docs/project/upgrade.md", *(name for name, _ in (*facts.WHOLE, *facts.MINOR)),
         *(f"{facts.HEADERS}/{header}" for header, _ in facts.CONTRACTS)}


def changed(folder, name, pattern, replacement):
    """The faults of a copy of the tree in which one place states something else."""
    path = folder / name
    text = path.read_text(encoding="utf-8")
    other = re.sub(pattern, replacement, text, count=1, flags=re.M)
    assert other != text, f"{name}: {pattern} is not there"
    path.write_text(other, encoding="utf-8")
    found = [*facts.disagreements(folder), *facts.broken_policy(folder)]
    path.write_text(text, encoding="utf-8")
    return found


def main():
    faults = [*facts.disagreements(ROOT), *facts.broken_policy(ROOT)]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for file in FILES:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / file, folder / file)
        if not faults:
            for place, pattern in (*facts.WHOLE, *facts.MINOR):
                last = lambda m: m[0][:m.end(m.lastindex) - m.start()][:-len(m[m.lastindex])] + "7" * 3 + \
                    m[0][m.end(m.lastindex) - m.start():]
                if not any(fault.startswith(f"{place}:") for fault in changed(folder, place, pattern, last)):
                    faults.append(f"{place}: another version there is not seen ({pattern})")
            for header, macro in facts.CONTRACTS:
                found = changed(folder, f"{facts.HEADERS}/{header}", rf"(#define {macro} )\d+", r"\g<1>99")
                if not any(fault.startswith(facts.POLICY) for fault in found):
                    faults.append(f"{header}: another {macro} is not seen")
            rows = rf"(\| {re.escape(facts.version(ROOT))} \| (\d+) \| (\d+) \| (\d+) \|)"
            older = facts.version(ROOT).rpartition(".")[0] + ".999"
            if not changed(folder, facts.POLICY, rows, rf"\1\n| {older} | 1 | \3 | \4 |"):
                faults.append("a third number that changes a contract is not seen")
    print("\n".join(faults) if faults else f"{facts.version(ROOT)} everywhere; every place is looked at")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
