"""What the drivers of the benchmarks share: environments of the peers, programs that take turns, rows with goals."""

import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
BENCH = ROOT / "bench"
PEERS = BENCH / "peers"
HOME = ROOT / "build/bench_peers"
CORE = max(os.sched_getaffinity(0))
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def note(text):
    print(f"{pathlib.Path(sys.argv[0]).stem}: {text}", file=sys.stderr, flush=True)


# ---- environments of the peers ---------------------------------------------------------------------


def python_of(name):
    return HOME / name / "bin/python"


def site_packages(name):
    return next((HOME / name / "lib").glob("python3*/site-packages"))


def need_environment(name, *how):
    """True if the peers of that name are there; makes their environment otherwise, with pip's options `how`."""
    wanted = (PEERS / f"requirements_{name}.txt").read_text(encoding="utf-8")
    stamp = HOME / name / "requirements.txt"
    if stamp.exists() and stamp.read_text(encoding="utf-8") == wanted:
        return True
    note(f"installing the peers '{name}' into {HOME.relative_to(ROOT) / name} (once)")
    HOME.mkdir(parents=True, exist_ok=True)
    with open(HOME / f"{name}.log", "w", encoding="utf-8") as log:
        run = lambda *command: subprocess.run(command, stdout=log, stderr=log, check=False).returncode == 0
        done = run(sys.executable, "-m", "venv", "--clear", str(HOME / name)) and run(
            str(python_of(name)), "-m", "pip", "install", "--disable-pip-version-check", "--prefer-binary", *how,
            "-r", str(PEERS / f"requirements_{name}.txt"))
    if done:
        stamp.write_text(wanted, encoding="utf-8")
    else:
        note(f"they do not install here; see {(HOME / name).relative_to(ROOT)}.log")
    return done


# ---- programs --------------------------------------------------------------------------------------


def compile_peer(name, sources, flags):
    """The path of the program that is built from peers/NAME.cpp and the sources, or None."""
    program = HOME / "bin" / name
    inputs = [PEERS / f"{name}.cpp", *BENCH.glob("problems/*.hpp"), *BENCH.glob("table/*.hpp")]
    if program.exists() and all(program.stat().st_mtime > i.stat().st_mtime for i in inputs):
        return program
    program.parent.mkdir(parents=True, exist_ok=True)
    note(f"building {name}")
    command = ["c++", "-std=c++17", "-O3", "-DNDEBUG", "-w", f"-I{ROOT}", str(PEERS / f"{name}.cpp"),
               *map(str, sources), *flags, "-o", str(program)]
    with open(HOME / f"{name}.log", "w", encoding="utf-8") as log:
        if subprocess.run(command, stdout=log, stderr=log, check=False).returncode == 0:
            return program
    note(f"it does not build here; see {(HOME / name).relative_to(ROOT)}.log")
    return None


def _pin():
    os.sched_setaffinity(0, {CORE})


class Participant:
    """A program that answers rounds (peers/rounds.hpp)."""

    def __init__(self, command):
        self.process = subprocess.Popen([str(c) for c in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.DEVNULL, text=True, env=dict(os.environ, **ONE_THREAD),
                                        preexec_fn=_pin)

    def ask(self, what):
        try:
            self.process.stdin.write(what + "\n")
            self.process.stdin.flush()
            return json.loads(self.process.stdout.readline())
        except (OSError, ValueError):
            return {}

    def leave(self):
        self.process.stdin.close()
        self.process.wait()


def take_turns(participants, rounds):
    """name -> facts, and name -> seconds of each round."""
    facts, times = {}, {}
    for p in participants:
        facts.update(p.ask("check"))
    for number in range(rounds):
        note(f"round {number + 1} of {rounds}")
        for p in participants:
            for name, seconds in p.ask("round").items():
                times.setdefault(name, []).append(seconds)
    for p in participants:
        p.leave()
    return facts, times


def lines_of(command):
    """The lines of JSON that a program prints, run on one core; what it writes lands beside the environments."""
    out = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, text=True, check=False, cwd=HOME,
                         env=dict(os.environ, **ONE_THREAD), preexec_fn=_pin).stdout
    return [json.loads(line) for line in out.splitlines() if line.startswith("{")]


def instructions(command):
    """(instructions of every part, trouble) of a program that marks its parts for callgrind (CALLGRIND_DUMP_STATS).

    valgrind knows nothing of AVX-512: kernels are the AVX2 ones.
    """
    if shutil.which("valgrind") is None:
        return [], "no valgrind here (apt-get install valgrind)"
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/out", *map(str, command)],
            env=dict(os.environ, TILLER_ISA="avx2"), capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = [line for line in done.stderr.splitlines() if line.strip() and not line.startswith("==")]
            return [], " ".join(said[-1:]) or f"it ended with {done.returncode}"
        counts = []
        for dump in pathlib.Path(folder).glob("out.*"):  # one a part; "out" itself is what came after the last
            found = re.search(r"^(?:totals|summary): (\d+)", dump.read_text(encoding="utf-8"), re.MULTILINE)
            if found:
                counts.append(int(found.group(1)))
        return counts, ""


def spread(values):
    s = sorted(values)
    return s[len(s) // 4], s[(3 * len(s)) // 4]


# ---- tables ----------------------------------------------------------------------------------------

# bench_table.hpp: "  what   figure unit   goal <= bound   met"
ROW = re.compile(r"^ {2,}(?P<what>\S.*?) +(?P<figure>[-+]?(?:\d[\d.e+-]*|nan|inf)) (?P<unit>\S*) *"
                 r"(?:goal (?P<goal>[<>]= \S+))? *(?P<verdict>met|short)?$")


def rows_of(section, lines):
    """Rows with a goal among the lines that a program printed."""
    heading, rows = "", []
    for line in lines:
        found = ROW.match(line)
        if found is None:
            heading = line.strip() if line and not line.startswith(" ") else heading
        elif found["verdict"]:
            rows.append({"section": section, "heading": heading, "row": found["what"].strip(),
                         "figure": float(found["figure"]), "unit": found["unit"], "goal": found["goal"],
                         "met": found["verdict"] == "met"})
    return rows


def run_table(section, program, arguments):
    """(rows, whether it came to its end); its output is shown as it comes."""
    if not program.exists():
        print(f"  not measured: this build has no {program.name}")
        return [], True
    lines = []
    with subprocess.Popen([str(program), *arguments], stdout=subprocess.PIPE, text=True,
                          env=dict(os.environ, **ONE_THREAD)) as process:
        for line in process.stdout:
            print(line, end="", flush=True)
            lines.append(line.rstrip("\n"))
    if process.returncode != 0:
        print(f"  {program.name} failed with {process.returncode}")
    return rows_of(section, lines), process.returncode == 0


def with_forces(text):
    """A robot file that looks for forces beyond its model, as docs/guide/disturbances.md has it."""
    text = re.sub(r"^(moves_per_tick|window) = .*\n", "", text, flags=re.M)
    lines = "[posterior]\ndisturbance = true\nwindow = 256\nmoves_per_tick = 8\n"
    return text.replace("[posterior]\n", lines, 1) if "[posterior]\n" in text else text + "\n" + lines


def held_against_forces(text):
    """A robot file whose inputs count from those that hold the target."""
    text, count = re.subn(r"^\[cost\]\n", '[cost]\ninput_reference = "steady"\n', text, flags=re.M)
    assert count == 1
    return text


def kept_rows(path, key):
    """key(row) -> row of a file of JSON lines, the last of which may be half of one; {}: there is no file."""
    rows = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            row = json.loads(line)
        except ValueError:
            continue
        rows[key(row)] = row
    return rows


def poisson_bound(count, share):
    """The exact interval (Garwood's) of the mean of a Poisson count: by bisection, since there is no scipy here."""
    def tail(mean):  # of `count` or less
        term = total = math.exp(-mean)
        for k in range(1, count + 1):
            term *= mean / k
            total += term
        return total

    def where(of, value):  # `of` falls
        low, high = 0.0, 10.0 * count + 20.0
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if of(middle) > value else (low, middle)
        return low

    edge = 0.5 * (1.0 - share)
    point = lambda mean: math.exp(count * math.log(mean) - mean - math.lgamma(count + 1)) if mean > 0.0 else float(count == 0)
    return where(lambda m: tail(m) - point(m), 1.0 - edge) if count else 0.0, where(tail, edge)


def summary(rows):
    print("\n==== summary: every row that has a goal")
    place = None
    for r in rows:
        if (r["section"], r["heading"]) != place:
            place = (r["section"], r["heading"])
            print(f"{r['section']}: {r['heading']}")
        print(f"  {r['row']:<76} {r['figure']:10.4g} {r['unit']:<8} {r['goal']:<12} {'met' if r['met'] else 'short'}")
    met = sum(r["met"] for r in rows)
    print(f"\n{met} rows met, {len(rows) - met} short")
