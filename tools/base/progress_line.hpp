#pragma once

#include <chrono>
#include <mutex>
#include <string>

namespace tiller::tools {

/// A line on stderr for work whose share is known: what it is, the percent done, the seconds so far and those left. On
/// a terminal the line is rewritten, at most five times a second, and goes away at the end; elsewhere it is told after
/// two seconds, and then every ten. Work that takes less than two seconds leaves nothing. Any thread may show.
class ProgressLine {
 public:
  explicit ProgressLine(std::string what);
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;
  void show(double share);  ///< 0..1; a share below an earlier one is taken for that

 private:
  using Clock = std::chrono::steady_clock;
  const std::string what_;
  const bool terminal_;
  const Clock::time_point started_;
  std::mutex mutex_;
  double next_s_, share_ = 0;
  bool shown_ = false;
};

}  // namespace tiller::tools
