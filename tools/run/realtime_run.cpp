#include "tools/run/realtime_run.hpp"

#include <cstring>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

std::string processors(std::uint64_t cpus) {
  Words names;
  for (int i = 0; i < 64; ++i)
    if (cpus >> i & 1u) names.push_back(std::to_string(i));
  return (names.size() == 1 ? "processor " : "processors ") + join(names);
}

std::string what(const RobotFile& robot, RealtimePart part) {
  switch (part) {
    case RealtimePart::priority: return format("SCHED_FIFO %d", robot.realtime.priority);
    case RealtimePart::memory: return "memory locked";
    case RealtimePart::cpus: return processors(robot.realtime.cpus);
    case RealtimePart::stack: return format("%u kB of stack touched", robot.realtime.stack_kB);
  }
  return "";
}

}  // namespace

RealtimeGuard::RealtimeGuard(const RobotFile& robot, bool wanted) {
  const RealtimeSection& section = robot.realtime;
  if (!wanted || section.line == 0) return;
  RealtimeOptions options;
  options.priority = section.priority;
  options.lock_memory = section.lock_memory;
  options.cpus = section.cpus;
  options.stack_bytes = std::size_t{1024} * section.stack_kB;
  report_ = realtime_begin(options);
}

RealtimeGuard::~RealtimeGuard() { realtime_end(report_); }

std::string realtime_text(const RobotFile& robot, const RealtimeReport& report) {
  Words given;
  std::string refused;
  for (int i = 0; i < kRealtimeParts; ++i) {
    const RealtimeOutcome& outcome = report.part[i];
    const std::string name = what(robot, static_cast<RealtimePart>(i));
    if (outcome.given) given.push_back(name);
    if (outcome.asked && !outcome.given)
      refused += "\n  not " + name + ": " + std::strerror(outcome.error) + "; " + outcome.remedy;
  }
  if (given.empty() && refused.empty()) return "";
  return "real time: " + (given.empty() ? std::string("nothing of it was given") : join(given)) + refused;
}

std::string histogram_csv(const PaceResult& pace) {
  std::string text = "upper_us,ticks,wake_ups\n";
  for (std::uint32_t bin = 0; bin < LatencyHistogram::kBins; ++bin) {
    const auto ticks = pace.tick_time.in_bin(bin), wake_ups = pace.wake_up.in_bin(bin);
    if (ticks == 0 && wake_ups == 0) continue;
    text += format("%.3f,%llu,%llu\n", 1e-3 * static_cast<double>(LatencyHistogram::upper_edge(bin)),
                   static_cast<unsigned long long>(ticks), static_cast<unsigned long long>(wake_ups));
  }
  return text;
}

}  // namespace tiller::tools
