#pragma once

#include "effects/effect_info.hpp"

namespace tiller {

/// force = -damping v by an exponential integrator: with the free step's acceleration held constant, v' = a - (c/dt) v,
/// c = damping dt/m, has the solution v+ = E v + (1 - E)/c (v_free - v), E = e^-c; here E is its (0,2) Pade approximant
/// 1/(1 + c + c^2/2). Second order, and stable at any step and any damping: explicit damping explodes once c > 2, and
/// the plain implicit v_free/(1 + c) is first order, which at 20 ms a posterior takes for mass.
template <class S>
struct ViscousFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "viscous_friction";
    i.param_count = 1;
    i.params[0] = {"damping_SI", "N s/m or N m s/rad", 0.0, __builtin_huge_val(), Scale::force_per_velocity, 1, {0.1}};
    i.help = "friction proportional to the joint's velocity";
    i.equation = "force = -damping v";
    return i;
  }();
  /// v: the velocity before the step; v_free: after it, without this force; gain: dt times inverse inertia.
  static S force(const S& v, const S& v_free, const S& gain, const S* p) {
    const S c = p[0] * gain;
    return -(p[0] * S(0.5)) * (v + v_free + c * v_free) / (S(1.0) + c + S(0.5) * c * c);
  }
};

}  // namespace tiller
