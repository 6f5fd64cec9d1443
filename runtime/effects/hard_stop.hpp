#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A buffer at one end of the travel: spring and damper beyond a position, which push and never pull. Within a step
/// they act for the share of it that the joint spends beyond the position, with the mean depth of that share, and with
/// the step's own result (implicit midpoint rule): second order through the contact, stable at any step and stiffness.
/// The sign of the stiffness says on which side the stop is.
template <class S>
struct HardStop {
  static constexpr Hook hook = Hook::elastic;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "hard_stop";
    i.param_count = 3;
    i.params[0] = {"position_SI",
                   "m or rad",
                   -__builtin_huge_val(),
                   __builtin_huge_val(),
                   Scale::place,
                   6,
                   {0.97, 0.9, 0.75, 0.25, 0.1, 0.03}};
    i.params[1] = {"stiffness_SI",
                   "N/m or N m/rad",
                   -__builtin_huge_val(),
                   __builtin_huge_val(),
                   Scale::stiffness,
                   6,
                   {300.0, 60.0, 10.0, -10.0, -60.0, -300.0}};
    i.params[2] = {"damping_SI", "N s/m or N m s/rad", 0.0, __builtin_huge_val(), Scale::force_per_velocity, 1, {0.05}};
    i.paired_starts = true;
    i.needs_position = true;
    i.help = "a buffer at one end of the travel: above the position, or below it if the stiffness is negative";
    i.equation =
        "force = -max(stiffness (q - position) + damping v, 0) for q > position; for stiffness < 0 the mirror image";
    i.source =
        "Hunt, Crossley (1975), Coefficient of restitution interpreted as damping in vibroimpact, J. Appl. Mech. 42";
    i.separation = "runs that end short of the stop: without it the joint moves freely there";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    const S side = copysign(S(1.0), p[1]), stiffness = abs(p[1]);
    const S into = side * (in.middle - p[0]), speed = side * S(0.5) * (in.velocity + in.free);
    const S half = S(0.5) * in.dt_s * speed, deepest = into + abs(half), least = into - abs(half);
    const S share = min(deepest / max(deepest - least, S(1e-30)), S(1.0));
    const S depth = S(0.5) * (deepest + max(least, S(0.0)));
    const S push = share * (stiffness * depth + p[2] * speed) /
                   (S(1.0) + share * (stiffness * yield(in) + S(0.5) * p[2] * in.gain));
    return select(deepest > S(0.0), -(side * max(push, S(0.0))), S(0.0));
  }
};

}  // namespace tiller
