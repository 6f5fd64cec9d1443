#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// The sensor reads a constant too much: a wrong zero.
template <class S>
struct SensorBias {
  static constexpr Hook hook = Hook::sensor;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "sensor_bias";
    i.port = PortKind::sensor;
    i.param_count = 1;
    i.params[0] = {"bias_SI", "as the state", -__builtin_huge_val(), __builtin_huge_val(), Scale::none,
                   2,         {0.05, -0.05}};
    i.help = "the sensor reads a constant too much";
    i.equation = "measured = x + bias";
    i.aliases[0] = "tilt";
    i.aliases[1] = "constant_offset";
    i.separation = "a plumb line or a second sensor of the same state; a different attitude of the machine";
    return i;
  }();
  static void measure(S&, S& offset, const SensorSight<S>&, const S* p) { offset = offset + p[0]; }
};

}  // namespace tiller
