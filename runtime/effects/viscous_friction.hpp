#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// force = -damping v by an exponential integrator: with the free step's acceleration held constant, v' = a - (c/dt) v,
/// c = damping dt/m, has the solution v+ = E v + (1 - E)/c (v_free - v), E = e^-c; here E is its (0,2) Pade approximant
/// 1/(1 + c + c^2/2). Second order, and stable at any step and any damping: explicit damping explodes once c > 2, and
/// the plain implicit v_free/(1 + c) is first order, which at 20 ms a posterior takes for mass.
template <class S>
struct ViscousFriction {
  static constexpr bool inlined = true;
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "viscous_friction";
    i.param_count = 1;
    i.params[0] = {"damping_SI", "N s/m or N m s/rad", 0.0, __builtin_huge_val(), Scale::force_per_velocity, 1, {0.1}};
    i.help = "friction proportional to the joint's velocity";
    i.equation = "force = -damping v";
    i.source = "Hochbruck, Ostermann (2010), Exponential integrators, Acta Numerica 19";
    i.aliases[0] = "quadratic_drag";
    i.separation = "runs at speeds a factor of three apart: drag grows with the square, viscous friction in proportion";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    const S c = p[0] * in.gain;
    return -(p[0] * S(0.5)) * (in.velocity + in.free + c * in.free) / (S(1.0) + c + S(0.5) * c * c);
  }
};

}  // namespace tiller
