/* Contracts that do not hold. ./dev prove fails if it proves one of them: then it proves too much. */
#include "safety/answer.h"

/* A NaN comes through. */
/*@ requires \le_double(low, high);
    assigns \nothing;
    ensures wrong: within(low, \result, high);
*/
double lets_nan_through(double x, double low, double high) { return x < low ? low : high < x ? high : x; }

/* The sum may round to more than the step. */
/*@ requires finite(last) && step_like(step);
    assigns \nothing;
    ensures wrong: \le_double(change(last, \result), step);
*/
double rounds_up(double last, double step) { return last + step; }

/* 0 * infinity. */
/*@ requires step_like(rate_per_s) && step_like(time_s);
    assigns \nothing;
    ensures wrong: step_like(\result);
*/
double may_be_nan(double rate_per_s, double time_s) { return rate_per_s * time_s; }

/* The last input is forgotten. */
/*@ requires \valid(g) && ready(g) && \valid(out + (0 .. g->count - 1)) && \separated(g, out + (0 .. g->count - 1));
    assigns out[0 .. g->count - 1];
    ensures wrong: \forall integer i; 0 <= i < g->count ==> within(g->low[i], out[i], g->high[i]);
*/
void forgets_one(const tiller_gate_t* g, double* out) {
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < i ==> within(g->low[k], out[k], g->high[k]);
      loop assigns i, out[0 .. g->count - 1];
      loop variant g->count - i;
  */
  for (i = 0; i + 1 < g->count; ++i) out[i] = g->last[i];
}

/* What goes out may be read from what it overwrites. */
/*@ requires \valid(g) && ready(g) && \valid(out + (0 .. TILLER_MAX_INPUTS - 1));
    assigns out[0 .. TILLER_MAX_INPUTS - 1];
    ensures wrong: ready(g);
*/
void may_overlap(const tiller_gate_t* g, double* out) { out[0] = g->high[0] + 1.0; }

/* A failed plan does not disarm. */
/*@ requires \valid(m) && orderly(m);
    assigns *m;
    ensures wrong: !m->armed;
*/
void stays_armed(tiller_machine_t* m) {
  (void)tiller_machine_on(m, tiller_event_plan_failed, tiller_status_plan_not_finite);
}

/* INIT is left to SAFE by a stop alone, but STANDBY by lost sensors too. */
/*@ requires \valid(m) && orderly(m) && m->state != tiller_state_safe && 0 <= event < tiller_machine_events;
    requires event != tiller_event_cleared;
    assigns *m;
    ensures wrong: m->state == tiller_state_safe ==> event == tiller_event_stop;
*/
void forgets_sensors(tiller_machine_t* m, tiller_event_t event) { (void)tiller_machine_on(m, event, tiller_status_ok); }
