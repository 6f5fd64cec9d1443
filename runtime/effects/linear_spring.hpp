#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A spring about position 0 by the implicit midpoint rule, which keeps its energy at any step.
template <class S>
struct LinearSpring {
  static constexpr Hook hook = Hook::elastic;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "linear_spring";
    i.param_count = 1;
    i.params[0] = {"stiffness_SI", "N/m or N m/rad", 0.0, __builtin_huge_val(), Scale::force_per_position, 1, {0.2}};
    i.needs_position = true;
    i.help = "a spring about position 0";
    i.equation = "force = -stiffness q";
    i.aliases[0] = "cubic_spring";
    i.aliases[1] = "sensor_scale";
    i.separation = "excursions a factor of three apart, and a static load: a spring holds against it";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) { return -(p[0] * in.middle) / (S(1.0) + p[0] * yield(in)); }
};

}  // namespace tiller
