#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Dry friction of a machine that starts cold: it falls to a share as the grease warms. The heat would go with the work
/// done; time since the start stands for it, which needs no history of the motion.
template <class S>
struct WarmingFriction {
  static constexpr Hook hook = Hook::dissipation;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "warming_friction";
    i.param_count = 3;
    i.params[0] = {"friction_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 2, {0.05, 0.3}};
    i.params[1] = {"warm_share", "1", 0.0, 1.0, Scale::none, 1, {0.4}};
    i.params[2] = {"time_constant_s", "s", 0.0, __builtin_huge_val(), Scale::period, 2, {100.0, 400.0}};
    i.state_count = 1;
    i.help = "dry friction that falls to a share of itself as the machine warms";
    i.equation =
        "dt/dt = 1 from the start of the run; force = -friction (s + (1 - s) exp(-t / T)) sign(v), s = warm_share";
    i.source =
        "Bittencourt, Axelsson (2014), Modeling and experiment design for identification of wear in a robot joint "
        "under load and temperature uncertainties based on friction data, IEEE/ASME Trans. Mechatronics 19";
    i.contains[0] = "coulomb_friction";
    i.aliases[0] = "coulomb_friction";
    i.aliases[1] = "gain_drift";
    i.separation = "the same motion cold and after minutes of work: friction that stays is another";
    return i;
  }();
  static S force(const JointStep<S>& in, S* state, const S* p) {
    const S age = max(state[0] + S(0.5) * in.dt_s, S(0.0)) / max(p[2], S(1e-3));
    const S warm = exp(-min(age, S(60.0)));
    state[0] = state[0] + in.dt_s;
    const S now = p[0] * (p[1] + (S(1.0) - p[1]) * warm);
    return dry_friction(in, [&](const S&, const S&) { return now; });
  }
};

}  // namespace tiller
