#include "safety/state_machine.hpp"

namespace tiller {
namespace {

constexpr std::int8_t kRefused = -1;
constexpr std::int8_t kInit = tiller_state_init;
constexpr std::int8_t kStandby = tiller_state_standby;
constexpr std::int8_t kActive = tiller_state_active;
constexpr std::int8_t kHold = tiller_state_hold;
constexpr std::int8_t kSafe = tiller_state_safe;

// Row: the state; column: the event; entry: the next state.
//   - INIT ignores sensor faults: a sensor that has not spoken yet is no fault, and the command is safe
//   anyway.
//   - STANDBY does not: whoever arms after a sensor died in STANDBY must be refused.
//   - Reset is refused while the robot moves: it would drop the state estimate under a running plan.
// clang-format off
constexpr std::int8_t kNext[kStateCount][kEventCount] = {
  //            arm       disarm    stop   reset     measured  cleared   plan_good plan_failed hold_expired sensor_fault
  //            clock_set
  /* INIT    */ {kInit,    kInit,    kSafe, kInit,    kStandby, kActive,  kInit,    kInit,      kInit,       kInit,       kInit},
  /* STANDBY */ {kStandby, kStandby, kSafe, kInit,    kStandby, kActive,  kStandby, kStandby,   kStandby,    kSafe,       kInit},
  /* ACTIVE  */ {kActive,  kStandby, kSafe, kRefused, kActive,  kActive,  kActive,  kHold,      kActive,     kSafe,       kActive},
  /* HOLD    */ {kHold,    kStandby, kSafe, kRefused, kHold,    kHold,    kActive,  kHold,      kSafe,       kSafe,       kHold},
  /* SAFE    */ {kRefused, kRefused, kSafe, kInit,    kSafe,    kSafe,    kSafe,    kSafe,      kSafe,       kSafe,       kSafe},
};
// clang-format on

}  // namespace

tiller_status_t StateMachine::on(Event event, tiller_status_t why) {
  const std::int8_t next = kNext[state_][static_cast<int>(event)];
  if (next == kRefused) return tiller_status_wrong_state;

  state_ = static_cast<tiller_state_t>(next);
  if (event == Event::arm) armed_ = true;
  if (event == Event::disarm || event == Event::reset || state_ == tiller_state_safe) armed_ = false;

  const bool at_fault = state_ == tiller_state_hold || state_ == tiller_state_safe;
  if (!at_fault) first_fault_ = tiller_status_ok;
  if (at_fault && first_fault_ == tiller_status_ok) first_fault_ = why;
  return tiller_status_ok;
}

}  // namespace tiller
