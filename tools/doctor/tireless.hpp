#pragma once

#include <cmath>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Limits of a trial: the model may rest, and leave what the sensors may say. A controller that has latched SAFE does
/// no work, and nothing of it could be measured.
inline void never_tire(tiller_safety_config_t& safety) {
  safety.frozen_ticks = 0;
  for (double& force : safety.contact_force) force = HUGE_VAL;
  safety.measurement_low = safety.measurement_high = safety.measurement_rate_per_s = nullptr;
}

}  // namespace tiller::tools
