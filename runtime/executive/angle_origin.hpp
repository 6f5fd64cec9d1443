#pragma once

#include <cmath>
#include <cstdint>

#include "rollout/turns.hpp"

namespace tiller {

/// Which whole turns planners do not see: none for an angle within kFarTurns, else those that brought it where it was
/// when it came as far from the origin before. It moves seldom, for a plan of another frame is no warm start.
class AngleOrigin {
 public:
  /// `periodic`: bits of the angles that repeat with every turn.
  void lay_out(std::uint32_t periodic) { periodic_ = periodic; }

  /// `state` (nx) is the present estimate; values that are not finite change nothing.
  void follow(const double* state) {
    for (std::uint32_t i = 0; i < TILLER_MAX_STATES; ++i)
      if (((periodic_ >> i) & 1u) && std::isfinite(state[i]) && far_turns(state[i] - origin_[i]) != 0.0)
        origin_[i] = far_turns(state[i]);
  }

  const double* value() const { return origin_; }  // (TILLER_MAX_STATES)

 private:
  std::uint32_t periodic_ = 0;
  double origin_[TILLER_MAX_STATES] = {};
};

}  // namespace tiller
