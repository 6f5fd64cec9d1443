#pragma once

#include "effects/effect_info.hpp"
#include "tiller/scalar.hpp"

namespace tiller {

/// Transport delay of an input. For commands constant over periods of length T, a delay of n T + r makes each period
/// two parts: r long the command of n + 1 periods ago, then that of n periods ago. The steps end where the command
/// changes, so that the delay is as exact as the integrator (the mean of the two over the period would move a position
/// by up to a T^2 / 8 for a change a of the acceleration). Every lane may have its own delay; the history belongs to
/// the input, not to the particle. A delay of 0 passes the command through, to the last bit.
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
  /// A delay in periods: for the first `share` of a period the command of n + 1 periods ago acts, then that of n
  /// periods ago, with n between first and last in all lanes.
  struct Reach {
    S periods, share;
    int first, last;
  };
  /// steps: periods that a delay can reach; a longer one acts as that.
  static Reach reach(int steps, const S& delay, const S& period) {
    Reach r = {max(delay / period, S(0.0)), S(0.0), 0, 0};
    if (steps == 0) return r;
    r.share = min(r.periods, S(1.0));
    for (int i = 1; i <= steps; ++i) {
      const auto reached = r.periods >= S(i);
      if (!any(reached)) break;
      r.share = select(reached, min(r.periods - S(i), S(1.0)), r.share);
      r.last = i;
      if (all(reached)) r.first = i;
    }
    return r;
  }
  /// past(i) is the command i periods ago, i = 0..steps. Commands may carry derivatives that S has not.
  template <class Command, class Past>
  static void split_at_switch(const Past& past, int steps, const Reach& r, Command& older, Command& newer) {
    newer = past(r.first);
    older = past(r.first < steps ? r.first + 1 : steps);
    Command next = older;
    for (int i = r.first + 1; i <= r.last; ++i) {
      const Command beyond = past(i < steps ? i + 1 : steps);
      const auto reached = r.periods >= S(i);
      newer = select(reached, next, newer);
      older = select(reached, beyond, older);
      next = beyond;
    }
  }
};

}  // namespace tiller
