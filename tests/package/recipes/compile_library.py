"""A PlatformIO library compiled as its library.json says, without PlatformIO:

    compile_library.py LIBRARY OUT JOBS COMPILER_PREFIX [FLAGS...]

makes OUT/libtiller.a of src/, as its builder does: every file with the manifest's flags, -I include, and the board's.
"""

import concurrent.futures
import json
import pathlib
import shlex
import subprocess
import sys


def main(library, out, jobs, prefix, *board):
    library, out = pathlib.Path(library), pathlib.Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    build = json.loads((library / "library.json").read_text(encoding="utf-8"))["build"]
    flags = [w for flag in build["flags"] for w in shlex.split(flag)] + ["-I", build["includeDir"]]
    flags = [f for f in flags if f not in build["unflags"]]

    def compiled(source):
        made = out / (source.stem + ".o")
        compiler = "gcc" if source.suffix == ".c" else "g++"
        command = [f"{prefix}{compiler}", *flags, *board, "-c", str(source.relative_to(library)), "-o", str(made)]
        done = subprocess.run(command, cwd=library, capture_output=True, text=True, check=False)
        return made, done.returncode, done.stderr

    sources = sorted(p for p in (library / build["srcDir"]).iterdir() if p.suffix in (".c", ".cpp"))
    with concurrent.futures.ThreadPoolExecutor(int(jobs)) as pool:
        done = list(pool.map(compiled, sources))
    failed = [f"{made.stem}: {said}" for made, code, said in done if code != 0]
    if failed:
        sys.exit("\n".join(failed))
    archive = out / "libtiller.a"
    archive.unlink(missing_ok=True)
    subprocess.run([f"{prefix}ar", "rcs", str(archive), *(str(made) for made, _, _ in done)], check=True)
    print(f"{archive}: {len(done)} objects, {sum(bool(said) for _, _, said in done)} with warnings")


if __name__ == "__main__":
    main(*sys.argv[1:])
