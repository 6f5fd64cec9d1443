#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Dry friction: at most `friction`, against the motion, and exactly what stops the joint where that suffices (true
/// sticking: v becomes 0, not a small number). The alternative, friction * tanh(v / v0), creeps when it should stick
/// and is unstable at 20 ms for any v0 small enough to look like dry friction.
template <class S>
struct CoulombFriction {
  static constexpr bool inlined = true;
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "coulomb_friction";
    i.param_count = 1;
    i.params[0] = {"friction_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.05, 0.3}};
    i.help = "dry friction: a constant force against the motion, sticking at rest";
    i.equation = "force = -friction sign(v); at rest at most friction";
    i.source = "Moreau (1988), Unilateral contact and dry friction in finite freedom dynamics";
    i.aliases[0] = "stribeck_friction";
    i.aliases[1] = "dead_zone";
    i.aliases[2] = "load_friction";
    i.separation = "let the joint swing without drive: a dead zone is gone, dry friction stays";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    return dry_friction(in, [&](const S&, const S&) { return p[0]; });
  }
};

}  // namespace tiller
