#pragma once

#include <algorithm>
#include <iterator>
#include <limits>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Limits of a trial: the model may rest, and leave what the sensors may say. A controller that has latched SAFE does no
/// work, and nothing of it could be measured.
inline void never_tire(tiller_safety_config_t& safety) {
  const double inf = std::numeric_limits<double>::infinity();
  safety.frozen_ticks = 0;
  std::fill(std::begin(safety.measurement_low), std::end(safety.measurement_low), -inf);
  std::fill(std::begin(safety.measurement_high), std::end(safety.measurement_high), inf);
  std::fill(std::begin(safety.measurement_rate_per_s), std::end(safety.measurement_rate_per_s), inf);
}

}  // namespace tiller::tools
