#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// The actuator gives at most the limit. 0 switches it off.
template <class S>
struct Saturation {
  static constexpr Hook hook = Hook::input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "saturation";
    i.port = PortKind::input;
    i.param_count = 1;
    i.params[0] = {"limit_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::input, 2, {0.5, 0.8}};
    i.help = "the actuator gives at most the limit; 0: off";
    i.equation = "u -> clamp(u, -limit, limit)";
    i.source = "Hippe (2006), Windup in control";
    i.aliases[0] = "actuator_gain";
    i.separation = "commands of two sizes in separate runs: a gain acts on both";
    return i;
  }();
  static S apply(const InputStep<S>& in, S*, const S* p) {
    const S cut = max(min(in.command, p[0]), -p[0]);
    return select(p[0] > S(0.0), cut, in.command);
  }
};

}  // namespace tiller
