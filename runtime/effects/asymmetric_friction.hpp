#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Dry friction of two levels: against motion forward and against motion backward, as in a gear that is loaded to one
/// side or a seal.
template <class S>
struct AsymmetricFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "asymmetric_friction";
    i.param_count = 2;
    i.params[0] = {"forward_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.05, 0.3}};
    i.params[1] = {"backward_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.1, 0.2}};
    i.help = "dry friction that differs between the two directions";
    i.equation = "force = -forward for v > 0, +backward for v < 0; at rest what stops within these";
    i.source = "Armstrong-Helouvry (1991), Control of machines with friction, ch. 2";
    i.contains[0] = "coulomb_friction";
    i.aliases[0] = "constant_offset";
    i.separation = "motion in both directions: an offset acts at rest too, asymmetric friction only against motion";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    return dry_friction(in, [&](const S& way, const S&) { return select(way > S(0.0), p[0], p[1]); });
  }
};

}  // namespace tiller
