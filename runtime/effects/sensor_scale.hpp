#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// The sensor reads a factor too much: a wrong number of counts per turn, a gear ratio. Of an angle, with its
/// turns counted.
template <class S>
struct SensorScale {
  static constexpr Hook hook = Hook::sensor;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "sensor_scale";
    i.port = PortKind::sensor;
    i.param_count = 1;
    i.params[0] = {"scale_error", "1", -1.0, __builtin_huge_val(), Scale::none, 2, {0.05, -0.05}};
    i.help = "the sensor reads a factor too much";
    i.equation = "measured = (1 + scale_error) x";
    i.aliases[0] = "actuator_gain";
    i.aliases[1] = "linear_spring";
    i.separation = "two places whose distance is known; a whole turn";
    return i;
  }();
  static void measure(S& gain, S& offset, const SensorSight<S>&, const S* p) {
    gain = gain + p[0] * gain;
    offset = offset + p[0] * offset;
  }
};

}  // namespace tiller
