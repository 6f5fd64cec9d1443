#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A force that goes with the position and repeats, as of magnets passing slots. It acts at the middle of the step
/// (leapfrog).
template <class S>
struct Cogging {
  static constexpr Hook hook = Hook::elastic;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "cogging";
    i.param_count = 3;
    i.params[0] = {"cosine_SI", "N or N m", -__builtin_huge_val(), __builtin_huge_val(), Scale::force, 2, {0.1, -0.1}};
    i.params[1] = {"sine_SI", "N or N m", -__builtin_huge_val(), __builtin_huge_val(), Scale::force, 2, {0.1, 0.1}};
    i.params[2] = {"spatial_period_SI", "m or rad", 0.005, 6.4, Scale::spatial_period, 0, {}};
    i.needs_position = true;
    i.help = "a force periodic in position: magnets and slots, a gear's teeth";
    i.equation = "force = cosine cos(2 pi q / spatial_period) + sine sin(2 pi q / spatial_period)";
    i.source = "Hanselman (2003), Brushless permanent magnet motor design, ch. 5";
    i.aliases[0] = "torque_ripple";
    i.separation = "slow motion without drive: cogging stays, ripple goes with the current";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    S sine, cosine;
    sincos(phase(in.middle, p[2]), sine, cosine);
    return p[0] * cosine + p[1] * sine;
  }
};

}  // namespace tiller
