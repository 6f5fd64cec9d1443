#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Dry friction that swings with the position: a rail that is not straight, a gear or a seal that is not round. The
/// level is that of the step's middle and never below 0.
template <class S>
struct PositionFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "position_friction";
    i.param_count = 4;
    i.params[0] = {"friction_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.1, 0.3}};
    i.params[1] = {"cosine_SI", "N or N m", -__builtin_huge_val(), __builtin_huge_val(), Scale::force, 2, {0.1, -0.1}};
    i.params[2] = {"sine_SI", "N or N m", -__builtin_huge_val(), __builtin_huge_val(), Scale::force, 2, {0.1, -0.1}};
    i.params[3] = {"spatial_period_SI", "m or rad", 0.005, 6.4, Scale::spatial_period, 0, {}};
    i.needs_position = true;
    i.help = "dry friction that swings with the position: a bent rail, a seal that is not round";
    i.equation =
        "force = -max(friction + cosine cos a + sine sin a, 0) sign(v), a = 2 pi q / spatial_period; at rest at most "
        "that";
    i.source = "Armstrong-Helouvry (1991), Control of machines with friction, ch. 4";
    i.contains[0] = "coulomb_friction";
    i.aliases[0] = "cogging";
    i.separation = "the same stretch in both directions: friction turns its sign, cogging does not";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    S sine, cosine;
    sincos(phase(in.middle, p[3]), sine, cosine);
    const S level = max(p[0] + p[1] * cosine + p[2] * sine, S(0.0));
    return dry_friction(in, [&](const S&, const S&) { return level; });
  }
};

}  // namespace tiller
