// The parts of ./dev bench robot that are programs of their own: faults, gate, soak, integrity, loss. robot.py runs
// them all.

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>

#include "bench/table/bench_table.hpp"
#include "harness/faults/fault.hpp"
#include "harness/faults/fault_loss.hpp"
#include "harness/faults/fault_refusals.hpp"
#include "harness/faults/fault_report.hpp"
#include "harness/faults/integrity.hpp"
#include "harness/faults/soak.hpp"
#include "harness/gate_storm/gate_storm.hpp"

namespace tiller::faults {
namespace {

using bench::at_least;
using bench::at_most;
using bench::Table;

struct Options {
  std::string section;
  std::uint64_t seeds = 20;
  std::uint64_t commands = 100000000;
  std::uint64_t ticks = 8640000;
  std::uint64_t trials = 1000000;
  std::uint32_t moves = 8;
  std::string kind;  ///< this one alone
  std::string page;  ///< the table of docs/evidence/faults.md is written between its marks
};

/// Replaces what stands between the marks of a page.
bool write_between_marks(const std::string& path, const std::string& table) {
  static constexpr char kBegin[] = "<!-- made by ./dev bench robot -->\n", kEnd[] = "<!-- end -->\n";
  std::ifstream in(path);
  std::stringstream whole;
  whole << in.rdbuf();
  std::string text = whole.str();
  const std::size_t begin = text.find(kBegin), end = text.find(kEnd);
  if (begin == std::string::npos || end == std::string::npos) return false;
  text.replace(begin + sizeof kBegin - 1, end - begin - sizeof kBegin + 1, table);
  std::ofstream out(path);
  out << text;
  return static_cast<bool>(out);
}

void faults(const Options& options, Table& table) {
  table.heading("fault matrix, " + std::to_string(all_faults().size()) + " kinds x " + std::to_string(options.seeds) +
                " seeds x 2 plants");
  std::ostringstream page;
  page << "| group | fault | over | what tiller does | stopped after, worst | allowed |\n|---|---|---|---|---|---|\n";
  double runs = 0, wrong = 0;
  for (const Fault& fault : all_faults()) {
    if (!options.kind.empty() && options.kind != fault.name) continue;
    const KindResult r = run_kind(fault, options.seeds);
    runs += r.runs;
    wrong += r.wrong;
    print_line(fault, r);
    page << page_row(fault, r) << "\n";
  }
  int refused = 0, refusals = 0;
  for (const Refusal& r : all_refusals()) {
    page << "| configuration | " << r.what << " | - | refused by `tiller_init`: there is no controller | - | - |\n";
    for (const Robot robot : kRobots) {
      ++refusals;
      refused += is_refused(r, robot);
    }
  }
  table.row("kinds", static_cast<double>(all_faults().size()), "", at_least(60));
  table.row("configurations that do not fit, refused", 100.0 * refused / refusals, "%", at_least(100));
  table.row("safe within the timeout plus two ticks, no limit violated", 100.0 * (runs - wrong) / runs, "%",
            at_least(100));
  table.row("runs", runs, "");
  if (!options.page.empty() && !write_between_marks(options.page, page.str()))
    std::fprintf(stderr, "bench_robot: %s has no marks for the table\n", options.page.c_str());
}

void gate(const Options& options, Table& table) {
  const StormResult r = GateStorm(1).run(options.commands);
  table.heading("output gate, random and adversarial commands");
  table.row("commands", static_cast<double>(r.commands), "", at_least(1e8));
  table.row("escapes: not finite", static_cast<double>(r.not_finite), "", at_most(0));
  table.row("escapes: beyond a limit", static_cast<double>(r.beyond_limit), "", at_most(0));
  table.row("escapes: beyond a rate", static_cast<double>(r.beyond_rate), "", at_most(0));
  table.row("escapes: outside a cone", static_cast<double>(r.beyond_cone), "", at_most(0));
  table.row("commands in order that came out changed", static_cast<double>(r.altered), "", at_most(0));
  table.row("cut to a limit", 100.0 * static_cast<double>(r.cut) / static_cast<double>(r.commands), "%");
  table.row("replaced for not being finite", 100.0 * static_cast<double>(r.rejected) / static_cast<double>(r.commands),
            "%");
}

void soak(const Options& options, Table& table) {
  SoakCase wrapping;
  wrapping.ticks = options.ticks;
  wrapping.moves = options.moves;
  wrapping.progress = true;
  wrapping.first_sequence = 0u - static_cast<std::uint32_t>(options.ticks / 2);
  wrapping.first_stamp_us = (std::int64_t{1} << 32) - static_cast<std::int64_t>(options.ticks / 2) * 10000;
  const SoakOutcome first = run_soak(wrapping), second = run_soak(wrapping);
  table.heading("soak, lockstep at 100 Hz; numbers wrap and stamps pass 2^32 us half way");
  table.row("ticks", static_cast<double>(first.ticks), "", at_least(8640000));
  table.row("ticks with a fault", static_cast<double>(first.faults), "", at_most(0));
  table.row("ticks out of ACTIVE", static_cast<double>(first.not_active), "", at_most(0));
  table.row("measurements without their answer", static_cast<double>(first.unanswered), "", at_most(0));
  table.row("growth of the heap", static_cast<double>(first.heap_growth_bytes), "bytes", at_most(0));
  table.row("growth of resident memory", static_cast<double>(first.resident_growth_bytes), "bytes", at_most(65536));
  table.row("of that: not pages of the program's files", static_cast<double>(first.own_growth_bytes), "bytes",
            at_most(65536));
  table.row("commands of the repeat that differ (hash)", first.hash == second.hash ? 0.0 : 1.0, "", at_most(0));
  table.row("largest angle from upright", first.worst_angle_rad, "rad");
}

void events(const Options& options, Table& table) {
  SoakCase eventful;
  eventful.ticks = options.ticks;
  eventful.eventful = true;
  eventful.moves = options.moves;
  eventful.progress = true;
  const SoakOutcome first = run_soak(eventful), second = run_soak(eventful);
  table.heading("soak with events, lockstep at 100 Hz: clocks, silence, masses, pushes, bad readings and calls, stops");
  table.row("ticks", static_cast<double>(first.ticks), "", at_least(1e8));
  for (int i = 0; i < static_cast<int>(SoakEvent::count); ++i) {
    const std::string name = name_of(static_cast<SoakEvent>(i));
    table.row("events: " + name, static_cast<double>(first.events[i]), "");
    table.row("of these not ACTIVE and upright 6 s later", static_cast<double>(first.unrecovered_after[i]), "");
  }
  table.row("resets after SAFE", static_cast<double>(first.resets), "");
  table.row("times learnt again", static_cast<double>(first.relearned), "");
  table.row("unsafe commands", static_cast<double>(first.unsafe), "", at_most(0));
  table.row("not ACTIVE and upright 6 s after an event", static_cast<double>(first.unrecovered), "", at_most(0));
  table.row("ticks 3 s after an event: mass wrong and certain (a tenth and 4 deviations off)",
            static_cast<double>(first.deceived) / static_cast<double>(first.settled), "");
  table.row("calls without a value that were not refused", static_cast<double>(first.taken), "", at_most(0));
  table.row("ticks with a belief that is not finite", static_cast<double>(first.not_finite), "", at_most(0));
  table.row("growth of the heap", static_cast<double>(first.heap_growth_bytes), "bytes", at_most(0));
  table.row("growth of resident memory", static_cast<double>(first.resident_growth_bytes), "bytes", at_most(65536));
  table.row("commands of the repeat that differ (hash)", first.hash == second.hash ? 0.0 : 1.0, "", at_most(0));
}

void integrity(const Options& options, Table& table) {
  const auto n = options.trials;
  const auto rows = [&](const char* what, const IntegrityRow& row) {
    table.row(std::string(what) + ": trials", static_cast<double>(row.trials), "", at_least(1e6));
    table.row(std::string(what) + ": taken for genuine", static_cast<double>(row.passed), "", at_most(0));
  };
  table.heading("integrity of own frames (CRC-8, counters) and messages (key)");
  rows("board's frames, 1 and 2 bits flipped", flips_of_board(n));
  rows("controller's status, 1 and 2 bits flipped", flips_of_status(n));
  rows("sealed LCM messages, 1 and 2 bits flipped", flips_of_sealed(n));
  rows("board's frames repeated, swapped, replayed", disorder_of_board(n));
  rows("sealed messages repeated, swapped, replayed", disorder_of_sealed(n));
  // what the counters' widths let through without a key: numbers that have wrapped pass (docs/reference/security.md)
  table.row("a replayed measurement on CAN is refused for", 0x1p23, "frames");
  table.row("a replayed 8-bit counter (E2E frames) is refused for", 240, "frames");
}

void loss_rows(const Options& options, Table& table, double loss, std::int64_t jitter_us) {
  int up = 0, safe = 0;
  double stale = 0, age = 0, motor_age = 0;
  for (std::uint64_t seed = 1; seed <= options.seeds; ++seed) {
    LossCase c;
    c.loss = loss;
    c.jitter_us = jitter_us;
    const LossOutcome o = run_loss(c, seed);
    up += o.up;
    safe += o.safe;
    stale += static_cast<double>(o.stale);
    age = std::max(age, o.worst_age_s);
    motor_age = std::max(motor_age, o.worst_motor_age_s);
  }
  char what[96];
  std::snprintf(what, sizeof what, "%.0f %% of frames lost, 0..%.0f ms late: ", 100.0 * loss,
                1e-3 * static_cast<double>(jitter_us));
  const bool promised = loss <= 0.1 && jitter_us <= 5000;
  const double n = static_cast<double>(options.seeds);
  table.row(std::string(what) + "up", 100.0 * up / n, "%", promised ? at_least(100) : bench::Goal{});
  table.row(std::string(what) + "SAFE", 100.0 * safe / n, "%");
  table.row(std::string(what) + "stale commands", stale, "", at_most(0));
  table.row(std::string(what) + "oldest basis", 1e3 * age, "ms", at_most(200));
  table.row(std::string(what) + "at the motor", 1e3 * motor_age, "ms", at_most(440));
}

void loss(const Options& options, Table& table) {
  table.heading("loss on an emulated bus, pendulum, 20 s, timeouts of 0.2 s");
  loss_rows(options, table, 0.0, 0);
  loss_rows(options, table, 0.1, 5000);
  loss_rows(options, table, 0.2, 5000);
  loss_rows(options, table, 0.1, 15000);
  loss_rows(options, table, 0.5, 15000);
  loss_rows(options, table, 0.8, 15000);
}

int usage() {
  std::fprintf(
      stderr,
      "usage: bench_robot faults|gate|soak|events|integrity|loss [--seeds N] [--commands N] [--ticks N] [--trials N]\n"
      "         [--moves N] [--kind NAME] [--page FILE]\n"
      "  faults  every kind of fault from N seeds on two plants (20); --kind: one\n"
      "          alone; --page writes docs/evidence/faults.md's table\n"
      "  gate    N commands into the output gate (1e8)\n"
      "  soak    N ticks in lockstep, twice (8640000)\n"
      "  events  the same while something happens every few seconds; --moves of particles a tick (8): with 0\n"
      "          nothing is learnt again, and a tick takes a fifth of the time\n"
      "  integrity  own frames and messages damaged, repeated, replayed, N trials each (1e6)\n"
      "  loss    the pendulum over an emulated bus that loses frames (20 seeds)\n");
  return 2;
}

bool parse(int argc, char** argv, Options& o) {
  if (argc < 2) return false;
  o.section = argv[1];
  for (int i = 2; i + 1 < argc; i += 2) {
    const std::string key = argv[i];
    const auto number = static_cast<std::uint64_t>(std::strtod(argv[i + 1], nullptr));
    if (key == "--seeds")
      o.seeds = number;
    else if (key == "--commands")
      o.commands = number;
    else if (key == "--ticks")
      o.ticks = number;
    else if (key == "--trials")
      o.trials = number;
    else if (key == "--moves")
      o.moves = static_cast<std::uint32_t>(number);
    else if (key == "--kind")
      o.kind = argv[i + 1];
    else if (key == "--page")
      o.page = argv[i + 1];
    else
      return false;
  }
  return argc % 2 == 0 && o.seeds > 0;
}

int run(int argc, char** argv) {
  Options options;
  if (!parse(argc, argv, options)) return usage();
  Table table;
  if (options.section == "faults")
    faults(options, table);
  else if (options.section == "gate")
    gate(options, table);
  else if (options.section == "soak")
    soak(options, table);
  else if (options.section == "events")
    events(options, table);
  else if (options.section == "integrity")
    integrity(options, table);
  else if (options.section == "loss")
    loss(options, table);
  else
    return usage();
  return table.finish();
}

}  // namespace
}  // namespace tiller::faults

int main(int argc, char** argv) { return tiller::faults::run(argc, argv); }
