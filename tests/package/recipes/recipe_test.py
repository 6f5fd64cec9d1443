"""One recipe, built as far as this machine can: recipe_test.py ROOT WORK conan|conda|vcpkg

The source archive is git's of the last commit, as ./dev release makes it; recipes are filled in for it.
"""

import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = pathlib.Path(sys.argv[1]).resolve()
sys.path.insert(0, str(ROOT / "tools/dev"))

import release  # noqa: E402
import release_recipes  # noqa: E402

ONE = {"models": "pendulum", "planners": "mppi,ilqr", "posteriors": "filter", "isa": "sse2", "with_shared": "True"}


def xsimd_version():
    done = subprocess.run(["pkg-config", "--modversion", "xsimd"], capture_output=True, text=True, check=False)
    return done.stdout.strip() or "8.1.0"


def conan(recipes, work):
    """conan create, with xsimd and compilers of this machine: no remote is asked."""
    program = pathlib.Path(sys.executable).parent / "conan"
    if not program.exists():
        print("no conan: pip install -r tools/dev/requirements_recipes.txt")
        return 77
    environment = {"CONAN_HOME": str(work / "home"), "PATH": f"{program.parent}:/usr/local/bin:/usr/bin:/bin"}
    subprocess.run([program, "profile", "detect"], env=environment, check=True)
    profile = work / "profile"
    profile.write_text(f"include(default)\n[platform_requires]\nxsimd/{xsimd_version()}\n", encoding="utf-8")
    options = [word for name, value in ONE.items() for word in ("-o", f"&:{name}={value}")]
    done = subprocess.run([program, "create", recipes / "conan", "--version", release.release_facts.version(ROOT),
                           "--profile:all", profile, "--no-remote", "-s", "compiler.cppstd=17", *options],
                          env=environment, check=False)
    return done.returncode


def conda(recipes, work):
    return subprocess.run([sys.executable, HERE / "conda_test.py", recipes, work / "conda"], check=False).returncode


def vcpkg(recipes, work):
    return subprocess.run(["cmake", "-D", f"RECIPES={recipes}", "-D", f"WORK={work / 'vcpkg'}", "-D",
                           f"CONSUMER={ROOT / 'tests/package/consumer'}", "-P", HERE / "vcpkg_test.cmake"],
                          check=False).returncode


def main(work, kind):
    work = pathlib.Path(work).resolve()
    shutil.rmtree(work, ignore_errors=True)
    release.source(ROOT, work)
    archive = release.archive_of(ROOT, work)
    release_recipes.write(ROOT, archive, archive.as_uri(), work / "recipes")
    return {"conan": conan, "conda": conda, "vcpkg": vcpkg}[kind](work / "recipes", work)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[2:4]))
