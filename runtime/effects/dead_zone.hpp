#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Commands within the width do nothing, larger ones lose it: a valve's overlap, a bridge's dead time.
template <class S>
struct DeadZone {
  static constexpr Hook hook = Hook::input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "dead_zone";
    i.port = PortKind::input;
    i.param_count = 1;
    i.params[0] = {"width_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::input, 2, {0.05, 0.2}};
    i.help = "small commands do nothing, larger ones lose as much";
    i.equation = "u -> u - clamp(u, -width, width)";
    i.source = "Tao, Kokotovic (1996), Adaptive control of systems with actuator and sensor nonlinearities";
    i.aliases[0] = "coulomb_friction";
    i.aliases[1] = "load_friction";
    i.separation = "push the joint by hand, or let it swing without drive: friction stays, a dead zone is gone";
    return i;
  }();
  static S apply(const InputStep<S>& in, S*, const S* p) {
    return in.command - max(min(in.command, p[0]), -p[0]);  // a tie goes to the constant: no width, slope one
  }
};

}  // namespace tiller
