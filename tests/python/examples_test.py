"""The examples run, each in a process of its own, and end where they say."""
import pathlib
import shutil
import subprocess
import sys

import pytest

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "examples/python"
COMPILED = {"own_model", "arm_from_urdf"}


@pytest.mark.parametrize("example", sorted(file.stem for file in FOLDER.glob("*.py")))
def test_example(example, tmp_path):
    if example in COMPILED and shutil.which("c++") is None:
        pytest.skip("no C++ compiler")
    done = subprocess.run([sys.executable, str(FOLDER / f"{example}.py")], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.strip()
