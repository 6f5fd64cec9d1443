#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// The actuator's force follows the command at most at this rate; what acts in a step is its mean. 0 switches it off.
/// The state is the force at the end of the step.
template <class S>
struct RateLimit {
  static constexpr Hook hook = Hook::input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "rate_limit";
    i.port = PortKind::input;
    i.param_count = 1;
    i.params[0] = {"rate_SI_s", "N/s or N m/s", 0.0, __builtin_huge_val(), Scale::input, 2, {5.0, 20.0}};
    i.state_count = 1;
    i.help = "the force changes at most at this rate; 0: off";
    i.equation = "y follows u, |dy/dt| <= rate; y acts";
    i.source = "Hippe (2006), Windup in control, ch. 4";
    i.aliases[0] = "actuator_lag";
    i.aliases[1] = "input_delay";
    i.separation = "steps of two sizes: a lag takes the same time for both, a rate limit a time in proportion";
    return i;
  }();
  static S apply(const InputStep<S>& in, S* state, const S* p) {
    const auto present = p[0] > S(0.0);
    const S most = select(present, p[0] * in.dt_s, S(1.0));
    const S change = max(min(in.command - state[0], most), -most);
    // a ramp of slope `rate` and then, if the command is reached, level: mean over the step
    const S mean = state[0] + change - change * abs(change) / (S(2.0) * most);
    state[0] = select(present, state[0] + change, in.command);
    return select(present, mean, in.command);
  }
};

}  // namespace tiller
