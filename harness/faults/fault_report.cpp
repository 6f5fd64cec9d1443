#include "harness/faults/fault_report.hpp"

#include <algorithm>
#include <cstdio>
#include <sstream>

namespace tiller::faults {
namespace {

std::string stop_text(const Fault& fault, const KindResult& r) {
  char text[64];
  if (fault.end == End::kRides) return "rides";
  std::snprintf(text, sizeof text, "%.2f s", r.worst_stop_s);
  if (fault.end == End::kStops) return text;
  std::snprintf(text, sizeof text, "%d of %d stop", r.stopped, r.runs);
  return text;
}

std::string allowed_text(const Fault& fault) {
  if (fault.end != End::kStops) return "-";
  std::string longest;
  char text[64];
  Setup setup = setup_of(Robot::kPendulum, 1);
  if (fault.prepare != nullptr) fault.prepare(setup);
  const double s = 1e-6 * static_cast<double>(timeout_us(fault.timeout, setup)) + 2.0 * setup.config.period_s;
  std::snprintf(text, sizeof text, "%.2f s (%s)", s, name_of(fault.timeout));
  return text;
}

}  // namespace

KindResult run_kind(const Fault& fault, std::uint64_t seeds, const std::vector<Robot>& robots) {
  return run_kind(seeds, robots, [&](Robot robot, std::uint64_t seed) { return run_fault(fault, robot, seed); });
}

KindResult run_kind(std::uint64_t seeds, const std::vector<Robot>& robots,
                    const std::function<Outcome(Robot, std::uint64_t)>& one) {
  KindResult r;
  for (const Robot robot : robots) {
    for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
      const Outcome o = one(robot, seed);
      ++r.runs;
      if (o.stopped_s >= 0.0) ++r.stopped;
      r.worst_stop_s = std::max(r.worst_stop_s, o.stopped_s);
      if (o.wrong == nullptr) continue;
      if (r.wrong++ == 0) {
        std::ostringstream text;
        text << name_of(robot) << ", seed " << seed << ", " << o.wrong_s << " s: " << o.wrong << " ("
             << tiller_state_name(o.state) << ", " << tiller_status_name(o.status) << ")";
        r.first_wrong = text.str();
      }
    }
  }
  return r;
}

void print_line(const Fault& fault, const KindResult& r) {
  std::printf("    %-32s %-11s %4d runs %4d wrong  %s%s%s\n", fault.name, name_of(fault.route), r.runs, r.wrong,
              stop_text(fault, r).c_str(), r.wrong ? "  " : "", r.first_wrong.c_str());
  std::fflush(stdout);
}

std::string page_row(const Fault& fault, const KindResult& r) {
  std::ostringstream row;
  row << "| " << fault.group << " | " << fault.what << " | " << name_of(fault.route) << " | " << fault.answer << " | "
      << stop_text(fault, r) << " | " << allowed_text(fault) << " |";
  return row.str();
}

}  // namespace tiller::faults
