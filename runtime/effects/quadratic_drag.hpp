#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Drag of a fluid. Kahan's discretisation, v^2 -> v v+: second order, exact for free decay, and stable at any step.
template <class S>
struct QuadraticDrag {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "quadratic_drag";
    i.param_count = 1;
    i.params[0] = {"drag_SI", "N s^2/m^2 or N m s^2/rad^2", 0.0, __builtin_huge_val(), Scale::force_per_velocity2, 1,
                   {0.1}};
    i.help = "drag that grows with the square of the velocity";
    i.equation = "force = -drag |v| v";
    i.source = "Kahan (1993), Unconventional numerical methods for trajectory calculations";
    i.aliases[0] = "viscous_friction";
    i.separation = "runs at speeds a factor of three apart: drag grows with the square, viscous friction in proportion";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    const S drag = p[0] * abs(in.velocity);
    return -(drag * in.free) / (S(1.0) + drag * in.gain);
  }
};

}  // namespace tiller
