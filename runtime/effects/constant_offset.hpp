#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A constant force at a joint: an unbalanced load, a cable's pull, a sensor's or amplifier's offset in torque.
template <class S>
struct ConstantOffset {
  static constexpr bool inlined = true;
  static constexpr Hook hook = Hook::force;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "constant_offset";
    i.param_count = 1;
    i.params[0] = {"force_SI", "N or N m", -__builtin_huge_val(), __builtin_huge_val(), Scale::force, 1, {0.1}};
    i.help = "a constant force or torque at the joint";
    i.equation = "force = offset";
    i.aliases[0] = "tilt";
    i.aliases[1] = "sensor_bias";
    i.aliases[2] = "asymmetric_friction";
    i.separation = "other positions: tilt and a sensor's bias act through gravity and change with the angle";
    return i;
  }();
  static S force(const JointStep<S>&, const S* p) { return p[0]; }
};

}  // namespace tiller
