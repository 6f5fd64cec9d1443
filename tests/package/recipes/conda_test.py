"""The conda recipe, rendered as conda-forge would and built by rattler-build without a channel:

    conda_test.py RECIPES WORK

Its requirements are rendered with conda-forge's variants. The build itself has this machine's compilers, CMake and
xsimd in their place, since not every machine reaches conda's channels, and one model, for time.
"""

import json
import os
import pathlib
import shutil
import sys

LIMITS = "-DTILLER_MODELS=pendulum -DTILLER_PLANNERS=mppi -DTILLER_POSTERIORS=filter -DTILLER_ISA_ONLY=sse2"
VARIANTS = {"c_compiler": ["gcc"], "cxx_compiler": ["gxx"], "c_stdlib": ["sysroot"], "c_stdlib_version": ["2.28"]}
HERE = ("cmake", "ninja", "g++", "gcc", "cc", "c++")


def empty_channel(folder):
    for name in ("noarch", "linux-64", "linux-aarch64"):
        (folder / name).mkdir(parents=True)
        (folder / name / "repodata.json").write_text(json.dumps(
            {"info": {"subdir": name}, "packages": {}, "packages.conda": {}, "repodata_version": 1}))
    return folder.as_uri()


def main(recipes, work):
    try:
        import rattler_build
        import yaml
    except ImportError as missing:
        print(f"{missing}: pip install -r tools/dev/requirements_recipes.txt")
        return 77
    recipe, work = pathlib.Path(recipes) / "conda/recipe.yaml", pathlib.Path(work).resolve()
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    rendered = rattler_build.Stage0Recipe.from_file(str(recipe)).render(rattler_build.VariantConfig(VARIANTS))
    assert len(rendered) == 1, rendered

    here = yaml.safe_load(recipe.read_text(encoding="utf-8"))
    here["requirements"] = {}
    path = os.pathsep.join(sorted({str(pathlib.Path(shutil.which(p)).parent) for p in HERE}))
    here["build"]["script"] = {"content": here["build"]["script"], "env": {"TILLER_CMAKE_ARGS": LIMITS, "PATH": path}}
    mine = work / "recipe.yaml"
    mine.write_text(yaml.safe_dump(here, sort_keys=False), encoding="utf-8")
    rattler_build.build_recipes([mine], channel=[empty_channel(work / "channel")], output_dir=work / "output",
                                test="native")
    made = [p for p in (work / "output").rglob("libtiller-*.conda")]
    print("\n".join(f"{p.name}: {p.stat().st_size / 1e6:.1f} MB" for p in made))
    return 0 if len(made) == 1 else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
