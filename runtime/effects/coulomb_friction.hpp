#pragma once

#include "effects/effect_info.hpp"

namespace tiller {

/// Dry friction: at most `friction`, against the motion, and exactly what stops the joint where that suffices (true
/// sticking: v becomes 0, not a small number). The alternative, friction * tanh(v / v0), creeps when it should stick
/// and is unstable at 20 ms for any v0 small enough to look like dry friction. Same time-stepping as Moreau's:
/// the force is the projection of the stopping impulse onto [-friction, friction].
template <class S>
struct CoulombFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "coulomb_friction";
    i.param_count = 1;
    i.params[0] = {"friction_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.05, 0.3}};
    i.help = "dry friction: a constant force against the motion, sticking at rest";
    i.equation = "force = -friction sign(v); at rest at most friction";
    i.source = "Moreau (1988), Unilateral contact and dry friction in finite freedom dynamics";
    return i;
  }();
  static S force(const S&, const S& v_free, const S& gain, const S* p) {
    const S stopping = -v_free / gain;
    // in this order a tie goes to the constant: no friction has no derivative either, at rest as well
    return max(min(stopping, p[0]), -p[0]);
  }
};

}  // namespace tiller
