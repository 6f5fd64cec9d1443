#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// One reading comes late: a camera beside encoders, a filtered rate beside a position. Follows the state back by its
/// rate and acceleration, x(t - d) = x - d x' + d^2 x'' / 2, which errs by d^3 / 6 times the third derivative. Who
/// holds the whole motion (fits on logs, simulators) reads it at the time of a delay ago instead (late_by_s).
template <class S>
struct SensorDelay {
  static constexpr Hook hook = Hook::sensor;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "sensor_delay";
    i.port = PortKind::sensor;
    i.param_count = 1;
    i.params[0] = {"delay_s", "s", 0.0, __builtin_huge_val(), Scale::period, 3, {0.5, 1.5, 4.0}};
    i.help = "a reading comes late, and the others do not";
    i.equation = "measured(t) = x(t - delay)";
    i.aliases[0] = "input_delay";
    i.aliases[1] = "actuator_lag";
    i.separation = "a second sensor that is not late: at the same joint, or at one that the motion couples to it";
    return i;
  }();
  static void measure(S& gain, S& offset, const SensorSight<S>& at, const S* p) {
    offset = offset - gain * p[0] * (at.rate - S(0.5) * p[0] * at.acceleration);
  }
};

}  // namespace tiller
