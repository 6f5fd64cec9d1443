#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Dry friction that is larger at rest than in motion: the level of the mean speed in the step, bounded and so stable
/// at any step.
template <class S>
struct StribeckFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "stribeck_friction";
    i.param_count = 3;
    i.params[0] = {"friction_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.05, 0.2}};
    i.params[1] = {"stiction_extra_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.05, 0.2}};
    i.params[2] = {"stribeck_velocity_SI", "m/s or rad/s", 0.0, __builtin_huge_val(), Scale::velocity, 2, {0.05, 0.2}};
    i.help = "dry friction that is larger at rest than in motion";
    i.equation = "force = -(friction + extra exp(-(v/v_s)^2)) sign(v); at rest at most friction + extra";
    i.source =
        "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), A survey of models, analysis tools and compensation methods for the control of machines with friction, Automatica 30";
    i.contains[0] = "coulomb_friction";
    i.aliases[0] = "coulomb_friction";
    i.aliases[1] = "lugre_friction";
    i.separation = "slow ramps through standstill: the force drops within v_s once the joint moves";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    return dry_friction(in, [&](const S&, const S& speed) { return stribeck_level(speed, p[0], p[1], p[2]); });
  }
};

}  // namespace tiller
