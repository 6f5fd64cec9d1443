#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A drive whose force changes steadily from its start on: a battery that empties, a magnet that warms through. The
/// state is the time since then; a gain that would have become negative is none.
template <class S>
struct GainDrift {
  static constexpr Hook hook = Hook::input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "gain_drift";
    i.port = PortKind::input;
    i.param_count = 1;
    i.params[0] = {"drift_1_s", "1/s", -__builtin_huge_val(),       __builtin_huge_val(),
                   Scale::none, 4,     {0.002, -0.002, 0.02, -0.02}};
    i.state_count = 1;
    i.help = "what acts grows or falls by a share each second: a battery that empties, a motor that warms through";
    i.equation = "dt/dt = 1 from the start of the run; u -> max(1 + drift t, 0) u";
    i.aliases[0] = "actuator_gain";
    i.aliases[1] = "supply_sag";
    i.separation =
        "the same motion at the start and at the end of a long run, and after a rest: a gain stays, a supply "
        "recovers, a drift goes on";
    return i;
  }();
  static S apply(const InputStep<S>& in, S* state, const S* p) {
    const S middle = state[0] + S(0.5) * in.dt_s;
    state[0] = state[0] + in.dt_s;
    return max(S(1.0) + p[0] * middle, S(0.0)) * in.command;
  }
};

}  // namespace tiller
