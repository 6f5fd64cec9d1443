#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Dry friction in proportion to the force that the drive transmits, as of gears: their teeth press harder under
/// load.
template <class S>
struct LoadFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "load_friction";
    i.param_count = 1;
    i.params[0] = {"coefficient", "1", 0.0, __builtin_huge_val(), Scale::none, 2, {0.1, 0.3}};
    i.needs_drive = true;
    i.help = "dry friction in proportion to the drive force";
    i.equation = "force = -coefficient |drive| sign(v); at rest at most coefficient |drive|";
    i.source = "Dohring, Lee, Newman (1993), A load-dependent transmission friction model, ICRA";
    i.aliases[0] = "coulomb_friction";
    i.aliases[1] = "actuator_gain";
    i.separation = "the same motion under different loads: Coulomb friction stays as it is";
    return i;
  }();
  static S force(const JointStep<S>& in, const S* p) {
    const S level = p[0] * abs(in.drive);
    return dry_friction(in, [&](const S&, const S&) { return level; });
  }
};

}  // namespace tiller
