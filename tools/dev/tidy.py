"""tidy.py BUILD_FOLDER JOBS LOG [PATTERN...]: clang-tidy on the sources of a build whose paths match a pattern.

Prints a line for each file that is done, and each finding once at the end; the log has their context. A file without
findings is not looked at again until what the compiler reads of it, its flags, .clang-tidy or clang-tidy change.
"""
import concurrent.futures
import hashlib
import json
import pathlib
import re
import shlex
import subprocess
import sys
import time

FINDING = re.compile(r"^(/\S+?):(\d+):\d+: (?:warning|error): ")


def key_of(entry, words, about):
    """What the result depends on: the text with its comments, since NOLINT is one."""
    text = subprocess.run([*words, "-E", "-C"], cwd=entry["directory"], capture_output=True, check=False)
    command = " ".join(words).encode()
    return hashlib.sha256(about + command + text.stdout).hexdigest() if text.returncode == 0 else None


def compiler_words(entry):
    words = shlex.split(entry["command"])
    if "ccache" in words[0]:
        words = words[1:]
    while "-o" in words:
        at = words.index("-o")
        del words[at:at + 2]
    return [word for word in words if word != "-c"]


def check(entry, build, about):
    started = time.monotonic()
    key = key_of(entry, compiler_words(entry), about)
    clean = build / "tidy" / (key or "none")
    if key and clean.exists():
        return entry["file"], 0.0, "", True
    # some flags are gcc's alone
    run = subprocess.run(["clang-tidy", "-quiet", "-p", str(build), "-extra-arg=-Wno-unknown-warning-option",
                          entry["file"]], capture_output=True, text=True, check=False)
    good = run.returncode == 0
    if good and key:
        clean.touch()
    return entry["file"], time.monotonic() - started, run.stdout + ("" if good else run.stderr), good


def main():
    build, jobs, log = pathlib.Path(sys.argv[1]).resolve(), int(sys.argv[2]), pathlib.Path(sys.argv[3])
    patterns = [re.compile(pattern) for pattern in sys.argv[4:]]
    database = json.loads((build / "compile_commands.json").read_text())
    chosen = {}
    for entry in database:
        if any(pattern.search(entry["file"]) for pattern in patterns):
            chosen.setdefault(entry["file"], entry)
    if not chosen:
        sys.exit("no source of this build matches")
    (build / "tidy").mkdir(exist_ok=True)
    about = pathlib.Path(".clang-tidy").read_bytes()
    about += subprocess.run(["clang-tidy", "--version"], capture_output=True, check=True).stdout
    # the longest first: kernels
    entries = sorted(chosen.values(), key=lambda entry: (str(build) not in entry["file"], entry["file"]))
    findings, failed, done, root = {}, 0, 0, pathlib.Path.cwd()
    with open(log, "w") as file, concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for future in concurrent.futures.as_completed([pool.submit(check, e, build, about) for e in entries]):
            name, seconds, output, good = future.result()
            done += 1
            failed += not good
            for line in output.splitlines():
                if FINDING.match(line):
                    findings.setdefault(line)
            file.write(f"=== {name}\n{output}")
            file.flush()
            short = pathlib.Path(name).relative_to(root) if name.startswith(str(root)) else name
            print(f"[{done}/{len(entries)}] {short} {seconds:.1f} s{'' if good else '  FINDINGS'}", flush=True)
    for line in sorted(findings):
        print(line.replace(f"{root}/", ""), file=sys.stderr)
    if failed:
        sys.exit(f"{failed} files with findings, {len(findings)} findings; the context is in {log}")


main()
