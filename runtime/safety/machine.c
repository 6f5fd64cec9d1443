#include "safety/machine.h"

#include <stdint.h>

enum {
  kRefused = -1,
  kInit = tiller_state_init,
  kStandby = tiller_state_standby,
  kActive = tiller_state_active,
  kHold = tiller_state_hold,
  kSafe = tiller_state_safe
};

/* Row: the state; column: the event; entry: the next state.
     - INIT ignores sensor faults: a sensor that has not spoken yet is no fault, and the command is safe anyway.
     - STANDBY does not: whoever arms after a sensor died in STANDBY must be refused.
     - Reset is refused while the robot moves: it would drop the state estimate under a running plan. */
// clang-format off
static const int8_t kNext[tiller_machine_states][tiller_machine_events] = {
  //            arm       disarm    stop   reset     measured  cleared  plan_good           hold_expired     clock_set
  //                                                                              plan_failed         sensor_fault
  /* INIT    */ {kInit,    kInit,    kSafe, kInit,    kStandby, kActive, kInit,    kInit,    kInit,    kInit, kInit},
  /* STANDBY */ {kStandby, kStandby, kSafe, kInit,    kStandby, kActive, kStandby, kStandby, kStandby, kSafe, kInit},
  /* ACTIVE  */ {kActive,  kStandby, kSafe, kRefused, kActive,  kActive, kActive,  kHold,    kActive,  kSafe, kActive},
  /* HOLD    */ {kHold,    kStandby, kSafe, kRefused, kHold,    kHold,   kActive,  kHold,    kSafe,    kSafe, kHold},
  /* SAFE    */ {kRefused, kRefused, kSafe, kInit,    kSafe,    kSafe,   kSafe,    kSafe,    kSafe,    kSafe, kSafe},
};
// clang-format on

bool tiller_machine_moves(const tiller_machine_t* m) {
  return m->state == tiller_state_active || m->state == tiller_state_hold;
}

tiller_status_t tiller_machine_on(tiller_machine_t* m, tiller_event_t event, tiller_status_t why) {
  const int8_t next = kNext[m->state][event];
  bool at_fault = false;
  if (next == kRefused) return tiller_status_wrong_state;

  m->state = (tiller_state_t)next;
  if (event == tiller_event_arm) m->armed = true;
  if (event == tiller_event_disarm || event == tiller_event_reset || m->state == tiller_state_safe) m->armed = false;

  at_fault = m->state == tiller_state_hold || m->state == tiller_state_safe;
  if (!at_fault) m->first_fault = tiller_status_ok;
  if (at_fault && m->first_fault == tiller_status_ok) m->first_fault = why;
  return tiller_status_ok;
}

void tiller_machine_measured(tiller_machine_t* m) {
  (void)tiller_machine_on(m, m->armed ? tiller_event_cleared : tiller_event_measured, tiller_status_ok);
}
