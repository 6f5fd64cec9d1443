"""Tests a wheel for another processor under qemu-user: wheel_emulated.py WHEEL SYSROOT FOLDER

SYSROOT holds an interpreter of that processor (tools/dev/fetch_sysroot.sh). FOLDER becomes its environment: the wheel,
numpy, and pytest, fetched for that processor. Exits with pytest's code.

Tests that want what the emulated environment lacks (mypy, gymnasium) skip themselves. Programs of this machine are
started as on the processor itself: a script starts the interpreter, the cross compiler compiles models.
"""
import argparse
import os
import pathlib
import re
import shutil
import stat
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
TESTS = ["controller_test.py", "robot_test.py", "rollout_test.py", "package_test.py"]


def architecture_of(wheel):
    return re.search(r"_(aarch64|armv7l|x86_64)\.whl$", wheel.name).group(1)


def emulated_python(sysroot, architecture):
    """(A program of this machine that runs the sysroot's interpreter, that interpreter's version)

    It lies beside the interpreter and gives its own name as the interpreter's: CPython finds its library from there,
    and processes that tests start with sys.executable are emulated in turn.
    """
    real = (sysroot / "usr/bin/python3").resolve()
    script = sysroot / "usr/bin/python-emulated"
    script.write_text(f'#!/bin/sh\nexec qemu-{architecture} -0 "$0" -L {sysroot} {real} "$@"\n', encoding="utf-8")
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    return script, re.search(r"python(3\.\d+)$", real.name).group(1)


def install(wheel, folder, version, architecture):
    shutil.rmtree(folder, ignore_errors=True)
    platforms = [f"--platform=manylinux_2_{glibc}_{architecture}" for glibc in range(17, 43)]
    subprocess.run([sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--target",
                    str(folder), "--only-binary=:all:", "--python-version", version, "--implementation", "cp",
                    *platforms, str(wheel), "pytest"], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=pathlib.Path)
    parser.add_argument("sysroot", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    options = parser.parse_args()
    architecture = architecture_of(options.wheel)
    python, version = emulated_python(options.sysroot.resolve(), architecture)
    install(options.wheel.resolve(), options.folder, version, architecture)
    env = dict(os.environ, PYTHONPATH=str(options.folder.resolve()), PYTHONDONTWRITEBYTECODE="1",
               TILLER_CXX=f"{architecture}-linux-gnu-g++")
    env.pop("TILLER_C_LOOP", None)
    tests = [str(ROOT / "tests/python" / name) for name in TESTS]
    sys.exit(subprocess.run([str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests],
                            cwd=options.folder, env=env, check=False).returncode)


if __name__ == "__main__":
    main()
