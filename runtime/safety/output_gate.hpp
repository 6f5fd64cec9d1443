#pragma once

#include <cstdint>

#include "core/input_cone.hpp"
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
  void send_safe(double* out);

  /// The command in force, (nu). Before the first one: the safe command.
  const double* last() const { return last_; }

  std::uint64_t cuts() const { return cuts_; }              ///< calls that cut a command to a limit
  std::uint64_t rejections() const { return rejections_; }  ///< calls that met NaN or an infinity

 private:
  bool all_finite(const double* command) const;
  bool cones_fit() const;
  double step_of(std::uint32_t i, double elapsed_s) const;
  bool differs(const double* a, const double* b) const;
  tiller_status_t limit_input(std::uint32_t i, double elapsed_s, double& value) const;
  tiller_status_t limit_cones(double elapsed_s, double* command) const;

  GateLimits limits_;
  double last_[TILLER_MAX_INPUTS] = {};
  std::uint64_t cuts_ = 0;
  std::uint64_t rejections_ = 0;
};

}  // namespace tiller
