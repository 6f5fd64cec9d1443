#pragma once

#include "costs/cost_term_info.hpp"

namespace tiller {

/// A circle to keep out of, in the plane of two states. At the centre there is no way out that is shorter than the
/// others: the derivative is 0 there (scalar/dual.hpp).
struct Obstacle {
  static constexpr CostTermInfo info = [] {
    CostTermInfo i;
    i.name = "obstacle";
    i.help = "A circle in the plane of two states of the model.";
    i.equation = "max(0, radius - distance)";
    i.weight_unit = "1/m^2";
    i.penalty = i.circle = true;
    i.state_count = 2;
    i.states[0] = {"x_state", "the state that is the plane's first axis"};
    i.states[1] = {"y_state", "and the second"};
    i.param_count = 3;
    i.params[0] = {"x_m", "m", -TILLER_LARGEST_VALUE, TILLER_LARGEST_VALUE, "centre", 0};
    i.params[1] = {"y_m", "m", -TILLER_LARGEST_VALUE, TILLER_LARGEST_VALUE, "centre", 1};
    i.params[2] = {"radius_m", "m", TILLER_SMALLEST_SCALE, TILLER_LARGEST_SCALE,
                   "the robot's own radius and any margin included"};
    return i;
  }();
  template <class S>
  static S residual(const S* x, const S* p) {
    const S dx = x[0] - p[0], dy = x[1] - p[1];
    return max(p[2] - sqrt(dx * dx + dy * dy), S(0.0));
  }
};

}  // namespace tiller
