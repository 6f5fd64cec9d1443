"""./dev bench mutants: do the tests of the runtime notice a mistake?

    --folder NAME   safety, executive, posterior or planners (all four)
    --count N       so many mutants of a folder, drawn at random (40; 0: all there are)
    --seed S        of the draw (1)
    --list          name the drawn mutants and end
    --keep FILE     write each verdict to FILE, and take from there what it knows: a run that was cut goes on
    --again         judge those in FILE anew that survived, after tests were written (./dev build release first)
    --longest S     without test programs of more than S seconds of processor time (all judge)
    --jobs N        mutants at a time (1)
    --goal PERCENT  killed at least, else the exit code is 1 (95)
    --build DIR     the build whose compiler, flags, objects and tests are taken (build/release)

A mutant is one source file of runtime/NAME changed in one place: a comparison shifted by its bound or turned, an
arithmetic or logical operator replaced, a constant replaced, a condition negated, a statement deleted, an entry of a
table replaced by its neighbour. It is compiled as the build compiles it and linked with the objects of the tests that
judge it. Short test programs run first. A test that fails, crashes or takes four times its processor time kills it.

Not judged are mutants that do not compile and those whose object files have the same bytes as the source's. What
docs/evidence/mutants.md names as equivalent counts as neither killed nor survived. Nothing is written outside a
temporary folder and FILE.
"""

import argparse
import collections
import concurrent.futures
import filecmp
import hashlib
import json
import os
import pathlib
import random
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/evidence/mutants.md"
GOAL_PERCENT = 95.0
# folders of tests whose programs judge a folder of the runtime
JUDGES = {"safety": ["safety"], "executive": ["executive", "abi"], "posterior": ["posterior"],
          "planners": ["planners", "executive", "abi"]}

Mutant = collections.namedtuple("Mutant", "name path text")
Judge = collections.namedtuple("Judge", "target folder link cpu_s wall_s")


# ---- what is changed -------------------------------------------------------------------------------

# what no mutant touches: comments, strings, characters, the preprocessor, static assertions, template parameters
UNTOUCHED = re.compile(r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])'|^[ \t]*\#(?:\\\n|[^\n])*"""
                       r"|static_assert\([^;]*;|template <[^{;()]*>", re.DOTALL | re.MULTILINE)
# operators stand between blanks (clang-format), which tells them from brackets of templates and from pointers
PAIRS = {"<": ["<=", ">="], "<=": ["<", ">"], ">": [">=", "<="], ">=": [">", "<"], "==": ["!="], "!=": ["=="],
         "+": ["-"], "-": ["+"], "*": ["/"], "/": ["*"], "%": ["*"], "&&": ["||"], "||": ["&&"],
         "+=": ["-="], "-=": ["+="], "*=": ["/="], "/=": ["*="]}
OPERATOR = re.compile(r"(?<= )(%s)(?=[ \n])" % "|".join(re.escape(o) for o in sorted(PAIRS, key=len, reverse=True)))
STEP = re.compile(r"\+\+(?=[\w(*])|--(?=[\w(*])")
SIGN = re.compile(r"(?<=[(,=\s\[])-(?=[\w(.])|(?<![\w)\]])!(?=[\w(])")
NUMBER = re.compile(r"(?<![\w.<'])(\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+|\d+)(?=[fuUlL]*\b|[fuUlL]*(?=\W))")
CONDITION = re.compile(r"\b(?:if|while) \(")
STATEMENT = re.compile(r"(?<=[;{}):\n])\s*\n +([^;{}\n]*;)(?=\n)")
DECLARATION = re.compile(r"(?:return|case|default|using|const|constexpr|static|auto|goto|typedef)\b"
                         r"|[\w:<>]+[*&]* [*&]*\w+ *[=;({,]")
RETURN = re.compile(r"\breturn;")
ROW = re.compile(r"^ *(?:  )?\{([\w, ]+)\},?$", re.MULTILINE)


def matching(text, start):
    """The end of the bracket that opens at start."""
    depth = 0
    for i in range(start, len(text)):
        depth += (text[i] == "(") - (text[i] == ")")
        if depth == 0:
            return i + 1
    return len(text)


def other_number(digits):
    if re.fullmatch(r"\d+", digits):
        return "0" if digits == "1" else str(int(digits) + 1)
    return "0.0" if float(digits) == 1.0 else "1.0"


def changes(code):
    """(start, end, replacement) of every mutant of a source whose untouched parts are blanks."""
    for found in OPERATOR.finditer(code):
        yield from ((*found.span(), other) for other in PAIRS[found[1]])
    for found in STEP.finditer(code):
        yield (*found.span(), "--" if found[0] == "++" else "++")
    for found in SIGN.finditer(code):
        yield (*found.span(), "")
    for found in NUMBER.finditer(code):
        yield (*found.span(1), other_number(found[1]))
    for found in CONDITION.finditer(code):
        start = found.end() - 1
        end = matching(code, start)
        if not re.search(r" (?:[<>]=?|[!=]=) ", code[start:end]):  # else its comparison is turned
            yield (start, end, f"(!{code[start:end]})")
    for found in STATEMENT.finditer(code):
        if found[1].count("(") == found[1].count(")") and not DECLARATION.match(found[1]):
            yield (*found.span(1), ";")
    for found in RETURN.finditer(code):
        yield (*found.span(), ";")
    for found in ROW.finditer(code):
        entries = list(re.finditer(r"[a-zA-Z]\w*", found[1]))
        for i, entry in enumerate(entries):
            rest = (e[0] for e in entries[i:] + entries[:i] if e[0] != entry[0])
            yield (found.start(1) + entry.start(), found.start(1) + entry.end(), next(rest, entry[0]))


def mutants_of(path):
    text = path.read_text(encoding="utf-8")
    code = UNTOUCHED.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)
    named = collections.Counter()
    for start, end, other in sorted(changes(code)):
        first, last = text.rfind("\n", 0, start) + 1, text.find("\n", end)
        what = "delete: " + text[start:end] if other == ";" else f"{text[start:end]} -> {other or 'nothing'}"
        before, after = text[first:start].lstrip()[-30:], text[end:last][:30]
        name = " ".join(f"{path.relative_to(ROOT / 'runtime')}: {before}{{{what}}}{after}".split())
        named[name] += 1
        if named[name] > 1:
            name += f" ({named[name]})"
        yield Mutant(name, path, text[:start] + other + text[end:])


def drawn(folder, count, seed):
    sources = sorted(p for p in (ROOT / "runtime" / folder).rglob("*.c*") if p.suffix in (".c", ".cpp"))
    every = [mutant for path in sources for mutant in mutants_of(path)]
    return every if count == 0 else random.Random(seed).sample(every, min(count, len(every)))


# ---- how it is judged ------------------------------------------------------------------------------


def run(argv, **more):
    return subprocess.run(argv, capture_output=True, text=True, errors="replace", check=False, **more)


def command_of(build, target):
    """The words of the command by which ninja makes a target."""
    done = run(["ninja", "-C", build, "-t", "commands", "-s", target])
    for line in reversed(done.stdout.splitlines()):
        for words in (shlex.split(part) for part in line.split("&&")):
            if str(target) in words and words[0] != ":" and "rm" not in words:
                return words
    sys.exit(f"mutants: {build} has no {target} (./dev build release makes it)")


def instead(words, others):
    return [str(others.get(word, word)) for word in words]


class Bench:
    """A build, and what of it a folder's mutants need."""

    def __init__(self, build, folder, scratch, known, longest_s):
        self.build, self.scratch, self.known = build, scratch, known
        self.library = f"runtime/{folder}/libtiller_{folder}.a"
        self.archive = next(words for words in self.archive_commands() if "qc" in words)
        self.units = self.units_of()
        self.originals, self.lock = {}, threading.Lock()
        self.long = set(self.long_tests(longest_s))
        self.judges = sorted((j for j in self.judges_of(folder) if j.cpu_s <= longest_s), key=lambda judge: judge.cpu_s)

    def archive_commands(self):
        done = run(["ninja", "-C", self.build, "-t", "commands", self.library])
        return [shlex.split(part) for part in done.stdout.splitlines()[-1].split("&&")]

    def units_of(self):
        """source -> [(command, object, unit, whether it includes the source)]: a unit for each instruction set."""
        units = collections.defaultdict(list)
        members = set(self.archive)
        for entry in json.loads((self.build / "compile_commands.json").read_text()):
            words = shlex.split(entry["command"])
            made = words[words.index("-o") + 1]
            if made in members:
                path = pathlib.Path(entry["file"])
                found = re.match(r'#include "(.*\.cpp)"', path.read_text(encoding="utf-8"))
                copied = found is not None and path.is_relative_to(self.build)
                units[pathlib.Path(found[1]) if copied else path].append((words, made, path, copied))
        return units

    def long_tests(self, longest_s):
        """Those of which ctest knows that they take longer."""
        costs = self.build / "Testing/Temporary/CTestCostData.txt"
        for line in costs.read_text().splitlines() if costs.exists() else []:
            name, *numbers = line.split()
            if len(numbers) == 2 and float(numbers[1]) > longest_s:
                yield name

    def judges_of(self, folder):
        listed = json.loads(run(["ctest", "--test-dir", self.build, "--show-only=json-v1"]).stdout)
        wanted = {self.build / "tests" / name for name in JUDGES[folder]}
        for test in listed["tests"]:
            program = pathlib.Path(test.get("command", ["none"])[0])
            labels = [p["value"] for p in test["properties"] if p["name"] == "LABELS"]
            if program.parent not in wanted or not program.name.endswith("_test") or "slow" in sum(labels, []):
                continue
            target = str(program.relative_to(self.build))
            link = command_of(self.build, target)
            if self.library in link and test["name"] not in self.long:
                yield self.measured(target, link)

    def measured(self, target, link):
        """A judge with the time that it takes on the source as it is."""
        if target not in self.known:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            folder = self.scratch / "unchanged"
            folder.mkdir(exist_ok=True)
            begin = os.times().elapsed
            why = self.failure(self.build / target, folder, 3600, 3600)
            if why:
                sys.exit(f"mutants: without any mutant {target} fails: {why}")
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            cpu_s = sum(after[:2]) - sum(before[:2])
            self.known.put({"name": target, "cpu_s": cpu_s, "wall_s": os.times().elapsed - begin})
        row = self.known[target]
        return Judge(target, pathlib.Path(target).name, link, row["cpu_s"], row["wall_s"])

    def compiled(self, path, text, folder):
        """{object of the build: object of the mutant}, or None for a text that does not compile."""
        mutated = folder / path.name
        mutated.write_text(text, encoding="utf-8")
        objects = {}
        for i, (words, made, unit, copied) in enumerate(self.units[path]):
            source = mutated
            if copied:
                source = folder / unit.name
                source.write_text(f'#include "{mutated}"\n', encoding="utf-8")
            objects[made] = folder / f"{i}.o"
            done = run(instead(words, {made: objects[made], str(unit): source}) + ["-w", "-iquote", path.parent],
                       cwd=self.build)
            if done.returncode != 0:
                return None
        return objects

    def original(self, path):
        with self.lock:
            if path not in self.originals:
                folder = self.scratch / f"original_{len(self.originals)}"
                folder.mkdir()
                self.originals[path] = [o.read_bytes() for o in self.compiled(path, path.read_text(), folder).values()]
            return self.originals[path]

    def verdict(self, mutant):
        """(verdict, the judge that killed it)."""
        if not self.units[mutant.path]:
            return "not in this build", ""
        with tempfile.TemporaryDirectory(dir=self.scratch) as name:
            folder = pathlib.Path(name)
            objects = self.compiled(mutant.path, mutant.text, folder)
            if objects is None:
                return "does not compile", ""
            if [o.read_bytes() for o in objects.values()] == self.original(mutant.path):
                return "same object", ""
            library = folder / "mutant.a"
            subprocess.run(instead(self.archive, {**objects, self.library: library}), cwd=self.build, check=True)
            for judge in self.judges:
                program = folder / judge.folder
                words = instead(judge.link, {self.library: library, judge.target: program})
                done = run(words, cwd=self.build)
                if done.returncode != 0:
                    raise RuntimeError(f"{judge.target} does not link with {mutant.name}:\n{done.stderr}")
                if filecmp.cmp(program, self.build / judge.target, shallow=False):
                    continue  # it does not hold the source
                why = self.failure(program, folder, 4 * judge.cpu_s + 5, 20 * judge.wall_s + 120)
                program.unlink()
                if why:
                    return "killed", f"{judge.folder}: {why}"
        return "survived", ""

    def failure(self, program, folder, cpu_s, wall_s):
        """Why a program of tests fails, or nothing. Who waits for ever uses no processor time: the clock ends it."""
        def limits():
            resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_s) + 1, int(cpu_s) + 2))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

        try:
            done = run([program, "--gtest_fail_fast"], cwd=folder, timeout=wall_s, preexec_fn=limits,
                       env=dict(os.environ, TEST_TMPDIR=str(folder)))
        except subprocess.TimeoutExpired:
            return "it waits for ever"
        if done.returncode == 0:
            return ""
        failed = re.search(r"^\[  FAILED  \] (\S+?),? ", done.stdout + " ", re.MULTILINE)
        begun = re.findall(r"^\[ RUN      \] (\S+)", done.stdout, re.MULTILINE)
        return failed[1] if failed else f"{begun[-1] if begun else 'start'} ended by {done.returncode}"


class Known:
    """Verdicts and times that a file keeps, a row of JSON each."""

    def __init__(self, path):
        self.path, self.rows, self.lock = path, {}, threading.Lock()
        if path and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                row = json.loads(line)
                self.rows[row["name"], row.get("text", "")] = row

    def __contains__(self, name):
        return (name, "") in self.rows

    def __getitem__(self, name):
        return self.rows[name, ""]

    def of(self, mutant, again):
        row = self.rows.get((mutant.name, digest(mutant)), {})
        return None if again and row.get("verdict") == "survived" else row.get("verdict")

    def put(self, row):
        with self.lock:
            self.rows[row["name"], row.get("text", "")] = row
            if self.path:
                with self.path.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")


def digest(mutant):
    return hashlib.sha256(mutant.text.encode()).hexdigest()[:16]


# ---- what is told ----------------------------------------------------------------------------------


def equivalents():
    """Mutants that the page names, each with its reason: "- `name`: reason"."""
    text = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    return set(re.findall(r"^- `(.+?)`:", text, re.MULTILINE))


def scratch_folder():
    """The memory, where programs of it may run and a few of them have room (containers often allow neither)."""
    shared = pathlib.Path("/dev/shm")
    if os.access(shared, os.W_OK):
        disk = os.statvfs(shared)
        if not disk.f_flag & os.ST_NOEXEC and disk.f_bavail * disk.f_frsize > 1 << 30:
            return shared
    return pathlib.Path(tempfile.gettempdir())


def judged(args, folder, mutants):
    known = Known(args.keep)
    verdicts = {m: v for m in mutants if (v := known.of(m, args.again))}
    pool = concurrent.futures.ThreadPoolExecutor(args.jobs)
    with tempfile.TemporaryDirectory(dir=scratch_folder()) as name, pool:
        bench = Bench(args.build.resolve(), folder, pathlib.Path(name), known, args.longest)
        todo = [m for m in mutants if m not in verdicts]
        running = {pool.submit(bench.verdict, mutant): mutant for mutant in todo}
        for ended in concurrent.futures.as_completed(running):
            mutant = running[ended]
            verdict, by = ended.result()
            verdicts[mutant] = verdict
            known.put({"name": mutant.name, "text": digest(mutant), "verdict": verdict, "by": by})
            print(f"  {len(verdicts)}/{len(mutants)} {verdict}: {mutant.name}{by and f' (by {by})'}", flush=True)
    return verdicts


def row(what, figure, unit, goal=""):
    print(f"  {what:<58} {figure:10.4g} {unit:<8} {goal}", flush=True)


def told(folder, verdicts, goal):
    """The rows of a folder; whether its goal is met."""
    named = equivalents()
    for name in sorted(named - {mutant.name for mutant in drawn(folder, 0, 0)}):
        if name.startswith(folder):
            print(f"  {PAGE.relative_to(ROOT)} names what is no mutant any more: {name}")
    survivors = [m.name for m, v in verdicts.items() if v == "survived"]
    missed = [name for name in survivors if name not in named]
    count = collections.Counter(verdicts.values())
    for name in missed:
        print(f"  survived: {name}", flush=True)
    print(f"mutants of runtime/{folder}")
    row("drawn", len(verdicts), "mutants")
    for verdict in ("not in this build", "does not compile", "same object"):
        if count[verdict]:
            row(f"of these not judged: {verdict}", count[verdict], "mutants")
    row("judged", count["killed"] + count["survived"], "mutants")
    row("killed of those judged", 100.0 * count["killed"] / max(1, count["killed"] + count["survived"]), "%")
    if len(missed) < len(survivors):
        row("survived and equivalent (docs/evidence/mutants.md)", len(survivors) - len(missed), "mutants")
    killed = 100.0 * count["killed"] / max(1, count["killed"] + len(missed))
    row(f"killed by tests/{', tests/'.join(JUDGES[folder])}", killed, "%",
        f"goal >= {goal:<7g} {'met' if killed >= goal else 'short'}")
    return killed >= goal


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", choices=JUDGES, action="append")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--keep", type=pathlib.Path)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--longest", type=float, default=float("inf"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--goal", type=float, default=GOAL_PERCENT)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args = parser.parse_args()
    met = True
    for folder in args.folder or JUDGES:
        mutants = drawn(folder, args.count, args.seed)
        if args.list:
            print(*[mutant.name for mutant in mutants], sep="\n")
        else:
            met = told(folder, judged(args, folder, mutants), args.goal) and met
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
