#pragma once

#include "effects/effect_info.hpp"

namespace tiller {

/// Transport delay of an input: what acts during a period is the command's mean over that period shifted back by the
/// delay d. For commands constant over periods that is a weighted sum of the last ones, with hat weights
/// w_i = max(0, 1 - |d/period - i|). Every lane may have its own d; the history belongs to the input, not to the
/// particle. d = 0 passes the command through, to the last bit.
template <class S>
struct InputDelay {
  static constexpr bool inlined = true;
  static constexpr Hook hook = Hook::period_input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "input_delay";
    i.port = PortKind::input;
    i.param_count = 1;
    i.params[0] = {"delay_s", "s", 0.0, __builtin_huge_val(), Scale::period, 3, {0.5, 1.5, 4.0}};
    i.help = "transport delay between command and force";
    i.equation = "the command of a delay ago acts";
    i.aliases[0] = "actuator_lag";
    i.separation = "steps of the command: a delay answers late and at once, a lag at once and slowly";
    return i;
  }();
  /// past(i) is the command i periods ago, i = 0..steps.
  template <class Past>
  static S apply_period(const Past& past, int steps, const S* p, const S& period) {
    const S periods = p[0] / period;
    S sum = past(0) * max(S(0.0), S(1.0) - periods);
    for (int i = 1; i <= steps; ++i) sum += past(i) * max(S(0.0), S(1.0) - abs(periods - S(i)));
    return select(p[0] > S(0.0), sum, past(0));
  }
};

}  // namespace tiller
