/** The state machine in C99, with contracts (ACSL) that ./dev prove discharges: docs/safety/proof.md. StateMachine is
 *  its C++ side. */
#ifndef TILLER_SAFETY_MACHINE_H_
#define TILLER_SAFETY_MACHINE_H_

#include <stdbool.h>

#include "tiller/tiller.h"

#ifdef __cplusplus
extern "C" {
#endif

/** In the order of the table's columns. */
typedef enum tiller_event {
  tiller_event_arm,          /**< tiller_arm */
  tiller_event_disarm,       /**< tiller_disarm */
  tiller_event_stop,         /**< tiller_stop */
  tiller_event_reset,        /**< tiller_reset */
  tiller_event_measured,     /**< a valid measurement while disarmed */
  tiller_event_cleared,      /**< a valid measurement while armed: motion is permitted */
  tiller_event_plan_good,    /**< the planner left a finite command */
  tiller_event_plan_failed,  /**< it did not, or its plan is used up */
  tiller_event_hold_expired, /**< HOLD lasted longer than configured */
  tiller_event_sensor_fault, /**< sensors stale, frozen or rejected too often */
  tiller_event_clock_set     /**< the caller's time went back: what was measured is of another time */
} tiller_event_t;

/** How many there are. */
enum { tiller_machine_states = 5, tiller_machine_events = 11 };

typedef struct tiller_machine {
  tiller_state_t state;
  tiller_status_t first_fault; /**< why the state is HOLD or SAFE; ok in the other states */
  bool armed;
} tiller_machine_t;

/*@ predicate moves(integer state) = state == tiller_state_active || state == tiller_state_hold;
    predicate at_fault(integer state) = state == tiller_state_hold || state == tiller_state_safe;

    // True at the start and after every event: motion is armed, SAFE is not, and a reason stands only beside a fault.
    predicate orderly{L}(tiller_machine_t* m) = \at(
      0 <= m->state < tiller_machine_states && (moves(m->state) ==> m->armed) &&
      (m->state == tiller_state_safe ==> !m->armed) &&
      (!at_fault(m->state) ==> m->first_fault == tiller_status_ok), L);
*/

/** ACTIVE or HOLD: commands move the robot. */
/*@ requires \valid_read(m);
    assigns \nothing;
    ensures \result <==> moves(m->state);
*/
bool tiller_machine_moves(const tiller_machine_t* m);

/** Takes the event; wrong_state, and nothing changed, where it is not allowed. `why` is kept as the first fault where
 *  the event leads to HOLD or SAFE. The event `cleared` is for an armed machine: tiller_machine_measured sees to it. */
/* Requirement: SR-4, SR-5, SR-6, SR-7, SR-10 */
/*@ requires \valid(m) && orderly(m) && 0 <= event < tiller_machine_events;
    requires event == tiller_event_cleared ==> m->armed;
    assigns m->state, m->first_fault, m->armed;
    ensures orderly(m);
    ensures \result == tiller_status_ok || \result == tiller_status_wrong_state;
    ensures refused_changes_nothing: \result == tiller_status_wrong_state ==>
      m->state == \old(m->state) && m->armed == \old(m->armed) && m->first_fault == \old(m->first_fault);
    ensures safe_is_left_by_reset_alone:
      \old(m->state) == tiller_state_safe && event != tiller_event_reset ==> m->state == tiller_state_safe;
    ensures reset_leads_to_init_alone: \old(m->state) == tiller_state_safe ==>
      m->state == tiller_state_safe || m->state == tiller_state_init;
    ensures motion_begins_by_a_measurement_while_armed: moves(m->state) && !moves(\old(m->state)) ==>
      event == tiller_event_cleared && \old(m->armed);
    ensures armed_by_arm_alone: m->armed && !\old(m->armed) ==> event == tiller_event_arm;
    ensures stop_is_never_refused: event == tiller_event_stop ==> m->state == tiller_state_safe;
    ensures disarmed_stands: event == tiller_event_disarm ==> !moves(m->state) && !m->armed;
    ensures reset_disarms: event == tiller_event_reset && \result == tiller_status_ok ==>
      m->state == tiller_state_init && !m->armed;
    ensures reset_is_refused_in_motion:
      event == tiller_event_reset && moves(\old(m->state)) ==> \result == tiller_status_wrong_state;
    ensures sensors_lost_in_motion_or_standby_are_safe: event == tiller_event_sensor_fault &&
      \old(m->state) != tiller_state_init ==> m->state == tiller_state_safe;
    ensures a_failed_plan_holds:
      event == tiller_event_plan_failed && moves(\old(m->state)) ==> m->state == tiller_state_hold;
    ensures hold_ends: event == tiller_event_hold_expired && \old(m->state) == tiller_state_hold ==>
      m->state == tiller_state_safe;
    ensures safe_keeps_its_reason: \old(m->state) == tiller_state_safe && m->state == tiller_state_safe &&
      \old(m->first_fault) != tiller_status_ok ==> m->first_fault == \old(m->first_fault);
*/
tiller_status_t tiller_machine_on(tiller_machine_t* m, tiller_event_t event, tiller_status_t why);

/** A valid measurement: `cleared` if armed, else `measured`. */
/* Requirement: SR-5 */
/*@ requires \valid(m) && orderly(m);
    assigns m->state, m->first_fault, m->armed;
    ensures orderly(m);
    ensures moves(m->state) ==> \old(m->armed);
    ensures m->armed ==> \old(m->armed);
    ensures \old(m->state) == tiller_state_safe ==> m->state == tiller_state_safe;
*/
void tiller_machine_measured(tiller_machine_t* m);

#ifdef __cplusplus
}
#endif

#endif /* TILLER_SAFETY_MACHINE_H_ */
