"""The core as a PlatformIO library, or for any build without CMake.

    pack.py ROOT OUT [--models pendulum] [--planners mppi,ilqr,policy] [--posteriors filter] [--limits STATES=12,...]
                     [--no-c-models]

CMake is asked, without compiling, which sources such a build has and with which definitions. OUT gets src/, a file for
each of them that sets these definitions and includes the source; runtime/, the sources; include/, the C interface, with
the limits of this build; library.json. One lane, no contraction: the same bits as on every other target.
"""

import argparse
import json
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

KEPT = {".hpp", ".h", ".cpp", ".c", ".def", ".inc"}
ROOMS = ("core", "scalar", "models", "networks", "effects", "costs", "rollout", "builtin", "posterior", "planners",
         "safety", "executive", "abi")
LIMITS = "STATES=12,JOINTS=6,INPUTS=4,PARAMS=24,EFFECTS=8,EFFECT_STATES=8,OUTPUTS=8"
INSIDE = re.compile(r'\s*#include "([^"]+)"[^\n]*\n?\s*')
SHARED = re.compile(r"TILLER_(MAX_[A-Z_]+|REPRODUCIBLE)=")  # of everybody who includes the headers


def configured(root, build, options):
    off = [f"-DTILLER_BUILD_{part}=OFF" for part in ("IO", "SIM", "TOOLS", "TESTS", "BENCHMARKS")]
    lists = [f"-DTILLER_{name.upper()}={getattr(options, name).replace(',', ';')}"
             for name in ("models", "planners", "posteriors", "limits")]
    command = ["cmake", "-S", root, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DTILLER_WITH_OSQP=OFF",
               "-DCMAKE_C_FLAGS_RELEASE=-Os -DNDEBUG", "-DCMAKE_CXX_FLAGS_RELEASE=-Os -DNDEBUG",
               "-DTILLER_KERNEL_OPTIMISATION=-Os",
               "-DTILLER_REPRODUCIBLE=ON", f"-DTILLER_C_MODELS={'OFF' if options.no_c_models else 'ON'}", *off, *lists]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"pack: CMake refuses these options:\n{done.stdout}{done.stderr}")
    return json.loads((build / "compile_commands.json").read_text(encoding="utf-8"))


def definitions(entry):
    words = shlex.split(entry["command"])
    return [w[2:] for w in words if w.startswith("-D") and w != "-DNDEBUG"]


def optimisation(entry):
    """What a source asks for beyond the board's own -Os, as a pragma."""
    last = [w for w in shlex.split(entry["command"]) if re.fullmatch(r"-O\w", w)][-1]
    return "" if last == "-Os" else f'#pragma GCC optimize("{last[1:]}")\n'


class Library:
    def __init__(self, root, build, out):
        self.root, self.build, self.out = root, build, out
        self.shared = set()

    def copy_sources(self):
        for room in ROOMS:
            folder = self.root / "runtime" / room
            for path in folder.rglob("*"):
                if path.suffix in KEPT:
                    self.put(path, self.out / "runtime" / path.relative_to(self.root / "runtime"))
        for path in (self.root / "runtime/include").rglob("*"):
            if path.suffix in KEPT:
                self.put(path, self.out / "include" / path.relative_to(self.root / "runtime/include"))
        for path in (self.build / "generated").glob("*/*/catalogue.hpp"):
            self.put(path, self.out / "runtime" / path.parent.name / path.name)

    @staticmethod
    def put(path, there):
        there.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, there)

    def name_of(self, path):
        """How a source of the tree is included; a generated one is copied first."""
        if path.is_relative_to(self.build):
            inside = INSIDE.fullmatch(path.read_text(encoding="utf-8"))
            if inside:  # a copy for one instruction set
                return self.name_of(pathlib.Path(inside.group(1)))
            self.put(path, self.out / "runtime/generated" / path.name)
            return f"generated/{path.name}"
        return str(path.relative_to(self.root / "runtime"))

    def add(self, entry):
        name = self.name_of(pathlib.Path(entry["file"]))
        own = []
        for definition in definitions(entry):
            if SHARED.match(definition):
                self.shared.add(definition)
            else:
                own.append(definition)
        lines = [f"#define {d.replace('=', ' ', 1) if '=' in d else d + ' 1'}\n" for d in own]
        there = self.out / "src" / name.replace("/", "_")
        there.parent.mkdir(exist_ok=True)
        if there.exists():
            sys.exit(f"pack: two sources are called {there.name}")
        there.write_text("".join(lines) + optimisation(entry) + f'#include "tiller/limits.h"\n#include "{name}"\n', encoding="utf-8")

    def fix_interface(self):
        """What the whole build shares stands in the header that every other includes."""
        lines = "".join(f"#ifndef {d.partition('=')[0]}\n#define {d.replace('=', ' ', 1)}\n#endif\n"
                        for d in sorted(self.shared))
        (self.out / "include/tiller/limits.h").write_text(
            f"/* limits of this build: see tools/packaging/recipes/platformio/pack.py */\n{lines}", encoding="utf-8")
        names = {d.partition("=")[0] for d in self.shared}
        for header in (self.out / "include/tiller").iterdir():
            text, guard = header.read_text(encoding="utf-8"), r"(#pragma once|#define TILLER_\w+_H_)\n"
            if header.name != "limits.h" and any(re.search(rf"# *if.*\b{name}\b", text) for name in names):
                if not re.search(guard, text):
                    sys.exit(f"pack: {header.name} has no guard to write behind")
                header.write_text(re.sub(guard, r'\1\n#include "tiller/limits.h"\n', text, count=1), encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--models", default="pendulum")
    parser.add_argument("--planners", default="mppi,ilqr,policy")
    parser.add_argument("--posteriors", default="filter")
    parser.add_argument("--limits", default=LIMITS)
    parser.add_argument("--no-c-models", action="store_true", help="models of C++ alone: 130 kB of flash less")
    options = parser.parse_args()
    root, out = options.root.resolve(), options.out.resolve()
    shutil.rmtree(out, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        build = pathlib.Path(folder).resolve()
        entries = configured(root, build, options)
        library = Library(root, build, out)
        library.copy_sources()
        for entry in entries:
            library.add(entry)
        library.fix_interface()
    manifest = root / "tools/packaging/recipes/platformio/library.json.in"
    version = re.search(r"project\(tiller VERSION (\S+)", (root / "CMakeLists.txt").read_text(encoding="utf-8")).group(1)
    (out / "library.json").write_text(manifest.read_text(encoding="utf-8").replace("@VERSION@", version), encoding="utf-8")
    shutil.copy(root / "LICENSE", out)
    library.put(root / "examples/minimal.c", out / "examples/minimal/main.c")
    print(f"{out}: {len(entries)} sources")


if __name__ == "__main__":
    main()
