#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// The acting force is off by a factor: a drifting torque constant, a sagging supply, a wrong gear ratio.
template <class S>
struct ActuatorGain {
  static constexpr Hook hook = Hook::input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "actuator_gain";
    i.port = PortKind::input;
    i.param_count = 1;
    i.params[0] = {"gain_error", "1", -1.0, __builtin_huge_val(), Scale::none, 2, {0.1, -0.1}};
    i.help = "what acts is off by a factor";
    i.equation = "u -> (1 + gain_error) u";
    i.aliases[0] = "sensor_scale";
    i.aliases[1] = "joint_inertia";
    i.aliases[2] = "payload";
    i.separation = "a force sensor, or a motion that gravity drives alone: the gain has no say in it";
    return i;
  }();
  static S apply(const InputStep<S>& in, S*, const S* p) { return in.command + p[0] * in.command; }
};

}  // namespace tiller
