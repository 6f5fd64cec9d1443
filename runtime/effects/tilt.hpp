#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// The machine stands tilted: gravity turned by the angle in the plane, counter-clockwise.
template <class S>
struct Tilt {
  static constexpr Hook hook = Hook::body;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "tilt";
    i.port = PortKind::body;
    i.param_count = 1;
    i.params[0] = {"angle_rad", "rad", -3.1415926535897931, 3.1415926535897931, Scale::none, 2, {0.05, -0.05}};
    i.help = "the machine stands tilted";
    i.equation = "gravity turned by the angle: gx' = gx cos a - gz sin a, gz' = gx sin a + gz cos a";
    i.aliases[0] = "sensor_bias";
    i.aliases[1] = "constant_offset";
    i.separation = "a spirit level, or the machine turned round: tilt changes sign, the sensor's bias does not";
    return i;
  }();
  template <class Body>
  static void change(Body& body, const S* p) {
    S sine, cosine;
    sincos(p[0], sine, cosine);
    const S x = body.gravity_x_m_s2 * cosine - body.gravity_z_m_s2 * sine;
    body.gravity_z_m_s2 = body.gravity_x_m_s2 * sine + body.gravity_z_m_s2 * cosine;
    body.gravity_x_m_s2 = x;
  }
};

}  // namespace tiller
