#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/arena.hpp"
#include "safety/sensor_guard.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// The last finite plan and when its first input was meant to act: what stays in force while no new
/// measurement comes. Steps are found by time, not by counting ticks, so a caller may poll faster than the
/// control period.
class PlanMemory {
 public:
  void lay_out(Arena& arena, const tiller_config_t& config) {
    nu_ = config.model->input_count;
    horizon_ = config.planner.horizon;
    period_s_ = config.period_s;
    inputs_ = arena.take<double>(std::size_t{horizon_} * nu_);
  }

  void clear() { valid_ = false; }

  /// sequence (horizon x nu); `command` (nu) is what goes out first, in full precision.
  void keep(std::int64_t now_us, const float* sequence, const double* command) {
    std::copy(sequence, sequence + std::size_t{horizon_} * nu_, inputs_);
    std::copy(command, command + nu_, inputs_);
    begin_us_ = now_us;
    valid_ = true;
  }

  /// Index of the step in force at `now_us`; the horizon if there is none.
  std::uint32_t step_at(std::int64_t now_us) const {
    if (!valid_) return horizon_;
    const double steps = static_cast<double>(elapsed_us(now_us, begin_us_)) * 1e-6 / period_s_;
    if (!(steps > 0.0)) return 0;
    // a tenth of a step of grace on jitter: a tick that comes a little before its period is up is the next
    // step
    return static_cast<std::uint32_t>(std::min<double>(std::floor(steps + 0.1), horizon_));
  }

  bool exhausted(std::int64_t now_us) const { return step_at(now_us) >= horizon_; }
  /// (nu); step < horizon
  const double* step(std::uint32_t index) const { return inputs_ + std::size_t{index} * nu_; }
  std::uint32_t horizon() const { return horizon_; }

 private:
  double* inputs_ = nullptr;  // (horizon x nu)
  std::uint32_t nu_ = 0, horizon_ = 0;
  double period_s_ = 0.0;
  std::int64_t begin_us_ = 0;
  bool valid_ = false;
};

}  // namespace tiller
