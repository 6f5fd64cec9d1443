#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A spring that stiffens, about position 0. Implicit midpoint rule: the middle x solves x + y k x^3 = middle, by
/// three Newton steps from above, where they converge from one side.
template <class S>
struct CubicSpring {
  static constexpr Hook hook = Hook::elastic;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "cubic_spring";
    i.param_count = 1;
    i.params[0] = {
        "stiffness_SI3", "N/m^3 or N m/rad^3", 0.0, __builtin_huge_val(), Scale::force_per_position3, 1, {0.2}};
    i.needs_position = true;
    i.help = "a spring about position 0 that stiffens";
    i.equation = "force = -stiffness q^3";
    i.source = "Duffing (1918), Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz";
    i.aliases[0] = "linear_spring";
    i.separation = "excursions a factor of three apart";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    const S y = yield(in);
    S x = in.middle, step = S(0.0);
    for (int k = 0; k < 3; ++k) {
      x = x + step;
      step = -(x - in.middle + y * p[0] * x * x * x) / (S(1.0) + S(3.0) * y * p[0] * x * x);
    }
    return -p[0] * (x * x * x + S(3.0) * x * x * step);  // of the last step's straight line
  }
};

}  // namespace tiller
