"""Recipes parse, and ask for nothing that the build does not have: parse_test.py ROOT WORK"""

import ast
import json
import pathlib
import re
import subprocess
import sys

ROOT, WORK = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
sys.path.insert(0, str(ROOT / "tools/dev"))

import release_facts  # noqa: E402
import release_recipes  # noqa: E402

VERSION = release_facts.version(ROOT)


def known_options():
    files = [ROOT / "CMakeLists.txt", *sorted((ROOT / "cmake").glob("*.cmake"))]
    text = "".join(path.read_text(encoding="utf-8") for path in files)
    return set(re.findall(r"^(?:option|set)\((TILLER_[A-Z_]+)", text, re.M))


def unknown_options(text):
    asked = set(re.findall(r"-D(TILLER_[A-Z_]+)=", text))
    return asked - known_options() - {"TILLER_BUILD_"}


def filled():
    WORK.mkdir(parents=True, exist_ok=True)
    archive = WORK / "archive.tar.gz"
    archive.write_bytes(b"an archive")
    release_recipes.write(ROOT, archive, "https://tiller.example/archive.tar.gz", WORK / "recipes")
    return WORK / "recipes"


def recipe_faults(recipes):
    import yaml
    for path in sorted(p for p in recipes.rglob("*") if p.is_file()):
        text = path.read_text(encoding="utf-8")
        left = re.findall(r"@[A-Z0-9]+@", text)
        if left or path.suffix == ".in":
            yield f"{path}: not filled in: {left}"
        for option in unknown_options(text):
            yield f"{path}: CMake has no option {option}"
    manifest = json.loads((recipes / "vcpkg/vcpkg.json").read_text(encoding="utf-8"))
    data = yaml.safe_load((recipes / "conan/conandata.yml").read_text(encoding="utf-8"))
    recipe = yaml.safe_load((recipes / "conda/recipe.yaml").read_text(encoding="utf-8"))
    stated = {"vcpkg.json": manifest["version"], "conandata.yml": next(iter(data["sources"])),
              "recipe.yaml": recipe["context"]["version"]}
    yield from (f"{name}: version {v}, not {VERSION}" for name, v in stated.items() if v != VERSION)
    if recipe["source"]["sha256"] != data["sources"][VERSION]["sha256"]:
        yield "conda and conan have different sums of one archive"
    conanfile = (recipes / "conan/conanfile.py").read_text(encoding="utf-8")
    ast.parse(conanfile)
    for part in re.findall(r'variables\["(TILLER_\w+)"\]', conanfile):
        if part not in known_options():
            yield f"conanfile.py: CMake has no option {part}"


def zephyr_faults():
    import yaml
    module = yaml.safe_load((ROOT / "zephyr/module.yml").read_text(encoding="utf-8"))
    for path in (f"{module['build']['cmake']}/CMakeLists.txt", module["build"]["kconfig"]):
        if not (ROOT / path).is_file():
            yield f"zephyr/module.yml: no file {path}"
    kconfig = (ROOT / "zephyr/Kconfig").read_text(encoding="utf-8")
    symbols = set(re.findall(r"^(?:menu)?config (\w+)", kconfig, re.M))
    text = (ROOT / "zephyr/CMakeLists.txt").read_text(encoding="utf-8")
    lists = re.search(r"foreach\(list ([A-Z ]+)\)", text).group(1).split()
    used = set(re.findall(r"CONFIG_(TILLER\w*?)(?:_\$\{list\})?[\")}]", text)) | {f"TILLER_{name}" for name in lists}
    yield from (f"zephyr/CMakeLists.txt: Kconfig has no {name}" for name in used - symbols)
    yield from (f"zephyr/Kconfig: nobody reads {name}" for name in symbols - used)
    for name in re.findall(r"set\((TILLER_[A-Z_]+) ", text):
        if name not in known_options():
            yield f"zephyr/CMakeLists.txt: CMake has no option {name}"


def platformio_faults():
    out = WORK / "library"
    subprocess.run([sys.executable, ROOT / "tools/packaging/recipes/platformio/pack.py", ROOT, out], check=True)
    manifest = json.loads((out / "library.json").read_text(encoding="utf-8"))
    if manifest["version"] != VERSION:
        yield f"library.json: version {manifest['version']}, not {VERSION}"
    sources = sorted((out / manifest["build"]["srcDir"]).glob("*.cpp"))
    for path in sources:
        name = re.findall(r'#include "([^"]+)"', path.read_text(encoding="utf-8"))[-1]
        if not (out / "runtime" / name).is_file():
            yield f"{path}: no {name} in runtime/"
    if len(sources) < 80 or not (out / "include/tiller/limits.h").is_file():
        yield f"the library has {len(sources)} sources"


def main():
    try:
        import yaml  # noqa: F401
    except ImportError:
        print("no yaml: ./dev setup installs it with mkdocs")
        return 77
    assert unknown_options("-DTILLER_NO_SUCH_THING=ON"), "the check does not see an option that is none"
    faults = [*recipe_faults(filled()), *zephyr_faults(), *platformio_faults()]
    print("\n".join(faults) if faults else "vcpkg, conan, conda, zephyr, platformio: parsed")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
