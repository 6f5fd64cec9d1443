#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Bristle friction: before it slides the contact is a spring that yields. The state is the bristles' mean deflection
/// z. Implicit Euler in z and v together; the equation is quadratic in z once the direction of sliding is known, and
/// that is the sign of v_free - gain stiffness z: closed form, |z| never exceeds level / stiffness, stable at any
/// step and stiffness. Micro-damping is left out (viscous_friction beside it damps); at steps longer than the
/// bristles' period the implicit rule damps them.
template <class S>
struct LugreFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "lugre_friction";
    i.param_count = 4;
    i.params[0] = {"friction_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.05, 0.2}};
    i.params[1] = {"stiction_extra_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.02, 0.1}};
    i.params[2] = {"stribeck_velocity_SI", "m/s or rad/s", 0.0, __builtin_huge_val(), Scale::velocity, 2, {0.05, 0.2}};
    i.params[3] = {"bristle_stiffness_SI",
                   "N/m or N m/rad",
                   0.0,
                   __builtin_huge_val(),
                   Scale::force_per_position,
                   2,
                   {30.0, 10.0}};
    i.state_count = 1;
    i.help = "bristle friction: a spring before it slides, then Stribeck";
    i.equation =
        "dz/dt = v - stiffness |v| z / level(v); force = -stiffness z; level(v) = friction + extra exp(-(v/v_s)^2)";
    i.source =
        "Canudas de Wit, Olsson, Astrom, Lischinsky (1995), A new model for control of systems with friction, IEEE TAC 40";
    i.contains[0] = "stribeck_friction";
    i.contains[1] = "coulomb_friction";
    i.aliases[0] = "stribeck_friction";
    i.aliases[1] = "coulomb_friction";
    i.separation = "small slow strokes about standstill: bristles spring back, dry friction does not";
    return i;
  }();
  static S force(const JointStep<S>& in, S* state, const S* p) {
    const S level = stribeck_level(in.velocity, p[0], p[1], p[2]);
    const auto present = min(level, p[3]) > S(0.0);
    const S stiffness = select(present, p[3], S(1.0));
    const S longest = select(present, level, S(1.0)) / stiffness;
    const S pull = in.gain * stiffness;  // velocity lost per deflection
    // deflections in the direction of sliding, in units of the longest
    const S sign = copysign(S(1.0), in.free - pull * state[0]);
    const S before = max(min(sign * state[0] / longest, S(1.0)), S(-1.0));
    const S way = sign * in.free * in.dt_s / longest;
    const S stiff = in.dt_s * pull;
    const S b = S(1.0) + stiff + way, c = before + way;
    const S root = sqrt(max(b * b - S(4.0) * stiff * c, S(0.0)));
    const S deflection = sign * min(S(2.0) * c / (b + root), S(1.0)) * longest;
    state[0] = select(present, deflection, S(0.0));
    return select(present, -stiffness * deflection, S(0.0));
  }
};

}  // namespace tiller
