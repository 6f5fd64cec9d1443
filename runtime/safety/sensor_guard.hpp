#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Limits of a measurement, per measured value.
struct SensorLimits {
  std::uint32_t count = 0;       // ny
  std::uint32_t angle_mask = 0;  // bit i: value i is an angle; its differences are wrapped to +-pi
  /// bit i: values i to i + 3 are a unit quaternion, or its negative
  std::uint32_t quaternion_mask = 0;
  double low[TILLER_MAX_MEASUREMENTS] = {};
  double high[TILLER_MAX_MEASUREMENTS] = {};
  double rate_per_s[TILLER_MAX_MEASUREMENTS] = {};
  std::int64_t timeout_us = 0;     // older than this: stale
  std::int64_t ahead_us = 0;       // stamps this far beyond the caller's now are taken for clock skew
  std::uint32_t frozen_ticks = 0;  // 0: off
  std::uint32_t bad_ticks_to_safe = 1;
};

/// The answer to one tick's measurement.
struct SensorVerdict {
  tiller_status_t status = tiller_status_ok;  // ok, no_new_measurement, or why it was rejected
  bool usable = false;                        // new and valid: learn and plan from it
  bool lost = false;                          // the sensors cannot be relied on any more: SAFE
  bool clock_set = false;                     // the caller's time went back
  bool expired = false;                       // before this tick they had been silent for longer than the timeout
};

/// a - b in microseconds, held at the ends of the range instead of overflowing: stamps are the caller's.
std::int64_t elapsed_us(std::int64_t a, std::int64_t b);

/// Stands before the posterior: nothing that is old, out of order, not finite, out of range or faster than
/// physics gets into the estimate. It keeps count of rejections in a row, of the age of every value by itself
/// (one encoder may die while the others live), and of readings that repeat to the last bit.
class SensorGuard {
 public:
  SensorGuard() = default;
  explicit SensorGuard(const SensorLimits& limits) : limits_(limits) {}

  /// Judges what the caller brings at `now_us`; null: nothing new. The same measurement brought again (same
  /// stamp, same bits) is nothing new either. The first one after construction or restart must be complete;
  /// later a NaN marks a missing value.
  SensorVerdict check(std::int64_t now_us, const tiller_measurement_t* measurement);

  /// True when readings have repeated for frozen_ticks and `should_move` says that they cannot rightly do so.
  bool frozen(bool should_move) const;
  /// How many accepted measurements in a row equal the one before to the last bit.
  std::uint32_t repeats() const { return repeats_; }

  /// Forgets what was measured; the counters of the whole life stay.
  void restart();
  /// The same, but rejections in a row go on: the stamps of what was measured come from another time.
  void forget_readings();

  std::uint64_t rejected() const { return rejected_; }
  std::uint64_t missing() const { return missing_; }
  std::uint32_t bad_ticks() const { return bad_ticks_; }

 private:
  tiller_status_t judge(std::int64_t now_us, const tiller_measurement_t& measurement) const;
  tiller_status_t judge_stamp(std::int64_t now_us, std::int64_t stamp_us) const;
  bool is_attitude(const double* value) const;
  double sign_of(std::uint32_t i, const double* value) const;
  tiller_status_t judge_value(std::uint32_t i, const double* values, std::int64_t stamp_us) const;
  void accept(const tiller_measurement_t& measurement);
  bool repeated(const tiller_measurement_t& measurement) const;
  bool stale(std::int64_t now_us) const;

  SensorLimits limits_;
  bool started_ = false;                                // a measurement has been accepted
  bool clocked_ = false;                                // now_us_ is known
  std::int64_t now_us_ = 0;                             // of the last check
  std::int64_t still_us_ = 0;                           // ticks without news while the clock stood still
  std::int64_t stamp_us_ = 0;                           // of the last accepted measurement
  double value_[TILLER_MAX_MEASUREMENTS] = {};          // last accepted, as it came (NaN where missing)
  double seen_[TILLER_MAX_MEASUREMENTS] = {};           // last value that was not missing
  std::int64_t seen_us_[TILLER_MAX_MEASUREMENTS] = {};  // and its stamp
  std::uint32_t repeats_ = 0;
  std::uint32_t bad_ticks_ = 0;
  std::uint64_t rejected_ = 0;
  std::uint64_t missing_ = 0;
};

}  // namespace tiller
