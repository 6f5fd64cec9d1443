"""No word that docs/project/words.md has replaced stands in the files that its row names."""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
TEXT = {".cpp", ".hpp", ".h", ".c", ".def", ".inc", ".in", ".py", ".txt", ".cmake", ".md", ".toml"}
# The page itself, and what tells users of the new name.
MAY = {"docs/project/words.md", "tools/robot/robot_schema.cpp", "tests/tools/robot_file_errors_test.cpp"}


def rows(page):
    """[(words, folders)] of every table row."""
    for line in page.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) != 3 or not line.startswith("|") or cells[0] in ("not", "---"):
            continue
        words = re.findall(r"`([^`]+)`", cells[0]) or [cells[0]]
        yield words, cells[2].split(", ")


def pattern(word):
    starts = r"(?<![A-Za-z0-9_])" if word[0].isalnum() else ""
    ends = r"(?![A-Za-z0-9_])" if word[-1].isalnum() or word[-1] == "_" else ""
    return re.compile(starts + re.escape(word) + ends)


def texts(folder):
    for path in sorted((ROOT / folder).rglob("*")):
        name = str(path.relative_to(ROOT))
        if path.suffix in TEXT and path.is_file() and name not in MAY:
            yield name, path.read_text(errors="replace")


def main():
    cache, found, searched = {}, [], 0
    for words, folders in rows(ROOT / "docs/project/words.md"):
        for word in words:
            searched += 1
            for folder in folders:
                files = cache.setdefault(folder, list(texts(folder)))
                if not files:
                    found.append(f"{folder}: no such folder, or nothing in it")
                for name, text in files:
                    for match in pattern(word).finditer(text):
                        found.append(f"{name}:{text.count(chr(10), 0, match.start()) + 1}: '{word}'")
    print("\n".join(found[:40]))
    print(f"{searched} words looked for, {len(found)} found")
    return 1 if found or searched < 20 else 0


if __name__ == "__main__":
    sys.exit(main())
