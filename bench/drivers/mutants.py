"""./dev bench mutants: do the tests of the gate, the state machine and the sensor guard notice a mistake?

    --every N    only each N-th mutant (1)
    --list       name the mutants and end

Every mutant is one line of runtime/safety changed in one place: a bound dropped, a comparison turned, an entry of the
transition table replaced. It is compiled with the tests of tests/safety as they are; a mutant that the tests pass has
survived, and is named. Nothing is written outside a temporary folder.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
SAFETY = ROOT / "runtime/safety"
GOAL_PERCENT = 95.0

# (file, what stands there once, what takes its place)
LINES = [
    ("gate", "if (!(rate_per_s > 0.0)) return 0.0;", "if (rate_per_s < 0.0) return 0.0;"),
    ("gate", "if (rate_per_s > DBL_MAX) return rate_per_s;", "if (rate_per_s > DBL_MAX) return 0.0;"),
    ("gate", "if (!(elapsed_s > 0.0)) return 0.0;", ""),
    ("gate", "if (!(elapsed_s > 0.0)) return 0.0;", "if (elapsed_s > 0.0) return 0.0;"),
    ("gate", "time_s = elapsed_s + kStampGrain_s;", "time_s = period_s;"),
    ("gate", "if (!(period_s < time_s)) return", "if (period_s < time_s) return"),
    ("gate", "if (!(period_s < time_s)) return", "return"),
    ("gate", "times(rate_per_s, period_s) : 0.0", "rate_per_s : 0.0"),
    ("gate", "x >= -DBL_MAX && ", ""),
    ("gate", " && x <= DBL_MAX", ""),
    ("gate", "if (g->count > TILLER_MAX_INPUTS) g->count = TILLER_MAX_INPUTS;", "g->count = 1;"),
    ("gate", "if (!is_finite(*safe)) *safe = 0.0;", ""),
    ("gate", "!is_finite(*low) || ", ""),
    ("gate", "!is_finite(*high) || ", ""),
    ("gate", " || *low > *high) *low", ") *low"),
    ("gate", "*low = *high = *safe;\n", "*low = *high = 0.0;\n"),
    ("gate", "*safe = brought_in(*safe, *low, *high);", ""),
    ("gate", "    g->last[i] = g->safe_command[i];\n  }\n}\n\ndouble", "  }\n}\n\ndouble"),
    ("gate", "if (g->low[i] <= safe[i] && safe[i] <= g->high[i]) g->safe", "if (safe[i] <= g->high[i]) g->safe"),
    ("gate", "if (g->low[i] <= safe[i] && safe[i] <= g->high[i]) g->safe", "if (g->low[i] <= safe[i]) g->safe"),
    ("gate", "if (g->low[i] <= safe[i] && safe[i] <= g->high[i]) g->safe", "if (false) g->safe"),
    ("gate", "if (cones != NULL)", "if (false)"),
    ("gate", "if (command == NULL) return false;", "if (command == NULL) return true;"),
    ("gate", "if (!is_finite(command[i])) return false;", "if (command[i] != command[i]) return false;"),
    ("gate", "if (!is_finite(command[i])) return false;", "if (command[i] - command[i] != 0.0) return true;"),
    ("gate", "if (!(x >= low)) return low;", ""),
    ("gate", "return high < x ? high : x;", "return x;"),
    ("gate", "low < down ? down : low", "low"),
    ("gate", "up < high ? up : high", "high"),
    ("gate", "return last - step;", "return last - 1.01 * step;"),
    ("gate", "return last + step;", "return last + 1.01 * step;"),
    ("gate", "tolerance)) return tiller_status_command_limited;", "tolerance)) return tiller_status_rate_limited;"),
    ("gate", "return apart(within, value, tolerance) ?", "return !apart(within, value, tolerance) ?"),
    ("gate", "a - b > tolerance || ", ""),
    ("gate", " || b - a > tolerance", ""),
    ("gate", "TILLER_GATE_ROUNDING * (high - low)", "0.0 * (high - low)"),
    ("gate", "} else if (all_finite(fallback, g->count)) {", "} else if (true) {"),
    ("gate", "} else if (all_finite(fallback, g->count)) {", "} else if (false) {"),
    ("gate", "const bool usable = all_finite(wanted, g->count);", "const bool usable = true;"),
    ("gate", "if (status == tiller_status_ok) status = told", "status = told"),
    ("gate", "if (status == tiller_status_ok) status = by_cones;", "status = by_cones;"),
    ("gate", "if (status != tiller_status_ok) ++g->cuts;", "++g->cuts;"),
    ("gate", "  ++g->rejections;\n", ""),
    ("gate", "  return tiller_status_command_not_finite;\n}\n\nvoid", "  return status;\n}\n\nvoid"),
    ("gate", "  keep(g, out);\n", ""),
    ("gate", "if (!all_admissible(g, elapsed_s, u)) {", "if (false) {"),
    ("gate", "if (!(low <= x && x <= high)) return false;", ""),
    ("gate", "if (!(low <= x && x <= high)) return false;", "if (!(low <= x)) return false;"),
    ("gate", "if (!(low <= x && x <= high)) return false;", "if (!(x <= high)) return false;"),
    ("gate", "(last - step <= x && x <= last + step) || ", ""),
    ("gate", " || (x - last <= step && last - x <= step)", ""),
    ("gate", "last - step <= x && ", ""),
    ("gate", " && x <= last + step", ""),
    ("gate", "x - last <= step && ", ""),
    ("gate", " && last - x <= step", ""),
    ("gate", "period_s > 0.0 ? times(rate_per_s, period_s) : 0.0", "times(rate_per_s, period_s)"),
    ("gate", "if (!all_admissible(g, elapsed_s, u)) {", "if (true) {"),
    ("gate", "g->last[i] = out[i] = g->safe_command[i];", "out[i] = g->safe_command[i];"),
    ("gate", "g->last[i] = out[i] = g->safe_command[i];", "out[i] = g->last[i];"),
    ("gate", "{ *low = *high = *last = *safe; }", "{ (void)low, (void)high, (void)last, (void)safe; }"),
    ("output_gate", "if (!cones_fit())", "if (false)"),
    ("output_gate", "shrink_to_cones(cones_, safe);", ""),
    ("output_gate", "cones_.count > 0 ? ", "cones_.count > 1 ? "),
    ("output_gate", "|| cone.slope < 0.0)", ")"),
    ("output_gate", "if (!(cone_radius(cone, gate_.low) >= 0.0)) return false;", ""),
    ("output_gate", "!(gate_.low[i] <= 0.0 && ", "!("),

    ("answer", "if (!tiller_machine_moves(m))", "if (false)"),
    ("answer", "if (!tiller_machine_moves(m))", "if (!m->armed)"),
    ("answer", "if (m->state == tiller_state_hold) return", "if (false) return"),
    ("answer", "planned, hold, elapsed_s", "planned, planned, elapsed_s"),

    ("machine", "if (next == kRefused) return tiller_status_wrong_state;", ""),
    ("machine", "if (next == kRefused) return tiller_status_wrong_state;",
     "if (next == kRefused) return tiller_status_ok;"),
    ("machine", "m->state = (tiller_state_t)next;", ""),
    ("machine", "if (event == tiller_event_arm) m->armed = true;", ""),
    ("machine", "if (event == tiller_event_arm) m->armed = true;", "m->armed = true;"),
    ("machine", "event == tiller_event_disarm || ", ""),
    ("machine", "event == tiller_event_reset || ", ""),
    ("machine", " || m->state == tiller_state_safe) m->armed = false;", ") m->armed = false;"),
    ("machine", "at_fault = m->state == tiller_state_hold || ", "at_fault = "),
    ("machine", "tiller_state_hold || m->state == tiller_state_safe;", "tiller_state_hold;"),
    ("machine", "if (!at_fault) m->first_fault = tiller_status_ok;", ""),
    ("machine", "if (at_fault && m->first_fault == tiller_status_ok) m->first_fault = why;",
     "if (at_fault) m->first_fault = why;"),
    ("machine", "if (at_fault && m->first_fault == tiller_status_ok) m->first_fault = why;", ""),

    ("sensor_guard", "clocked_ && now_us < now_us_;", "false;"),
    ("sensor_guard", "still_us_ += limits_.ahead_us;", ""),
    ("sensor_guard", "measurement == nullptr || repeated(*measurement)", "measurement == nullptr"),
    ("sensor_guard", "verdict.lost = bad_ticks_ >= limits_.bad_ticks_to_safe;",
     "verdict.lost = bad_ticks_ > limits_.bad_ticks_to_safe;"),
    ("sensor_guard", "    bad_ticks_ = 0;\n    verdict.usable", "    verdict.usable"),
    ("sensor_guard", "    still_us_ = 0;\n    bad_ticks_", "    bad_ticks_"),
    ("sensor_guard", "    verdict.usable = false;\n    verdict.lost = true;", "    verdict.lost = true;"),
    ("sensor_guard", "    verdict.usable = false;\n    verdict.lost = true;", "    verdict.usable = false;"),
    ("sensor_guard", "return should_move && ", "return "),
    ("sensor_guard", "limits_.frozen_ticks != 0 && ", ""),
    ("sensor_guard", "repeats_ >= limits_.frozen_ticks", "repeats_ > limits_.frozen_ticks"),
    ("sensor_guard", "if (age_us > limits_.timeout_us) return tiller_status_sensor_stale;", ""),
    ("sensor_guard", "if (age_us < -limits_.ahead_us) return tiller_status_sensor_stale;", ""),
    ("sensor_guard", "if (started_ && stamp_us <= stamp_us_)", "if (started_ && stamp_us < stamp_us_)"),
    ("sensor_guard", "started_ ? present > 0 : present == limits_.count", "present > 0"),
    ("sensor_guard", "started_ ? present > 0 : present == limits_.count", "present == limits_.count"),
    ("sensor_guard", "if (!std::isfinite(value)) return tiller_status_sensor_not_finite;", ""),
    ("sensor_guard", "value < limits_.low[i] || ", ""),
    ("sensor_guard", " || value > limits_.high[i])", ")"),
    ("sensor_guard", "change = std::remainder(change, kTwoPi);", ";"),
    ("sensor_guard", "elapsed_us(stamp_us, seen_us_[i])", "elapsed_us(stamp_us, stamp_us_)"),
    ("sensor_guard", "std::abs(change) > limits_", "change > limits_"),
    ("sensor_guard", "timeout_us - still_us_) return true;", "timeout_us) return true;"),
    ("sensor_guard", "  started_ = true;", ""),
]


def table_mutants(text):
    """Every entry of the transition table, replaced by another state."""
    for row in re.finditer(r"^  /\* (\w+) +\*/ \{(.*)\},$", text, re.MULTILINE):
        entries = [e.strip() for e in row[2].split(",")]
        for i, entry in enumerate(entries):
            other = "kActive" if entry in ("kSafe", "kRefused") else "kSafe"
            changed = entries[:i] + [other] + entries[i + 1:]
            yield (f"machine: {row[1]}, event {i}: {entry} -> {other}", "machine",
                   text[:row.start(2)] + ", ".join(changed) + text[row.end(2):])


def all_mutants():
    texts = {p.stem: p.read_text(encoding="utf-8") for p in SAFETY.glob("*.c*")}
    mutants = list(table_mutants(texts["machine"]))
    for name, old, new in LINES:
        if texts[name].count(old) < 1:
            sys.exit(f"mutants: {name} no longer holds: {old!r}")
        what = f"{name}: {' '.join(old.split())} -> {' '.join(new.split()) or 'nothing'}"
        mutants.append((what, name, texts[name].replace(old, new, 1)))
    return texts, mutants


class Bench:
    """Objects of everything once; then one source and a link a mutant."""

    def __init__(self, folder, sources):
        self.folder = pathlib.Path(folder)
        self.compiler = os.environ.get("CXX", "c++")
        self.commands = {".cpp": [self.compiler, "-std=c++17"], ".c": [os.environ.get("CC", "cc"), "-std=c99"]}
        self.flags = ["-O1", f"-I{ROOT}", f"-I{ROOT / 'runtime'}", f"-I{ROOT / 'runtime/include'}"]
        self.suffixes = {p.stem: p.suffix for p in SAFETY.glob("*.c*")}
        self.objects = {name: self.compile(SAFETY / (name + self.suffixes[name]), name) for name in sources}
        core = [self.compile(path, path.stem) for path in sorted((ROOT / "runtime/core").glob("*.cpp"))]
        tests = {path.stem: self.compile(path, path.stem)
                 for path in sorted((ROOT / "tests/safety").glob("*_test.cpp"))}
        alone = tests.pop("gate_rounding_test")  # a program of its own: it takes the place of the cones
        self.programs = [(set(sources), [*tests.values(), *core]), ({"gate"}, [alone, *core])]

    def compile(self, path, name):
        out = self.folder / f"{name}.o"
        done = subprocess.run([*self.commands[path.suffix], *self.flags, "-c", path, "-o", out], capture_output=True, text=True,
                              check=False)
        if done.returncode != 0:
            raise ValueError(done.stderr)
        return out

    def tests_pass(self, name, text):
        path = self.folder / f"mutant{self.suffixes[name]}"
        path.write_text(text, encoding="utf-8")
        objects = {**self.objects, name: self.compile(path, "mutant")}
        return all(self.passes([objects[one] for one in sorted(parts)] + others)
                   for parts, others in self.programs if name in parts)

    def passes(self, objects):
        program = self.folder / "tests"
        subprocess.run([self.compiler, *objects, "-lgtest", "-lgtest_main", "-lpthread", "-o", program], check=True)
        try:
            return subprocess.run([program, "--gtest_fail_fast"], stdout=subprocess.DEVNULL,
                                  stderr=subprocess.DEVNULL, timeout=120, check=False).returncode == 0
        except subprocess.TimeoutExpired:
            return False


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--list", action="store_true")
    args = parser.parse_args()
    texts, mutants = all_mutants()
    mutants = mutants[::args.every]
    if args.list:
        print(*[what for what, _, _ in mutants], sep="\n")
        return 0
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(folder, texts)
        if not bench.tests_pass("output_gate", texts["output_gate"]):
            sys.exit("mutants: the tests fail without any mutant")
        for what, name, text in mutants:
            try:
                if bench.tests_pass(name, text):
                    survivors.append(what)
                    print(f"  survived: {what}", flush=True)
            except ValueError as error:
                sys.exit(f"mutants: {what} does not compile:\n{error}")
    killed = 100.0 * (1 - len(survivors) / len(mutants))
    verdict = "met" if killed >= GOAL_PERCENT else "short"
    print(f"  {'mutants of gate, state machine and sensor guard':<58} {len(mutants):10d} {'mutants':<8} {'':<16}")
    print(f"  {'killed by tests/safety':<58} {killed:10.4g} {'%':<8} goal >= {GOAL_PERCENT:<7g} {verdict}")
    return 0 if verdict == "met" else 1


if __name__ == "__main__":
    sys.exit(main())
