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
    ("output_gate", "if (!(rate_per_s > 0.0)) return 0.0;", "if (rate_per_s < 0.0) return 0.0;"),
    ("output_gate", "if (std::isinf(rate_per_s)) return rate_per_s;", "if (std::isinf(rate_per_s)) return 0.0;"),
    ("output_gate", "std::min(elapsed_s + kStampGrain_s, period_s)", "std::max(elapsed_s + kStampGrain_s, period_s)"),
    ("output_gate", "std::min(elapsed_s + kStampGrain_s, period_s)", "elapsed_s"),
    ("output_gate", "std::min(elapsed_s + kStampGrain_s, period_s)", "period_s"),
    ("output_gate", "elapsed_s > 0.0 ?", "true ?"),
    ("output_gate", "elapsed_s > 0.0 ?", "elapsed_s < 0.0 ?"),
    ("output_gate", "return time_s > 0.0 ? rate_per_s * time_s : 0.0;", "return rate_per_s;"),
    ("output_gate", "std::min<std::uint32_t>(limits.count, TILLER_MAX_INPUTS)", "1"),
    ("output_gate", "if (!std::isfinite(safe)) safe = 0.0;", ""),
    ("output_gate", "!std::isfinite(low) || ", ""),
    ("output_gate", "!std::isfinite(high) || ", ""),
    ("output_gate", " || low > high) low", ") low"),
    ("output_gate", "low = high = safe;", "low = high = 0.0;"),
    ("output_gate", "safe = std::clamp(safe, low, high);", ""),
    ("output_gate", "std::copy(limits_.safe_command, limits_.safe_command + TILLER_MAX_INPUTS, last_)",
     "std::fill(last_, last_ + TILLER_MAX_INPUTS, 0.0)"),
    ("output_gate", "if (limits_.cones.count > 0)", "if (false)"),
    ("output_gate", "if (command == nullptr) return false;", "if (command == nullptr) return true;"),
    ("output_gate", "if (!std::isfinite(command[i])) return false;", "if (std::isnan(command[i])) return false;"),
    ("output_gate", "if (!std::isfinite(command[i])) return false;", "if (std::isinf(command[i])) return false;"),
    ("output_gate", "const double within = std::clamp(wanted, low, high);", "const double within = wanted;"),
    ("output_gate", "const double within = std::clamp(wanted, low, high);",
     "const double within = std::max(wanted, low);"),
    ("output_gate", "const double within = std::clamp(wanted, low, high);",
     "const double within = std::min(wanted, high);"),
    ("output_gate", "std::max(low, last_[i] - step)", "low"),
    ("output_gate", "std::min(high, last_[i] + step)", "high"),
    ("output_gate", "std::max(low, last_[i] - step)", "std::max(low, last_[i] - 1.01 * step)"),
    ("output_gate", "std::min(high, last_[i] + step)", "std::min(high, last_[i] + 1.01 * step)"),
    ("output_gate", "> tolerance) return tiller_status_command_limited;",
     "> tolerance) return tiller_status_rate_limited;"),
    ("output_gate", "std::abs(within - value) > tolerance", "std::abs(within - value) < tolerance"),
    ("output_gate", "kRounding = 1e-6", "kRounding = 0.0"),
    ("output_gate", "usable ? wanted : all_finite(fallback)", "usable ? wanted : true"),
    ("output_gate", "usable ? wanted : all_finite(fallback) ? fallback :", "usable ? wanted :"),
    ("output_gate", "const bool usable = all_finite(wanted);", "const bool usable = true;"),
    ("output_gate", "if (status == tiller_status_ok) status = limited;", "status = limited;"),
    ("output_gate", "if (status != tiller_status_ok) ++cuts_;", "++cuts_;"),
    ("output_gate", "    ++rejections_;", ""),
    ("output_gate", "    status = tiller_status_command_not_finite;", ""),
    ("output_gate", "  std::copy(out, out + limits_.count, last_);\n  return status;", "  return status;"),
    ("output_gate", "out);\n  std::copy(out, out + limits_.count, last_);\n}", "out);\n}"),
    ("output_gate", "std::copy(limits_.safe_command, limits_.safe_command + limits_.count, out);",
     "std::copy(last_, last_ + limits_.count, out);"),

    ("state_machine", "if (next == kRefused) return tiller_status_wrong_state;", ""),
    ("state_machine", "if (next == kRefused) return tiller_status_wrong_state;",
     "if (next == kRefused) return tiller_status_ok;"),
    ("state_machine", "state_ = static_cast<tiller_state_t>(next);", ""),
    ("state_machine", "if (event == Event::arm) armed_ = true;", ""),
    ("state_machine", "if (event == Event::arm) armed_ = true;", "armed_ = true;"),
    ("state_machine", "event == Event::disarm || ", ""),
    ("state_machine", "event == Event::reset || ", ""),
    ("state_machine", " || state_ == tiller_state_safe) armed_ = false;", ") armed_ = false;"),
    ("state_machine", "state_ == tiller_state_hold || ", ""),
    ("state_machine", "tiller_state_hold || state_ == tiller_state_safe;", "tiller_state_hold;"),
    ("state_machine", "if (!at_fault) first_fault_ = tiller_status_ok;", ""),
    ("state_machine", "if (at_fault && first_fault_ == tiller_status_ok) first_fault_ = why;",
     "if (at_fault) first_fault_ = why;"),
    ("state_machine", "if (at_fault && first_fault_ == tiller_status_ok) first_fault_ = why;", ""),

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
            yield (f"state_machine: {row[1]}, event {i}: {entry} -> {other}", "state_machine",
                   text[:row.start(2)] + ", ".join(changed) + text[row.end(2):])


def all_mutants():
    texts = {p.stem: p.read_text(encoding="utf-8") for p in SAFETY.glob("*.cpp")}
    mutants = list(table_mutants(texts["state_machine"]))
    for name, old, new in LINES:
        if texts[name].count(old) < 1:
            sys.exit(f"mutants: {name}.cpp no longer holds: {old!r}")
        what = f"{name}: {' '.join(old.split())} -> {' '.join(new.split()) or 'nothing'}"
        mutants.append((what, name, texts[name].replace(old, new, 1)))
    return texts, mutants


class Bench:
    """Objects of everything once; then one source and a link a mutant."""

    def __init__(self, folder, sources):
        self.folder = pathlib.Path(folder)
        self.compiler = os.environ.get("CXX", "c++")
        self.flags = ["-std=c++17", "-O1", f"-I{ROOT}", f"-I{ROOT / 'runtime'}", f"-I{ROOT / 'runtime/include'}"]
        self.objects = {name: self.compile(SAFETY / f"{name}.cpp", name) for name in sources}
        self.others = [self.compile(path, path.stem) for path in
                       [*sorted((ROOT / "tests/safety").glob("*_test.cpp")), *sorted((ROOT / "runtime/core").glob("*.cpp"))]]

    def compile(self, path, name):
        out = self.folder / f"{name}.o"
        done = subprocess.run([self.compiler, *self.flags, "-c", path, "-o", out], capture_output=True, text=True,
                              check=False)
        if done.returncode != 0:
            raise ValueError(done.stderr)
        return out

    def tests_pass(self, name, text):
        path = self.folder / "mutant.cpp"
        path.write_text(text, encoding="utf-8")
        objects = {**self.objects, name: self.compile(path, "mutant")}
        program = self.folder / "tests"
        subprocess.run([self.compiler, *objects.values(), *self.others, "-lgtest", "-lgtest_main", "-lpthread", "-o",
                        program], check=True)
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
