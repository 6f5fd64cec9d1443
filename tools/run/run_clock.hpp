#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Robot time of a run, since its first measurement and since its task began, and when it is over.
class RunClock {
 public:
  /// `seconds` of the task; 0: it has no end.
  RunClock(double period_s, double seconds) : period_s_(period_s), seconds_(seconds) {}

  void start(std::int64_t now_us) { start_us_ = task_us_ = now_us_ = now_us; }
  void set(std::int64_t now_us) { now_us_ = now_us; }
  /// With the first measurement, and again when somebody has armed.
  void begin_task() { task_us_ = now_us_; }
  /// After each tick.
  void note(std::uint32_t state) { safe_ticks_ = state == tiller_state_safe ? safe_ticks_ + 1 : 0; }

  std::int64_t now_us() const { return now_us_; }
  double time_s() const { return 1e-6 * static_cast<double>(now_us_ - start_us_); }
  double task_s() const { return 1e-6 * static_cast<double>(now_us_ - task_us_); }
  bool is_first_safe_tick() const { return safe_ticks_ == 1; }
  bool is_over() const {
    return static_cast<double>(safe_ticks_) * period_s_ > kSafeFor_s || (seconds_ > 0 && task_s() >= seconds_);
  }

 private:
  static constexpr double kSafeFor_s = 0.5;  // the safe command is repeated that long before the run ends

  double period_s_, seconds_;
  std::int64_t start_us_ = 0, task_us_ = 0, now_us_ = 0;
  std::uint64_t safe_ticks_ = 0;
};

}  // namespace tiller::tools
