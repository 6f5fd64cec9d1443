#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// More mass where the model carries its payload: at the tip or the bob.
template <class S>
struct Payload {
  static constexpr Hook hook = Hook::body;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "payload";
    i.port = PortKind::body;
    i.param_count = 1;
    i.params[0] = {"mass_kg", "kg", 0.0, __builtin_huge_val(), Scale::mass, 2, {0.1, 0.3}};
    i.help = "more mass at the model's payload";
    i.equation = "body.payload_kg + mass";
    i.aliases[0] = "actuator_gain";
    i.aliases[1] = "joint_inertia";
    i.separation = "a scale; or a motion that gravity drives alone";
    return i;
  }();
  template <class Body>
  static void change(Body& body, const S* p) {
    body.payload_kg = body.payload_kg + p[0];
  }
};

}  // namespace tiller
