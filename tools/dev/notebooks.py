"""Examples as notebooks: a script whose docstring is Markdown and whose cells begin with `# %%`.

    notebooks.py pictures OUT [NAME ...]   runs the examples, with the package `tiller`; their pictures into OUT
    notebooks.py notebooks OUT             the examples as .ipynb, for Jupyter

`# %% A sentence` gives a cell a sentence of Markdown above it. An example's last cell defines picture(), whose figure
the gallery of the site shows.
"""
import argparse
import ast
import contextlib
import io
import json
import pathlib
import re
import runpy
import sys

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples/python"


def cells(text):
    """[("markdown" or "code", text)] of an example."""
    docstring = ast.parse(text).body[0]
    rest = "\n".join(text.splitlines()[docstring.end_lineno:])
    found = [("markdown", ast.get_docstring(ast.parse(text)))]
    for part in re.split(r"^# %%", rest, flags=re.M):
        sentence, _, code = part.partition("\n")
        if sentence.strip():
            found.append(("markdown", sentence.strip()))
        if code.strip():
            found.append(("code", code.strip("\n")))
    return found


def title(text):
    return re.match(r"# (.*)", ast.get_docstring(ast.parse(text)))[1]


def notebook(text):
    """The document of a .ipynb; the last cell shows the picture."""
    parts = [*cells(text), ("code", "picture()")]
    return {"cells": [{"cell_type": kind, "id": f"cell-{k}", "metadata": {}, "source": part.splitlines(keepends=True),
                       **({"execution_count": None, "outputs": []} if kind == "code" else {})}
                      for k, (kind, part) in enumerate(parts)],
            "metadata": {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}},
            "nbformat": 4, "nbformat_minor": 5}


def examples(names=()):
    found = sorted(EXAMPLES.glob("*.py"))
    unknown = set(names) - {path.stem for path in found}
    if unknown:
        sys.exit(f"notebooks: no example {', '.join(sorted(unknown))}; there are: {', '.join(p.stem for p in found)}")
    return [path for path in found if not names or path.stem in names]


def write_pictures(out, names):
    for path in examples(names):
        print(f"{path.stem} ...", flush=True)
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            figure = runpy.run_path(str(path))["picture"]()
        figure.savefig(out / f"{path.stem}.png", dpi=100, metadata={"Software": None})
        print(said.getvalue().rstrip())


def write_notebooks(out):
    for path in examples():
        document = json.dumps(notebook(path.read_text(encoding="utf-8")), indent=1)
        (out / f"{path.stem}.ipynb").write_text(document + "\n", encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["pictures", "notebooks"])
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("names", nargs="*")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.what == "pictures":
        write_pictures(options.out, options.names)
    else:
        write_notebooks(options.out)


if __name__ == "__main__":
    main()
