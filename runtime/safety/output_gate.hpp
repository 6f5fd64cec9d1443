#pragma once

#include <cstdint>

#include "core/input_cone.hpp"
#include "safety/answer.h"
#include "safety/state_machine.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Limits of a command, per input, and the cones that tie inputs together.
struct GateLimits {
  std::uint32_t count = 0;  // nu
  double low[TILLER_MAX_INPUTS] = {};
  double high[TILLER_MAX_INPUTS] = {};
  double rate_per_s[TILLER_MAX_INPUTS] = {};  // INFINITY: none
  double safe_command[TILLER_MAX_INPUTS] = {};
  double period_s = 0.0;  // of the control tick
  InputCones cones;
};

/// The last thing between tiller and the motor. It trusts nobody: whatever comes in, what goes out is finite,
/// within [low, high], within the rate limit from the last command that went out and within the cones. It knows
/// neither model nor planner nor state, so that a fault of theirs cannot be a fault of its.
///
/// Each input is cut to its limits and its rate by itself, and what is then outside a cone goes onto it as
/// core/input_cone.hpp has it. Within a cone means the inequality in doubles, as they come out.
///
/// What decides is safety/gate.c, which is proven (docs/safety/proof.md). Cones are not proven: what they make of a
/// command goes out only if limits and rates hold.
///
/// The rate limit binds commands that move the robot. The safe command is exempt and goes out at once: a
/// limit that spares a gearbox must not keep a motor pushing after tiller has decided to stop. (The
/// alternative, a ramp, lets a slow rate limit hold full torque for seconds in SAFE.)
class OutputGate {
 public:
  OutputGate() = default;
  /// Limits that are not finite or reversed leave only the safe command, and so do cones that the limits do not
  /// fit; a safe command outside limits or cones is brought in. tiller_config_check refuses all of these, the gate
  /// does not rely on it.
  explicit OutputGate(const GateLimits& limits);

  /// `wanted` (nu) through the limits into `out` (nu). `elapsed_s` since the last command: the change allowed
  /// is rate * min(elapsed, period), so that neither a burst of ticks nor a late one exceeds the rate by
  /// which the plan was made. A `wanted` with a NaN or an infinity anywhere is replaced as a whole by
  /// `fallback` (nu), and where that is not finite either, by the safe command; both still pass the limits.
  /// Returns ok, command_limited, rate_limited or command_not_finite.
  tiller_status_t pass(const double* wanted, const double* fallback, double elapsed_s, double* out);

  /// The safe command at once, whatever the rate limit says.
  void send_safe(double* out) { tiller_gate_send_safe(&gate_, out); }

  /// The command of a tick (nu) in the machine's state: `planned` or, in HOLD, `hold`, as pass has it; else the safe one.
  tiller_status_t answer(const StateMachine& machine, const double* planned, const double* hold, double elapsed_s,
                         double* out);

  /// The command in force, (nu). Before the first one: the safe command.
  const double* last() const { return gate_.last; }

  std::uint64_t cuts() const { return gate_.cuts; }              ///< calls that cut a command to a limit
  std::uint64_t rejections() const { return gate_.rejections; }  ///< calls that met NaN or an infinity

 private:
  bool cones_fit() const;
  /// For the core: null where there are none.
  const tiller_gate_cones_t* cones() const;

  tiller_gate_t gate_{};
  InputCones cones_;
};

}  // namespace tiller
