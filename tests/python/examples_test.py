"""The examples run, each in a process of its own, as a script and as the notebook that is made of it; their pictures
are drawn."""
import json
import pathlib
import shutil
import subprocess
import sys

import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
FOLDER = TOP / "examples/python"
COMPILED = {"own_model", "arm_from_urdf"}
EXAMPLES = sorted(file.stem for file in FOLDER.glob("*.py"))
# what Jupyter does, less its window: cell after cell in one namespace, which has no __file__
RUN_CELLS = """
import json, sys
space = {"__name__": "__main__"}
for cell in json.load(open(sys.argv[1], encoding="utf-8"))["cells"]:
    if cell["cell_type"] == "code":
        exec(compile("".join(cell["source"]), "cell", "exec"), space)
if sys.argv[2]:
    space["picture"]().savefig(sys.argv[2])
"""


def has_matplotlib():
    return subprocess.run([sys.executable, "-c", "import matplotlib"], capture_output=True).returncode == 0


def run(command, folder):
    done = subprocess.run([sys.executable, *map(str, command)], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.strip()


def needs_compiler(example):
    if example in COMPILED and shutil.which("c++") is None:
        pytest.skip("no C++ compiler")


@pytest.mark.parametrize("example", EXAMPLES)
def test_example(example, tmp_path):
    needs_compiler(example)
    run([FOLDER / f"{example}.py"], tmp_path)


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_as_a_notebook(example, tmp_path):
    needs_compiler(example)
    subprocess.run([sys.executable, str(TOP / "tools/dev/notebooks.py"), "notebooks", str(tmp_path)], check=True)
    notebook, picture = tmp_path / f"{example}.ipynb", tmp_path / "picture.png"
    document = json.loads(notebook.read_text(encoding="utf-8"))
    kinds = [cell["cell_type"] for cell in document["cells"]]
    assert kinds[0] == "markdown" and kinds.count("code") >= 3 and document["nbformat"] == 4
    document["cells"].pop()  # picture(), which matplotlib may be missing for
    notebook.write_text(json.dumps(document), encoding="utf-8")
    run(["-c", RUN_CELLS, notebook, picture if has_matplotlib() else ""], TOP)
    if has_matplotlib():
        assert picture.read_bytes()[:4] == b"\x89PNG" and picture.stat().st_size > 10000
