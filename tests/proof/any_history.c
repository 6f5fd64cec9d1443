/* Every history of calls, as long as it may be: what ./dev prove shows of the gate, the state machine and the command
   together. It is proven and analysed, never built into a program. */
#include <stddef.h>

#include "safety/answer.h"

/* From outside: anything. */
/*@ assigns \result \from \nothing; */
int any_number(void);
/*@ assigns \result \from \nothing; */
double any_double(void);
/*@ requires \valid(u + (0 .. TILLER_MAX_INPUTS - 1));
    assigns u[0 .. TILLER_MAX_INPUTS - 1] \from \nothing;
    ensures \initialized(u + (0 .. TILLER_MAX_INPUTS - 1));
*/
void any_command(double* u);
/* Cones, and what they make of a command, are anything as well: tiller_gate_apply_cones has no body here. */

/* A call or an event of a tick; a measurement is `cleared` only where the machine is armed. */
/*@ requires \valid(m) && orderly(m);
    assigns m->state, m->first_fault, m->armed;
    ensures orderly(m);
    ensures \old(m->state) == tiller_state_safe && event != tiller_event_reset ==> m->state == tiller_state_safe;
    ensures m->armed && !\old(m->armed) ==> event == tiller_event_arm;
    ensures moves(m->state) && !moves(\old(m->state)) ==> \old(m->armed);
*/
static void any_event(tiller_machine_t* m, int event, int why) {
  if (event < 0 || event >= tiller_machine_events) return;
  if (event == tiller_event_measured || event == tiller_event_cleared) {
    tiller_machine_measured(m);
  } else {
    (void)tiller_machine_on(m, (tiller_event_t)event, (tiller_status_t)why);
  }
}

/* latched: SAFE was entered and no reset has come since. permitted: an arm has come since the last that disarmed. */
/*@ requires \valid(g) && \valid(m) && \valid(planned + (0 .. TILLER_MAX_INPUTS - 1));
    requires \valid(hold + (0 .. TILLER_MAX_INPUTS - 1)) && \valid(out + (0 .. TILLER_MAX_INPUTS - 1));
    requires \separated(g, m, planned + (0 .. TILLER_MAX_INPUTS - 1), hold + (0 .. TILLER_MAX_INPUTS - 1),
                        out + (0 .. TILLER_MAX_INPUTS - 1));
    assigns *g, *m, planned[0 .. TILLER_MAX_INPUTS - 1], hold[0 .. TILLER_MAX_INPUTS - 1],
            out[0 .. TILLER_MAX_INPUTS - 1];
*/
void any_history(tiller_gate_t* g, const tiller_gate_cones_t* cones, tiller_machine_t* m, double* planned, double* hold,
                 double* out) {
  bool latched = false;
  bool permitted = false;
  m->state = tiller_state_init;
  m->first_fault = tiller_status_ok;
  m->armed = false;
  tiller_gate_settle(g);
  /*@ loop invariant ready(g) && orderly(m);
      loop invariant latched ==> m->state == tiller_state_safe;
      loop invariant m->armed ==> permitted;
      loop assigns *g, *m, planned[0 .. TILLER_MAX_INPUTS - 1], hold[0 .. TILLER_MAX_INPUTS - 1],
                   out[0 .. TILLER_MAX_INPUTS - 1], latched, permitted;
  */
  while (any_number() != 0) {
    const int event = any_number();
    any_event(m, event, any_number());
    if (event == tiller_event_reset) latched = false;
    if (event == tiller_event_arm) permitted = true;
    if (!m->armed) permitted = false;
    if (m->state == tiller_state_safe) latched = true;
    if (any_number() == 0) continue; /* more events before the tick sends */
    any_command(planned);
    any_command(hold);
    (void)tiller_answer(m, g, cones, planned, hold, any_double(), out);
    //@ assert within_limits: \forall integer i; 0 <= i < g->count ==> within(g->low[i], out[i], g->high[i]);
    /*@ assert latched_is_safe: latched ==>
          (\forall integer i; 0 <= i < g->count ==> \eq_double(out[i], g->safe_command[i])); */
    /*@ assert not_permitted_is_safe: !permitted ==>
          (\forall integer i; 0 <= i < g->count ==> \eq_double(out[i], g->safe_command[i])); */
  }
}

/* Where the analysis by values begins: limits that are anything. */
int main(void) {
  tiller_gate_t gate = {0};
  tiller_machine_t machine = {tiller_state_init, tiller_status_ok, false};
  double planned[TILLER_MAX_INPUTS] = {0.0};
  double hold[TILLER_MAX_INPUTS] = {0.0};
  double out[TILLER_MAX_INPUTS] = {0.0};
  gate.count = (uint32_t)any_number();
  gate.period_s = any_double();
  any_command(gate.low);
  any_command(gate.high);
  any_command(gate.rate_per_s);
  any_command(gate.safe_command);
  /* that there are cones is all that the core sees of them */
  any_history(&gate, any_number() != 0 ? (const tiller_gate_cones_t*)planned : NULL, &machine, planned, hold, out);
  return 0;
}
