#pragma once

#include <cstdint>

#include "safety/machine.h"
#include "tiller/tiller.h"

namespace tiller {

/// Events of the state machine (safety/machine.h).
enum class Event : std::uint8_t {
  arm = tiller_event_arm,
  disarm = tiller_event_disarm,
  stop = tiller_event_stop,
  reset = tiller_event_reset,
  measured = tiller_event_measured,
  cleared = tiller_event_cleared,
  plan_good = tiller_event_plan_good,
  plan_failed = tiller_event_plan_failed,
  hold_expired = tiller_event_hold_expired,
  sensor_fault = tiller_event_sensor_fault,
  clock_set = tiller_event_clock_set,
};
constexpr int kEventCount = tiller_machine_events;
constexpr int kStateCount = tiller_machine_states;

/// INIT, STANDBY, ACTIVE, HOLD, SAFE and nothing implicit: every pair of state and event has its entry in one
/// table of machine.c (docs/reference/safety.md shows it). SAFE is left by reset alone: proven, docs/safety/proof.md.
class StateMachine {
 public:
  tiller_state_t state() const { return machine_.state; }
  bool armed() const { return machine_.armed; }
  /// Why the state is HOLD or SAFE: the first reason since motion was last in order. ok in the other states.
  tiller_status_t first_fault() const { return machine_.first_fault; }

  /// Takes the event. `why` is kept as the first fault where the event leads to HOLD or SAFE.
  /// Returns wrong_state, and changes nothing, where the event is not allowed.
  tiller_status_t on(Event event, tiller_status_t why = tiller_status_ok) {
    return tiller_machine_on(&machine_, static_cast<tiller_event_t>(event), why);
  }

  /// A valid measurement: `cleared` if armed, else `measured`.
  void on_measurement() { tiller_machine_measured(&machine_); }

  /// ACTIVE or HOLD: commands move the robot.
  bool moves() const { return tiller_machine_moves(&machine_); }
  const tiller_machine_t& core() const { return machine_; }

 private:
  tiller_machine_t machine_{};
};

}  // namespace tiller
