#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A supply that sags under load and recovers, or a motor that weakens as it warms: the force falls with the mean of
/// what was asked of late. The state is that mean, exact for a command that is constant over the step; what acts is
/// the force at the step's middle. droop 0 passes the command through, to the last bit.
template <class S>
struct SupplySag {
  static constexpr Hook hook = Hook::input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "supply_sag";
    i.port = PortKind::input;
    i.param_count = 2;
    i.params[0] = {"droop_per_SI", "1/N or 1/(N m)", 0.0, __builtin_huge_val(), Scale::per_input, 3, {0.2, 1.0, 0.3}};
    i.params[1] = {"recovery_s", "s", 0.0, __builtin_huge_val(), Scale::period, 3, {10.0, 40.0, 160.0}};
    i.paired_starts = true;
    i.state_count = 1;
    i.help = "the force sags under load and recovers: a weak supply, a motor that warms";
    i.equation = "recovery dm/dt = |u| - m; u -> u / (1 + droop m)";
    i.source = "Plett (2015), Battery management systems 1, ch. 2: one resistor and capacitor";
    i.aliases[0] = "actuator_gain";
    i.aliases[1] = "saturation";
    i.separation = "a long command after a rest: a sagging force falls, a gain stays";
    return i;
  }();
  static S apply(const InputStep<S>& in, S* state, const S* p) {
    const S load = abs(in.command), half = exp(S(-0.5) * in.dt_s / max(p[1], S(1e-9)));
    const S middle = load + (state[0] - load) * half;
    state[0] = load + (middle - load) * half;
    return in.command / (S(1.0) + p[0] * middle);
  }
};

}  // namespace tiller
