#include "safety/sensor_guard.hpp"

#include <cmath>
#include <cstring>
#include <limits>

namespace tiller {
namespace {

constexpr double kTwoPi = 6.283185307179586;

}  // namespace

std::int64_t elapsed_us(std::int64_t a, std::int64_t b) {
  std::int64_t difference = 0;
  if (!__builtin_sub_overflow(a, b, &difference)) return difference;
  return a > b ? std::numeric_limits<std::int64_t>::max() : std::numeric_limits<std::int64_t>::min();
}

void SensorGuard::restart() {
  forget_readings();
  bad_ticks_ = 0;
}

void SensorGuard::forget_readings() {
  started_ = false;
  still_us_ = 0;
  repeats_ = 0;
}

SensorVerdict SensorGuard::check(std::int64_t now_us, const tiller_measurement_t* measurement) {
  const std::int64_t back_us = clocked_ && now_us < now_us_ ? elapsed_us(now_us_, now_us) : 0;
  const bool went_back = back_us > 0, was_set = back_us > limits_.ahead_us;
  // a clock that stands still or goes back by less than a period ages nothing: each such tick then counts for a period
  // more than it seems to
  if (clocked_ && now_us <= now_us_ && !was_set) still_us_ += back_us + limits_.ahead_us;
  now_us_ = now_us;
  clocked_ = true;

  SensorVerdict verdict;
  verdict.clock_set = went_back;
  // told even where a reading is here now: whoever did not tick meanwhile (a stopped process) has not heard of it
  verdict.expired = stale(now_us);
  if (went_back) {
    // no age can be told at this tick, not even that of the last measurement
    verdict.status = tiller_status_time_backwards;
  } else if (measurement == nullptr || repeated(*measurement)) {
    verdict.status = tiller_status_no_new_measurement;
  } else {
    verdict.status = judge(now_us, *measurement);
  }

  if (verdict.status == tiller_status_ok) {
    accept(*measurement);
    still_us_ = 0;
    bad_ticks_ = 0;
    verdict.usable = true;
  } else if (verdict.status != tiller_status_no_new_measurement) {
    ++rejected_;
    if (bad_ticks_ < std::numeric_limits<std::uint32_t>::max()) ++bad_ticks_;
    // whatever was measured is of unknown age, and silence from here on would begin anew
    verdict.lost = was_set || bad_ticks_ >= limits_.bad_ticks_to_safe;
  }
  if (stale(now_us)) {
    // a rejection keeps its own reason: it is why nothing fresh came in
    if (verdict.status == tiller_status_ok || verdict.status == tiller_status_no_new_measurement)
      verdict.status = tiller_status_sensor_stale;
    verdict.usable = false;
    verdict.lost = true;
  }
  return verdict;
}

bool SensorGuard::frozen(bool should_move) const {
  return should_move && limits_.frozen_ticks != 0 && repeats_ >= limits_.frozen_ticks;
}

tiller_status_t SensorGuard::judge(std::int64_t now_us, const tiller_measurement_t& measurement) const {
  const tiller_status_t stamp = judge_stamp(now_us, measurement.stamp_us);
  if (stamp != tiller_status_ok) return stamp;

  std::uint32_t present = 0;
  for (std::uint32_t i = 0; i < limits_.count; ++i) {
    if (std::isnan(measurement.value[i])) continue;
    ++present;
    const tiller_status_t value = judge_value(i, measurement.value, measurement.stamp_us);
    if (value != tiller_status_ok) return value;
  }
  // without any value there is nothing to learn from; a filter cannot begin on half a measurement
  const bool enough = started_ ? present > 0 : present == limits_.count;
  return enough ? tiller_status_ok : tiller_status_sensor_not_finite;
}

tiller_status_t SensorGuard::judge_stamp(std::int64_t now_us, std::int64_t stamp_us) const {
  const std::int64_t age_us = elapsed_us(now_us, stamp_us);
  if (age_us > limits_.timeout_us) return tiller_status_sensor_stale;
  // a stamp from the future tells that the clocks differ: the true age is unknown, so it is not fresh
  if (age_us < -limits_.ahead_us) return tiller_status_sensor_stale;
  if (started_ && stamp_us <= stamp_us_) return tiller_status_time_backwards;
  return tiller_status_ok;
}

/// Of unit length, nearly: a tracker that has lost its body sends zeros. One that is not whole is none (missing).
bool SensorGuard::is_attitude(const double* value) const {
  constexpr double kMost = 0.1;
  double square = 0.0;
  for (int k = 0; k < 4; ++k) square += value[k] * value[k];
  return !(std::fabs(std::sqrt(square) - 1.0) > kMost);
}

/// q and -q are one attitude: -1 where value i belongs to one that is nearer to the last with its sign changed.
double SensorGuard::sign_of(std::uint32_t i, const double* values) const {
  for (std::uint32_t k = 0; k < 4 && k <= i; ++k) {
    const std::uint32_t first = i - k;
    if (!((limits_.quaternion_mask >> first) & 1u)) continue;
    double product = 0.0;
    for (std::uint32_t j = first; j < first + 4; ++j) product += values[j] * seen_[j];
    return product < 0.0 ? -1.0 : 1.0;
  }
  return 1.0;
}

tiller_status_t SensorGuard::judge_value(std::uint32_t i, const double* values, std::int64_t stamp_us) const {
  const double value = values[i];
  if (!std::isfinite(value)) return tiller_status_sensor_not_finite;
  // whatever the robot allows: its image in single precision, a difference or a square would be of no use
  if (std::fabs(value) > TILLER_LARGEST_VALUE) return tiller_status_sensor_out_of_range;
  if (value < limits_.low[i] || value > limits_.high[i]) return tiller_status_sensor_out_of_range;
  if (((limits_.quaternion_mask >> i) & 1u) && !is_attitude(values + i)) return tiller_status_sensor_out_of_range;
  if (!started_ || std::isinf(limits_.rate_per_s[i])) return tiller_status_ok;

  double change = (limits_.quaternion_mask == 0 ? 1.0 : sign_of(i, values)) * value - seen_[i];
  if ((limits_.angle_mask >> i) & 1u) change = std::remainder(change, kTwoPi);
  const double time_s = static_cast<double>(elapsed_us(stamp_us, seen_us_[i])) * 1e-6;
  return std::abs(change) > limits_.rate_per_s[i] * time_s ? tiller_status_sensor_jump : tiller_status_ok;
}

void SensorGuard::accept(const tiller_measurement_t& measurement) {
  const std::size_t bytes = limits_.count * sizeof(double);
  const bool same = started_ && std::memcmp(value_, measurement.value, bytes) == 0;
  repeats_ = !same ? 0 : repeats_ + (repeats_ < std::numeric_limits<std::uint32_t>::max() ? 1 : 0);
  std::memcpy(value_, measurement.value, bytes);
  for (std::uint32_t i = 0; i < limits_.count; ++i) {
    if (std::isnan(measurement.value[i])) {
      ++missing_;
      continue;
    }
    seen_[i] = measurement.value[i];
    seen_us_[i] = measurement.stamp_us;
  }
  stamp_us_ = measurement.stamp_us;
  started_ = true;
}

bool SensorGuard::repeated(const tiller_measurement_t& measurement) const {
  return started_ && measurement.stamp_us == stamp_us_ &&
         std::memcmp(value_, measurement.value, limits_.count * sizeof(double)) == 0;
}

bool SensorGuard::stale(std::int64_t now_us) const {
  if (!started_) return false;
  for (std::uint32_t i = 0; i < limits_.count; ++i)
    if (elapsed_us(now_us, seen_us_[i]) > limits_.timeout_us - still_us_) return true;
  return false;
}

}  // namespace tiller
