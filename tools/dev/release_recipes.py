"""Recipes of package managers for one source archive: those of tools/packaging/recipes, with its version and sums.

    release_recipes.py ROOT ARCHIVE URL OUT
"""

import hashlib
import pathlib
import re
import shutil
import sys

import release_facts

FOLDERS = ("vcpkg", "conan", "conda")  # PlatformIO's library and Zephyr's module are the sources themselves


def fill(text, values):
    filled = re.sub(r"@([A-Z0-9]+)@", lambda m: values[m[1]], text)
    return filled


def write(root, archive, url, out):
    data = archive.read_bytes()
    values = {"VERSION": release_facts.version(root), "URL": url, "SHA256": hashlib.sha256(data).hexdigest(),
              "SHA512": hashlib.sha512(data).hexdigest()}
    shutil.rmtree(out, ignore_errors=True)
    for folder in FOLDERS:
        shutil.copytree(root / "tools/packaging/recipes" / folder, out / folder,
                        ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(root / "examples/minimal.c", out / "conan/test_package")
    for path in sorted(out.rglob("*.in")):
        path.with_suffix("").write_text(fill(path.read_text(encoding="utf-8"), values), encoding="utf-8")
        path.unlink()


def main(root, archive, url, out):
    write(pathlib.Path(root).resolve(), pathlib.Path(archive), url, pathlib.Path(out))


if __name__ == "__main__":
    main(*sys.argv[1:])
