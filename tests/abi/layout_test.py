"""layout_test.py SOURCE RECORDED: the C ABI is what the record says, or its version has moved.

The compiler is asked, through its debugging information, for every struct and enumeration of tiller/tiller.h: sizes,
offsets, types, values; the header itself for its functions. A program that was compiled against an older header and
runs with a newer library is safe only where none of this has changed. What has changed needs another
TILLER_CONFIG_VERSION, since tiller_init() refuses configurations of another version; then the record is written again:

    TILLER_APPROVE=1 ctest -R '^abi_layout$'
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile

from elftools.elf.elffile import ELFFile

SOURCE, RECORDED = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
HEADER = SOURCE / "runtime/include/tiller/tiller.h"


def debugging_information():
    """The compilation unit of a file that holds the header and nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        made = pathlib.Path(folder) / "header.o"
        subprocess.run([os.environ.get("CC", "cc"), "-std=c99", "-g", "-fno-eliminate-unused-debug-types", "-x", "c",
                        f"-I{SOURCE / 'runtime/include'}", "-c", "-", "-o", str(made)],
                       input="#include <tiller/tiller.h>\n", text=True, check=True)
        with open(made, "rb") as file:
            unit = next(ELFFile(file).get_dwarf_info().iter_CUs())
            yield from list(unit.iter_DIEs())


def name_of(die):
    return die.attributes["DW_AT_name"].value.decode() if "DW_AT_name" in die.attributes else ""


def type_of(die):
    return die.get_DIE_from_attribute("DW_AT_type") if "DW_AT_type" in die.attributes else None


def type_text(die):
    """The type as C has it, near enough to tell two apart."""
    if die is None:
        return "void"
    tag = die.tag.removeprefix("DW_TAG_")
    if tag == "pointer_type":
        return type_text(type_of(die)) + "*"
    if tag == "const_type":
        return "const " + type_text(type_of(die))
    if tag == "array_type":
        sizes = "".join(f"[{child.attributes['DW_AT_upper_bound'].value + 1}]" for child in die.iter_children())
        return type_text(type_of(die)) + sizes
    if tag == "subroutine_type":
        return f"{type_text(type_of(die))}({', '.join(type_text(type_of(c)) for c in die.iter_children())})"
    return name_of(die) or tag


def members(die):
    return [f"  {m.attributes['DW_AT_data_member_location'].value:6d} {type_text(type_of(m))} {name_of(m)}"
            for m in die.iter_children() if m.tag == "DW_TAG_member"]


def values(die):
    return [f"  {v.attributes['DW_AT_const_value'].value:6d} {name_of(v)}" for v in die.iter_children()]


def layout():
    lines = {}
    for die in debugging_information():
        if die.tag != "DW_TAG_typedef" or not name_of(die).startswith("tiller_"):
            continue
        what = type_of(die)
        if what is None or "DW_AT_byte_size" not in what.attributes:
            continue
        inside = {"DW_TAG_structure_type": members, "DW_TAG_enumeration_type": values}.get(what.tag)
        if inside:
            lines[name_of(die)] = [f"{name_of(die)}: {what.attributes['DW_AT_byte_size'].value} bytes", *inside(what)]
    text = re.sub(r"/\*.*?\*/", "", HEADER.read_text(encoding="utf-8"), flags=re.DOTALL)
    functions = re.findall(r"^[a-z][\w \*]*?(tiller_\w+\([^;{}]*\))[^;{}]*;", text, flags=re.MULTILINE)
    calls = sorted(" ".join(f.split()) for f in functions if not f.startswith("tiller_assert"))
    return [line for name in sorted(lines) for line in lines[name]] + ["functions:"] + ["  " + call for call in calls]


def version():
    return re.search(r"#define TILLER_CONFIG_VERSION\s+(\d+)", HEADER.read_text(encoding="utf-8")).group(1)


def main():
    now = [f"TILLER_CONFIG_VERSION {version()}", *layout()]
    assert len(now) > 200 and any("tiller_tick(" in line for line in now), "the header was not understood"
    if os.environ.get("TILLER_APPROVE"):
        RECORDED.write_text("\n".join(now) + "\n", encoding="utf-8")
        return 0
    recorded = RECORDED.read_text(encoding="utf-8").splitlines()
    if now == recorded:
        return 0
    for sign, lines, others in (("+", now, recorded), ("-", recorded, now)):
        for line in lines:
            if line not in others:
                print(sign, line)
    if now[0] == recorded[0]:
        print(f"{HEADER}: the layout has changed and TILLER_CONFIG_VERSION has not; raise it, or undo the change")
    print("then write the record again: TILLER_APPROVE=1 ctest -R '^abi_layout$'")
    return 1


if __name__ == "__main__":
    sys.exit(main())
