"""What the tables (*.def) promise: a new line is enough.

    tables_test.py

No source of runtime or tools asks for an effect by its kind, no list of actuators stands anywhere but in its table, and
the counts and rows of the documents are those of the tables.
"""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
# What is written for one kind of effect because of what it is: the kernel's own text of the lag, and the network that
# stands for each kind of learnt effect.
KINDS_MAY = {"runtime/rollout/step.hpp": 2, "runtime/rollout/setup.cpp": 1}
# Beside codecs and emulated drives: the default, "odrive", and help.
WORDS_MAY = {"runtime/io/actuator.hpp", "sim/devices/drive_axis.hpp", "tools/robot/robot_file.hpp",
             "tools/robot/robot_schema.cpp"}
DOCUMENTS = ["README.md", "docs/README.md", "docs/guide", "docs/reference", "docs/theory", "docs/project/design.md"]
# Sentences that count what a table holds; evidence counts what it measured.
COUNTS = [r"\badds (\d+) effects\b", r"\bamong (\d+) kinds\b", r"\b(\d+) named effects\b"]

def table(path, macro):
    """[[argument of a line, ...], ...]"""
    text = (ROOT / path).read_text()
    rows = re.findall(rf"^{macro}\((.*)\)\s*$", text, re.M)
    return [[a.strip().strip('"') for a in re.findall(r'\s*("[^"]*"|[^,"]+)', row)] for row in rows]


def sources(*folders):
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".cpp", ".hpp", ".h"):
                yield str(path.relative_to(ROOT)), path.read_text()


def asks_for_kinds():
    """Comparisons with one kind of effect, and cases of switches."""
    pattern = re.compile(r"[!=]=\s*tiller_effect_(?!kind_count)\w+|tiller_effect_(?!kind_count)\w+\s*[!=]=|"
                         r"case tiller_effect_(?!#)\w+")
    for name, text in sources("runtime", "tools"):
        found = list(pattern.finditer(text))
        if len(found) > KINDS_MAY.get(name, 0):
            yield f"{name}: asks for '{found[0].group()}'; ask for a role (effects/effect_roles.hpp)"


def lists_actuators(words):
    for name, text in sources("runtime/io", "sim", "tools"):
        if name in WORDS_MAY:
            continue
        own = [w for w in words if pathlib.Path(name).stem in (f"actuator_{w}", f"{w}_axis")]
        for word in set(words) - set(own):
            if re.search(rf'"{word}"|ActuatorKind::{word}\b', text):
                yield f"{name}: names the actuator {word}; ask its table (io/actuators.def) or a capability"


def named_effects():
    """Of effects.def those that have a name in physics: neither unnamed nor learnt."""
    count = 0
    for name, *_ in table("runtime/include/tiller/effects.def", "TILLER_EFFECT"):
        header = (ROOT / f"runtime/effects/{name}.hpp").read_text()
        count += not re.search(r"i\.(unnamed|learnt) = true", header)
    return count


def pages():
    for entry in DOCUMENTS:
        path = ROOT / entry
        for page in sorted(path.rglob("*.md")) if path.is_dir() else [path]:
            yield str(page.relative_to(ROOT)), page.read_text()


def wrong_counts(effects):
    for name, text in pages():
        for pattern in COUNTS:
            for match in re.finditer(pattern, text):
                if int(match.group(1)) != effects:
                    line = text.count("\n", 0, match.start()) + 1
                    yield f"{name}:{line}: '{match.group()}', but effects.def has {effects} with a name"


def missing_rows(actuators):
    page = (ROOT / "docs/guide/actuators.md").read_text()
    for name, _, first, last, protocol in actuators:
        row = f"| `{name}` | {protocol} | {first}..{last} |"
        if row not in page:
            yield f"docs/guide/actuators.md lacks the row {row}"


def main():
    actuators = table("runtime/io/actuators.def", "TILLER_ACTUATOR")
    words = [row[0] for row in actuators]
    effects = named_effects()
    found = [*asks_for_kinds(), *lists_actuators(words), *wrong_counts(effects), *missing_rows(actuators)]
    print("\n".join(found))
    print(f"{len(words)} actuators, {effects} named effects; {len(found)} wrong")
    # a table that is read as empty proves nothing
    return 1 if found or len(words) < 3 or effects < 20 else 0


if __name__ == "__main__":
    sys.exit(main())
