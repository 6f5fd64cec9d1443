#pragma once

#include "effects/effect_info.hpp"

namespace tiller {

/// force = -damping v, implicit: v+ = v_free / (1 + damping dt/m). Stable at any step and any damping; exact in v to
/// first order in the step, where explicit damping explodes once damping dt/m > 2.
template <class S>
struct ViscousFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = {"viscous_friction", PortKind::joint, 1, {"damping_SI"},
                                      {"N s/m or N m s/rad"}, {0.0}, 0,
                                      "friction proportional to the joint's velocity"};
  /// v_free: the velocity after the step without this force; gain: dt times inverse inertia.
  static S force(const S& v_free, const S& gain, const S* p) { return -(p[0] * v_free) / (S(1.0) + p[0] * gain); }
};

}  // namespace tiller
