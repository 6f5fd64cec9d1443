#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Events of the state machine. The order is that of the table's columns.
enum class Event : std::uint8_t {
  arm,           ///< tiller_arm
  disarm,        ///< tiller_disarm
  stop,          ///< tiller_stop
  reset,         ///< tiller_reset
  measured,      ///< a valid measurement while disarmed
  cleared,       ///< a valid measurement while armed: motion is permitted
  plan_good,     ///< the planner left a finite command
  plan_failed,   ///< it did not, or its plan is used up
  hold_expired,  ///< HOLD lasted longer than configured
  sensor_fault,  ///< sensors stale, frozen or rejected too often
  clock_set,     ///< the caller's time went back: what was measured is of another time
};
constexpr int kEventCount = 11;
constexpr int kStateCount = 5;

/// INIT, STANDBY, ACTIVE, HOLD, SAFE and nothing implicit: every pair of state and event has its entry in one
/// table (docs/reference/safety.md shows it). SAFE is left by reset alone.
class StateMachine {
 public:
  tiller_state_t state() const { return state_; }
  bool armed() const { return armed_; }
  /// Why the state is HOLD or SAFE: the first reason since motion was last in order. ok in the other states.
  tiller_status_t first_fault() const { return first_fault_; }

  /// Takes the event. `why` is kept as the first fault where the event leads to HOLD or SAFE.
  /// Returns wrong_state, and changes nothing, where the event is not allowed.
  tiller_status_t on(Event event, tiller_status_t why = tiller_status_ok);

  /// A valid measurement: `cleared` if armed, else `measured`.
  void on_measurement() { (void)on(armed_ ? Event::cleared : Event::measured); }

 private:
  tiller_state_t state_ = tiller_state_init;
  tiller_status_t first_fault_ = tiller_status_ok;
  bool armed_ = false;
};

}  // namespace tiller
