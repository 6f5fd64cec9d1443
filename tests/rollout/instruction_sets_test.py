#!/usr/bin/env python3
"""No instruction of a newer processor outside of the copies that are compiled for it.

    instruction_sets_test.py ARCHIVE_OR_FOLDER...

Every object of the archives is disassembled. A source's copy is known by its name (kernel_pendulum_avx2.cpp.o); what is
no copy belongs to the baseline of x86-64. A copy's weak functions have to stand in the copy's namespace: of two equal
names the linker keeps one for everybody. Emulated processors (run_on_cpu.sh) show the same for what a program happens
to execute.
"""
import pathlib
import re
import subprocess
import sys

MASKS_OR_UPPER_REGISTERS = re.compile(r"%zmm|%k[0-7]\b|%[xy]mm(1[6-9]|2\d|3[01])\b|\{1to\d+\}")
VEX = re.compile(r"^v(?!err\b|erw\b|mcall|mm|mlaunch|mresume)[a-z]")
COPY = re.compile(r"_(sse2|avx2|avx512)\.cpp\.o")
INSTRUCTION = re.compile(r"^\s+[0-9a-f]+:\t(?:(?:lock|rep[nz]*|data16|cs|bnd) )*(\S+)(.*)")
WEAK_FUNCTION = re.compile(r"^[0-9a-f]+\s+\s?w.*\sF\s+\S+\s+[0-9a-f]+\s+(?:\.hidden\s+)?(\S+)$")


def newest(mnemonic, operands):
    """The instruction set, as a copy's name, that an instruction needs."""
    if MASKS_OR_UPPER_REGISTERS.search(operands):
        return "avx512"
    return "avx2" if VEX.match(mnemonic) else "sse2"


def allowed(copy):
    return {"sse2": ["sse2"], "avx2": ["sse2", "avx2"], "avx512": ["sse2", "avx2", "avx512"]}[copy]


def leaks(copy, disassembly):
    """The first instruction of an object that its copy may not have, else None."""
    for line in disassembly:
        found = INSTRUCTION.match(line)
        if found and newest(*found.groups()) not in allowed(copy):
            return line.strip()
    return None


def shared_functions(copy, symbols):
    """Weak functions of a copy whose names other copies may define too. xsimd's carry the instruction set as a type."""
    own = re.compile(rf"\d{copy}")
    return [found.group(1) for found in map(WEAK_FUNCTION.match, symbols) if found and not own.search(found.group(1))]


def members(archive, option):
    """(name, lines) of each object of an archive, by objdump."""
    text = subprocess.run(["objdump", option, "--no-show-raw-insn", str(archive)], check=True, capture_output=True,
                          text=True, encoding="latin-1").stdout
    parts = re.split(r"^(\S+):     file format .*$", text, flags=re.MULTILINE)
    return [(name, body.splitlines()) for name, body in zip(parts[1::2], parts[2::2])]


def check_archive(archive):
    """(objects, problems)"""
    problems, count = [], 0
    for name, disassembly in members(archive, "-d"):
        copy, count = COPY.search(name), count + 1
        leak = leaks(copy.group(1) if copy else "sse2", disassembly)
        if leak:
            problems.append(f"{name}: {leak}: not an instruction of {copy.group(1) if copy else 'the baseline'}")
    for name, symbols in members(archive, "-t"):
        copy = COPY.search(name)
        if copy and copy.group(1) != "sse2":
            problems += [f"{name}: {function} is weak and not in the namespace {copy.group(1)}"
                         for function in shared_functions(copy.group(1), symbols)]
    return count, problems


def check_itself():
    """The rules find what they are there for."""
    assert leaks("sse2", ["  4:\tvaddps %xmm1,%xmm2,%xmm3"]) and leaks("avx2", ["  4:\tvaddps %zmm1,%zmm2,%zmm3"])
    assert leaks("avx2", ["  4:\tvcmpps $0x1,%ymm1,%ymm2,%k1"]) and leaks("avx2", ["  4:\tvmovaps %ymm17,%ymm0"])
    assert not leaks("avx512", ["  4:\tvaddps %zmm1,%zmm2,%zmm3"])
    assert not leaks("avx2", ["  4:\tvaddps %ymm1,%ymm2,%ymm3"])
    assert not leaks("sse2", ["  4:\taddps  %xmm1,%xmm2", "  8:\tlock xadd %eax,(%rdx)", "0000 <vfunction>:"])
    weak = "0000000000000000  w    F .text._ZN3foo\t0000000000000012 {}"
    assert shared_functions("avx2", [weak.format("_ZN6tiller3fooEv")]) == ["_ZN6tiller3fooEv"]
    assert shared_functions("avx512", [weak.format("_ZN5xsimd3expINS_4avx2EEEvv")])
    assert not shared_functions("avx2", [weak.format("_ZN6tiller4avx23fooEv")])
    assert not shared_functions("avx2", [weak.format("_ZN5xsimd3expINS_4avx2EEEvv")])


def main(arguments):
    if not arguments or arguments[0] in ("-h", "--help"):
        sys.exit(__doc__.strip())
    check_itself()
    archives = sorted(a for name in arguments for a in
                      ([pathlib.Path(name)] if name.endswith(".a") else pathlib.Path(name).rglob("*.a")))
    objects, problems = 0, []
    for archive in archives:
        count, found = check_archive(archive)
        objects, problems = objects + count, problems + [f"{archive.name}: {p}" for p in found]
    print(f"{objects} objects of {len(archives)} archives, {len(problems)} problems", *problems, sep="\n")
    return 1 if problems or objects == 0 else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
