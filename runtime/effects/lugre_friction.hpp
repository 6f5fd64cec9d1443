#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Bristle friction: before it slides the contact is a spring that yields. The state is the bristles' mean deflection
/// z. Within a step velocity and deflection count with their values at 1 - theta of the start and theta of the end; the
/// equation is quadratic in that deflection once the direction of sliding is known, and that is the sign of the
/// velocity that the deflection of the start would give: closed form, |z| never exceeds level / stiffness, stable at
/// any step and stiffness. theta is one half for bristles that are slow against the step (second order: implicit Euler
/// damps them like a dashpot of stiffness dt / 2, which a fit of 10 ms records sees) and goes to 1 where they are
/// faster than it, so that a stiff contact sticks and does not ring. Micro-damping is left out (viscous_friction beside
/// it damps).
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
    i.params[3] = {"bristle_stiffness_SI", "N/m or N m/rad", 0.0, __builtin_huge_val(), Scale::stiffness, 3,
                   {30.0, 10.0, 300.0}};
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
    const auto on = p[3] > S(0.0);
    const S stiffness = select(on, p[3], S(1.0));
    const S stiff = in.dt_s * in.gain * stiffness;  // square of the bristles' frequency times the step
    const S theta = S(1.0) - S(2.0) / (S(4.0) + stiff);
    const S pull = theta * in.gain * stiffness;  // velocity lost per deflection
    const S velocity = (S(1.0) - theta) * in.velocity + theta * in.free;
    const S slip = velocity - pull * state[0];
    const S level = stribeck_level(slip, p[0], p[1], p[2]);
    const auto present = min(level, p[3]) > S(0.0);
    const S longest = select(present, level, S(1.0)) / stiffness;
    // deflections in the direction of sliding, in units of the longest
    const S sign = copysign(S(1.0), slip);
    const S start = max(min(sign * state[0] / longest, S(1.0)), S(-1.0));
    const S share = theta * in.dt_s / longest, way = sign * velocity * share, yielding = pull * theta * in.dt_s;
    const S b = S(1.0) + yielding + way, c = start + way;
    const S root = sqrt(max(b * b - S(4.0) * yielding * c, S(0.0)));
    const S middle = min(S(2.0) * c / (b + root), S(1.0));
    const S end = max(min(start + (middle - start) / theta, S(1.0)), S(-1.0));
    state[0] = select(present, sign * end * longest, S(0.0));
    return select(present, -(sign * middle * level), S(0.0));
  }
};

}  // namespace tiller
