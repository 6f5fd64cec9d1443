#pragma once

#include "effects/effect_info.hpp"

namespace tiller {

/// force = -damping v, implicit: v+ = v_free / (1 + c + c^2/2) with c = damping dt/m, the (0,2) Pade approximant of the
/// decay e^-c. Stable at any step and any damping, where explicit damping explodes once c > 2; second order, where the
/// plain implicit 1/(1 + c) is first and biases what a posterior learns of neighbouring parameters at 20 ms.
template <class S>
struct ViscousFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = {"viscous_friction", PortKind::joint, 1, {"damping_SI"},
                                      {"N s/m or N m s/rad"}, {0.0}, 0,
                                      "friction proportional to the joint's velocity"};
  /// v_free: the velocity after the step without this force; gain: dt times inverse inertia.
  static S force(const S& v_free, const S& gain, const S* p) {
    const S c = p[0] * gain;
    const S half = c * S(0.5);
    return -(p[0] * v_free) * (S(1.0) + half) / (S(1.0) + c * (S(1.0) + half));
  }
};

}  // namespace tiller
