#pragma once

#include <cstdint>
#include <optional>

#include "tiller/tiller.h"
#include "tools/robot/in_motion.hpp"

namespace tiller::tools {

/// Which row of a reference is due: the control periods since the robot began to move, counted as the controller counts
/// them. Motion is ACTIVE or HOLD; after a pause the task begins again.
class TaskClock {
 public:
  /// After each tick: its number and the state that it ended in. Empty while nothing moves.
  std::optional<std::uint64_t> step(std::uint64_t tick, tiller_state_t state) {
    const bool moves = in_motion(state);
    if (moves && !moved_) first_ = tick;
    moved_ = moves;
    return moves ? std::optional(tick - first_) : std::nullopt;
  }

 private:
  std::uint64_t first_ = 0;
  bool moved_ = false;
};

}  // namespace tiller::tools
