"""./dev prove: the C core of runtime/safety against its contracts, by Frama-C (WP with z3, and Eva).

    --approve      write what is proven to tests/proof/goals.txt
    --timeout N    seconds for a goal (120); it takes more on a busy machine
    --smoke        look for contradictory contracts as well: minutes more

Prints goals, proven ones, open ones and seconds of each file, and every open goal. Fails where a function has fewer
proven goals than tests/proof/goals.txt says, where a goal is open that is not listed there with its reason, where Eva
finds an alarm, and where a contract of tests/proof/wrong.c, none of which holds, is proven. docs/safety/proof.md tells
what the contracts say.
"""

import argparse
import collections
import os
import pathlib
import re
import subprocess
import sys
import time

import z3_doubles

ROOT = pathlib.Path(__file__).resolve().parents[2]
OUT = ROOT / "build/proof"
LIST = ROOT / "tests/proof/goals.txt"
CORE = ["runtime/safety/gate.c", "runtime/safety/machine.c", "runtime/safety/answer.c"]
HISTORY, WRONG = "tests/proof/any_history.c", "tests/proof/wrong.c"
# NaN and infinities are values like any other.
FRAMA_C = ["frama-c", "-machdep", "gcc_x86_64", "-cpp-extra-args=-Iruntime -Iruntime/include -std=c99",
           "-warn-special-float", "none"]
WP = ["-wp", "-wp-rte", "-wp-model", "Typed+float", "-wp-prover", "z3"]
GOAL = re.compile(r"^\[wp\] \[([^\]]*)\] Goal typed_(\w+) : (\w+)", re.MULTILINE)

Goal = collections.namedtuple("Goal", "function name prover proven")


def frama_c(arguments):
    """What Frama-C prints. Why3 finds z3 behind z3_doubles.py, by a configuration of its own."""
    OUT.mkdir(parents=True, exist_ok=True)
    config = OUT / "why3.conf"
    environment = {**os.environ, "WHY3CONFIG": str(config), "PWD": str(ROOT)}
    if not config.exists():
        subprocess.run(["why3", "config", "detect"], env=environment, check=True, capture_output=True)
        text = config.read_text(encoding="utf-8")
        front = ROOT / "tools/dev/z3_doubles.py"
        config.write_text(re.sub(r'(name = "Z3"\npath = )"[^"]*"', rf'\1"{front}"', text), encoding="utf-8")
    done = subprocess.run([*FRAMA_C, *arguments], cwd=ROOT, env=environment, capture_output=True, text=True,
                          check=False)
    if done.returncode != 0:
        sys.exit(f"prove: Frama-C ended with {done.returncode}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def goals_of(source, timeout, arguments=()):
    output = frama_c([source, *WP, "-wp-timeout", str(timeout), "-wp-par", os.environ.get("TILLER_JOBS", "2"),
                      *arguments])
    (OUT / (pathlib.Path(source).stem + ".log")).write_text(output, encoding="utf-8")
    functions = sorted(re.findall(r"annotating function (\w+)", output), key=len, reverse=True)
    goals = []
    for prover, name, verdict in GOAL.findall(output):
        function = next((f for f in functions if name.startswith(f + "_")), "")
        goals.append(Goal(function, name, prover if verdict == "Valid" else "", verdict == "Valid"))
    scheduled = re.search(r"(\d+) goals scheduled", output)
    if not scheduled or int(scheduled[1]) != len({g.name for g in goals}):
        sys.exit(f"prove: {source}: not every goal was read; what Frama-C printed is in {OUT}")
    return goals


def listed():
    """(file, function) -> proven goals, and the reasons of open ones."""
    counts, reasons = {}, {}
    for line in LIST.read_text(encoding="utf-8").splitlines() if LIST.exists() else []:
        words = line.split(maxsplit=2)
        if line.startswith("#") or not words:
            continue
        if words[0] == "open":
            reasons[words[1]] = words[2]
        else:
            counts[words[0], words[1]] = int(words[2])
    return counts, reasons


def approve(proven, reasons):
    lines = ["# Goals that ./dev prove discharges: file, function, how many. "
             "One that it may leave open: open NAME REASON"]
    lines += [f"{name} {function} {count}" for (name, function), count in proven.items()]
    lines += [f"open {name} {reason}" for name, reason in reasons.items()]
    LIST.write_text("\n".join(lines) + "\n", encoding="utf-8")


def alarms():
    """Eva on every history: its alarms, and what it says of the command."""
    output = frama_c([HISTORY, *CORE, "-main", "main", "-eva", "-eva-precision", "4"])
    (OUT / "eva.log").write_text(output, encoding="utf-8")
    found = re.search(r"(\d+) alarms? generated", output)
    command = set(re.findall(r"^ +out\[0\.\.15\] ∈ (.*)$", output, re.MULTILINE))
    reached = re.search(r"(\d+) statements reached \(out of (\d+)\)", output)
    invalid = sum(int(n) for n in re.findall(r"(\d+) invalid", output))
    return (int(found[1]) if found else -1) + invalid, sorted(command), reached.groups() if reached else ("0", "0")


def report(rows):
    print(f"  {'file':<30} {'goals':>6} {'proven':>7} {'Qed':>5} {'z3':>5} {'open':>5} {'seconds':>8}")
    for name, goals, seconds in rows:
        proven = [g for g in goals if g.proven]
        simple = sum(g.prover == "Qed" for g in proven)
        print(f"  {name:<30} {len(goals):6d} {len(proven):7d} {simple:5d} {len(proven) - simple:5d} "
              f"{len(goals) - len(proven):5d} {seconds:8.0f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--approve", action="store_true")
    parser.add_argument("--timeout", type=int, default=120)
    parser.add_argument("--smoke", action="store_true")
    args = parser.parse_args()
    (OUT / "why3.conf").unlink(missing_ok=True)
    faults = []
    if not z3_doubles.laws_hold():
        faults.append("z3 does not decide the laws of doubles in tools/dev/z3_doubles.py")
    counts, reasons = listed()
    rows, proven = [], {}
    for source in [*CORE, HISTORY]:
        started = time.monotonic()
        goals = goals_of(source, args.timeout, ["-wp-skip-fct", "main"] if source == HISTORY else [])
        rows.append((source, goals, time.monotonic() - started))
        stem = pathlib.Path(source).name
        for goal in goals:
            proven[stem, goal.function] = proven.get((stem, goal.function), 0) + goal.proven
            if not goal.proven:
                reason = reasons.get(goal.name)
                print(f"  open: {goal.name}: {reason or 'not listed: no longer, or not yet, discharged'}")
                if not reason:
                    faults.append(f"{goal.name} is open")
    report(rows + [("all", [g for _, goals, _ in rows for g in goals], sum(r[2] for r in rows))])
    for key, count in counts.items():
        if proven.get(key, 0) < count and not args.approve:
            faults.append(f"{key[0]}, {key[1]}: {proven.get(key, 0)} goals proven, {count} listed")

    wrong = [g for g in goals_of(WRONG, 20) if "wrong" in g.name]
    print(f"  contracts that do not hold: {len(wrong)}, of which {sum(g.proven for g in wrong)} are proven")
    faults += [f"{g.name} is proven, but does not hold" for g in wrong if g.proven]
    if not wrong:
        faults.append(f"{WRONG} has no contract to refuse")

    count, command, reached = alarms()
    print(f"  Eva: {count} alarms, {reached[0]} of {reached[1]} statements reached; commands in {'; '.join(command)}")
    if count != 0:
        faults.append(f"Eva: {count} alarms, see {OUT / 'eva.log'}")
    if not command or any("NaN" in c or "--" in c or "inf" in c for c in command):
        faults.append("Eva: a command may be NaN or infinite")
    if args.smoke:
        for source in CORE:
            output = frama_c([source, *WP, "-wp-smoke-tests", "-wp-timeout", "20", "-wp-smoke-timeout", "5"])
            (OUT / (pathlib.Path(source).stem + "_smoke.log")).write_text(output, encoding="utf-8")
            doomed = re.findall(r"\[Failed\] Smoke-test (\w+)", output)
            scheduled = re.search(r"(\d+) goals scheduled", output)
            looked = int(scheduled[1]) - len({name for _, name, _ in GOAL.findall(output)}) if scheduled else 0
            print(f"  contradictory contracts in {source}: {len(doomed)}, looked for at {looked} places", flush=True)
            faults += [f"{name}: what is required contradicts itself" for name in doomed]
            if looked <= 0:
                faults.append(f"{source}: no smoke test ran")
    if args.approve and not faults:
        approve(proven, reasons)
    for fault in faults:
        print(f"prove: {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
