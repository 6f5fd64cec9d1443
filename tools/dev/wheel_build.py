"""Builds one wheel of the Python package with the interpreter that runs this: wheel_build.py OUT_FOLDER

    --architecture aarch64   for another processor: cross-compiled with cmake/toolchains, against --sysroot
    --sysroot FOLDER         that processor's libraries, unpacked by tools/dev/fetch_sysroot.sh
    --venv FOLDER            the Python environment whose liblcm and OSQP the build reads

What is compiled is kept in build/wheel/ARCHITECTURE: of another version of CPython, only the bindings are compiled.
"""
import argparse
import os
import pathlib
import platform
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]


def tag():
    return "cp311-cp311" if sys.version_info < (3, 12) else "cp312-abi3"


def environment(architecture):
    """Of the build: its tools first; the names that the wheel and its extension get on another processor."""
    env = dict(os.environ, PATH=f"{pathlib.Path(sys.executable).parent}:{os.environ['PATH']}")
    if architecture == platform.machine():
        return dict({"CC": "/usr/bin/cc", "CXX": "/usr/bin/c++"}, **env)
    env.pop("CC", None)
    env.pop("CXX", None)
    version = "".join(map(str, sys.version_info[:2]))
    return dict(env, _PYTHON_HOST_PLATFORM=f"linux-{architecture}",
                SETUPTOOLS_EXT_SUFFIX=f".cpython-{version}-{architecture}-linux-gnu.so")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--architecture", default=platform.machine())
    parser.add_argument("--sysroot", type=pathlib.Path)
    parser.add_argument("--venv", type=pathlib.Path, required=True)
    options = parser.parse_args()
    settings = [f"build-dir=build/wheel/{options.architecture}", f"cmake.define.TILLER_VENV={options.venv.resolve()}"]
    if options.architecture != platform.machine():
        # Headers of CPython are this machine's: both processors are little-endian with pointers of 64 bits.
        settings += [f"cmake.define.CMAKE_TOOLCHAIN_FILE={ROOT}/cmake/toolchains/{options.architecture}.cmake",
                     f"cmake.define.TILLER_SYSROOT={options.sysroot.resolve()}"]
    options.out.mkdir(parents=True, exist_ok=True)
    for old in options.out.glob(f"tiller-*-{tag()}-*{options.architecture}.whl"):
        old.unlink()
    command = [sys.executable, "-m", "pip", "wheel", "-v", str(ROOT), "--no-deps", "--no-build-isolation", "-w",
               str(options.out)]
    for setting in settings:
        command += ["-C", setting]
    sys.exit(subprocess.run(command, cwd=ROOT, env=environment(options.architecture), check=False).returncode)


if __name__ == "__main__":
    main()
