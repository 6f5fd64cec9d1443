"""How a laboratory is started: help without JAX, what is missing told, one list of packages, one list of names."""
import os
import pathlib
import re
import subprocess
import sys
import tomllib

import pytest

from tiller.labs import _install
from tiller.labs.__main__ import LABORATORIES

ROOT = pathlib.Path(__file__).resolve().parents[2]
# An interpreter without what the laboratories import: none of its finders knows the names.
BLOCKER = f"""
import sys
class Without:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, path=None, target=None):
        return None if name.split(".")[0] in {tuple(_install.REQUIRES)} else self.finder.find_spec(name, path, target)
sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]
"""


def without_jax(folder, *arguments, **environment):
    (folder / "sitecustomize.py").write_text(BLOCKER, encoding="utf-8")
    paths = os.pathsep.join((str(folder), os.environ["PYTHONPATH"]))
    return subprocess.run([sys.executable, "-m", "tiller.labs", *arguments], capture_output=True, text=True,
                          timeout=300, env=dict(os.environ, PYTHONPATH=paths, **environment))


def test_names_are_those_of_the_command():
    text = (ROOT / "tools/cli/laboratories.cpp").read_text(encoding="utf-8")
    assert dict(re.findall(r'^    \{"(\w+)",\s*"([^"]+)"\}', text, re.MULTILINE)) == LABORATORIES


def test_packages_are_those_of_the_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert list(_install.REQUIRES.values()) == project["project"]["optional-dependencies"]["labs"]


@pytest.mark.parametrize("name", LABORATORIES)
def test_help_needs_no_jax(tmp_path, name):
    ended = without_jax(tmp_path, name, "--help", TILLER_LABS_INSTALL="0")
    assert ended.returncode == 0 and f"usage: tiller {name}" in ended.stdout and "Examples:" in ended.stdout


@pytest.mark.parametrize("arguments", [["infer", "box.toml", "run.csv"]])
def test_what_is_missing_is_told(tmp_path, arguments):
    ended = without_jax(tmp_path, *arguments, TILLER_LABS_INSTALL="0")
    assert ended.returncode == 1 and "pip install \"tiller[labs]\"" in ended.stderr, ended.stderr


def test_what_is_installed_is_told_first(tmp_path):
    """With an index that has nothing, the installation fails, is not taken for done, and the remedy is told."""
    data = tmp_path / "data"
    ended = without_jax(tmp_path, "infer", "box.toml", "run.csv", TILLER_LABS_INSTALL="1", PIP_NO_INDEX="1",
                        PIP_FIND_LINKS=str(tmp_path), XDG_DATA_HOME=str(data))
    place = data / "tiller" / f"labs-{sys.version_info.major}.{sys.version_info.minor}"
    assert ended.returncode == 1 and str(place) in ended.stderr and "pip install" in ended.stderr, ended.stderr
    assert place.is_dir() and not (place / "complete").exists()


def test_a_wrong_option_ends_with_1(tmp_path):
    ended = subprocess.run([sys.executable, "-m", "tiller.labs", "infer", "--simulations", "5", "a", "b"],
                           capture_output=True, text=True, timeout=300)
    assert ended.returncode == 1 and "--simulations" in ended.stderr


COMPILES = """
from tiller.labs import _compiled
_compiled.SMALLEST["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
_compiled.MOST_BYTES = %d
_compiled.keep()
import jax
print(float(jax.jit(lambda x: jax.numpy.sin(x) @ x)(jax.numpy.ones(7))))
"""


def compiles(cache, most_bytes=200_000_000):
    kept = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    ended = subprocess.run([sys.executable, "-c", COMPILES % most_bytes], capture_output=True, text=True, timeout=300,
                           env=dict(kept, XDG_CACHE_HOME=str(cache)))
    assert ended.returncode == 0, ended.stderr
    assert abs(float(ended.stdout) - 5.8903) < 1e-4
    return sorted(p for p in cache.rglob("*-cache") if p.is_file())


def test_what_was_compiled_is_kept_and_may_be_lost(tmp_path):
    pytest.importorskip("jax")
    first = compiles(tmp_path)
    assert first
    written = [p.stat().st_mtime_ns for p in first]
    assert compiles(tmp_path) == first and [p.stat().st_mtime_ns for p in first] == written
    for path in first:
        path.write_bytes(b"cut")
    assert compiles(tmp_path) == first  # a broken entry is compiled anew
    (first[0].parent / "old-cache").write_bytes(b"x" * 100)
    assert first[0].parent / "old-cache" not in compiles(tmp_path, 50)  # room is made
    (tmp_path / "file").write_text("")
    compiles(tmp_path / "file")  # nowhere to keep it
