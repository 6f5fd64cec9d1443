#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// First-order lag of an actuator: T dy/dt = u - y, exact for a command that is constant over the step:
/// y+ = u + (y - u) e^(-dt/T). What acts is the mean of y over the step, u + (y - u) (T/dt) (1 - e^(-dt/T)), so that
/// the impulse is right even where T is far below the step. T = 0 passes u through, to the last bit.
template <class S>
struct ActuatorLag {
  static constexpr bool inlined = true;
  static constexpr Hook hook = Hook::input;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "actuator_lag";
    i.port = PortKind::input;
    i.param_count = 1;
    i.params[0] = {"time_constant_s", "s", 0.0, __builtin_huge_val(), Scale::period, 2, {1.0, 5.0}};
    i.state_count = 1;
    i.help = "first-order lag between command and force";
    i.equation = "T dy/dt = u - y; y acts";
    i.aliases[0] = "input_delay";
    i.separation = "steps of the command: a delay answers late and at once, a lag at once and slowly";
    return i;
  }();
  /// How much of the distance between y and u is left at the end of a step, and of its mean over the step: the same in
  /// every step of one length.
  struct Shares {
    S left, mean;
  };
  static Shares shares(const S& dt, const S* p) {
    const S ratio = max(p[0], S(1e-9)) / dt;
    const S left = exp(S(-1.0) / ratio);
    return {left, ratio * (S(1.0) - left)};
  }
  static S apply(const S& u, const Shares& shares, S* state, const S* p) {
    const S distance = state[0] - u;
    const auto present = p[0] > S(0.0);
    state[0] = select(present, u + distance * shares.left, u);
    return select(present, u + distance * shares.mean, u);
  }
  static S apply(const InputStep<S>& in, S* state, const S* p) {
    return apply(in.command, shares(in.dt_s, p), state, p);
  }
};

}  // namespace tiller
