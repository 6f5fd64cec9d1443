#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Whether a controller in this state (tiller_state_t) moves the robot: ACTIVE or HOLD.
inline bool in_motion(std::uint32_t state) { return state == tiller_state_active || state == tiller_state_hold; }

}  // namespace tiller::tools
