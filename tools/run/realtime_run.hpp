#pragma once

#include <string>

#include "io/realtime.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The calling thread, and those that it makes, as [realtime] asks, for as long as an object of this class lives.
class RealtimeGuard {
 public:
  /// `wanted` false, or no such section: nothing is touched.
  RealtimeGuard(const RobotFile& robot, bool wanted);
  ~RealtimeGuard();
  RealtimeGuard(const RealtimeGuard&) = delete;
  RealtimeGuard& operator=(const RealtimeGuard&) = delete;

  const RealtimeReport& report() const { return report_; }

 private:
  RealtimeReport report_;
};

/// How a run went by the wall clock.
struct PaceResult {
  RealtimeReport realtime;
  LatencyHistogram tick_time;         ///< tiller_tick alone
  LatencyHistogram wake_up;           ///< how late a tick by the clock began; empty where measurements set the pace
  std::uint64_t overruns = 0;         ///< ticks after which the next was due, or would have been in simulated time
  std::uint64_t skipped_periods = 0;  ///< by the clock: that had no tick
};

/// "real time: SCHED_FIFO 80, memory locked, ..." and what it did not get, with the remedy; empty where nothing was
/// asked.
std::string realtime_text(const RobotFile& robot, const RealtimeReport& report);
/// The histograms as CSV: upper edge of a bin in microseconds, ticks, wake-ups; empty bins are left out.
std::string histogram_csv(const PaceResult& pace);

}  // namespace tiller::tools
