#include "safety/gate.h"

#include <stdbool.h>
#include <stddef.h>

/* Stamps are whole microseconds, so the true time since the last command may be up to one longer. */
static const double kStampGrain_s = 1e-6;

/*@ assigns \nothing;
    ensures \result <==> finite(x);
*/
static bool is_finite(double x) { return x >= -DBL_MAX && x <= DBL_MAX; }

/* Lowest and highest that a step allows, and what both mean for `last` itself. */
/*@ requires finite(last) && step_like(step);
    assigns \nothing;
    ensures \eq_double(\result, below(last, step));
    ensures \le_double(\result, last);
*/
static double lowest(double last, double step) { return last - step; }

/*@ requires finite(last) && step_like(step);
    assigns \nothing;
    ensures \eq_double(\result, above(last, step));
    ensures \le_double(last, \result);
*/
static double highest(double last, double step) { return last + step; }

/*@ requires positive(rate_per_s) && \le_double(rate_per_s, (double)DBL_MAX) && positive(time_s);
    assigns \nothing;
    ensures step_like(\result);
    ensures product(\result, rate_per_s, time_s);
*/
static double times(double rate_per_s, double time_s) { return rate_per_s * time_s; }

/* The change allowed since the last command. Neither 0 * infinity nor a NaN slips through. */
/*@ assigns \nothing;
    ensures step_like(\result);
    ensures allows(rate_per_s, elapsed_s, period_s, \result);
*/
static double rate_step(double rate_per_s, double elapsed_s, double period_s) {
  double time_s = 0.0;
  if (!(rate_per_s > 0.0)) return 0.0;
  if (rate_per_s > DBL_MAX) return rate_per_s;
  if (!(elapsed_s > 0.0)) return 0.0;
  time_s = elapsed_s + kStampGrain_s;
  //@ assert positive(time_s);
  if (!(period_s < time_s)) return times(rate_per_s, time_s);
  return period_s > 0.0 ? times(rate_per_s, period_s) : 0.0;
}

/* By more than `tolerance`. */
/*@ assigns \nothing; */
static bool apart(double a, double b, double tolerance) { return a - b > tolerance || b - a > tolerance; }

/* `x` brought into [low, high]; a NaN becomes `low`. */
/*@ requires \le_double(low, high);
    assigns \nothing;
    ensures within(low, \result, high);
    ensures within(low, x, high) ==> \eq_double(\result, x);
*/
static double brought_in(double x, double low, double high) {
  if (!(x >= low)) return low;
  return high < x ? high : x;
}

/* `x` within limits, and within `step` of `last`. */
/*@ requires within(low, last, high) && finite(low) && finite(high) && step_like(step);
    assigns \nothing;
    ensures within(low, \result, high);
    ensures near(last, step, \result);
*/
static double limited(double x, double low, double high, double last, double step) {
  const double down = lowest(last, step);
  const double up = highest(last, step);
  return brought_in(x, low < down ? down : low, up < high ? up : high);
}

/*@ requires finite(last) && step_like(step);
    assigns \nothing;
    ensures \result <==> (within(low, x, high) && near(last, step, x));
*/
static bool is_admissible(double x, double low, double high, double last, double step) {
  if (!(low <= x && x <= high)) return false;
  return (last - step <= x && x <= last + step) || (x - last <= step && last - x <= step);
}

/* One input through limits and rate. */
/*@ requires within(low, last, high) && finite(low) && finite(high);
    assigns \nothing;
    ensures admits(low, high, rate_per_s, period_s, last, elapsed_s, \result);
*/
static double limit_input(double low, double high, double rate_per_s, double period_s, double last, double elapsed_s,
                          double x) {
  return limited(x, low, high, last, rate_step(rate_per_s, elapsed_s, period_s));
}

/*@ requires within(low, last, high) && finite(low) && finite(high);
    assigns \nothing;
    ensures \result ==> admits(low, high, rate_per_s, period_s, last, elapsed_s, x);
*/
static bool may_go_out(double low, double high, double rate_per_s, double period_s, double last, double elapsed_s,
                       double x) {
  return is_admissible(x, low, high, last, rate_step(rate_per_s, elapsed_s, period_s));
}

/*@ requires command == \null || \valid_read(command + (0 .. count - 1));
    assigns \nothing;
    ensures \result ==> command != \null && (\forall integer i; 0 <= i < count ==> finite(command[i]));
*/
static bool all_finite(const double* command, uint32_t count) {
  uint32_t i = 0;
  if (command == NULL) return false;
  /*@ loop invariant 0 <= i <= count;
      loop invariant \forall integer k; 0 <= k < i ==> finite(command[k]);
      loop assigns i;
      loop variant count - i;
  */
  for (i = 0; i < count; ++i)
    if (!is_finite(command[i])) return false;
  return true;
}

/* One input's limits in order, whatever they are. */
/*@ requires \valid(low) && \valid(high) && \valid(safe) && \separated(low, high, safe);
    assigns *low, *high, *safe;
    ensures finite(*low) && finite(*high) && within(*low, *safe, *high);
*/
static void settle(double* low, double* high, double* safe) {
  if (!is_finite(*safe)) *safe = 0.0;
  if (!is_finite(*low) || !is_finite(*high) || *low > *high) *low = *high = *safe;
  *safe = brought_in(*safe, *low, *high);
}

void tiller_gate_settle(tiller_gate_t* g) {
  uint32_t i = 0;
  if (g->count > TILLER_MAX_INPUTS) g->count = TILLER_MAX_INPUTS;
  /*@ loop invariant 0 <= i <= TILLER_MAX_INPUTS;
      loop invariant \forall integer k; 0 <= k < i ==> in_limits(g, k);
      loop assigns i, g->low[0 .. TILLER_MAX_INPUTS - 1], g->high[0 .. TILLER_MAX_INPUTS - 1],
                   g->safe_command[0 .. TILLER_MAX_INPUTS - 1], g->last[0 .. TILLER_MAX_INPUTS - 1];
      loop variant TILLER_MAX_INPUTS - i;
  */
  for (i = 0; i < TILLER_MAX_INPUTS; ++i) {
    settle(&g->low[i], &g->high[i], &g->safe_command[i]);
    g->last[i] = g->safe_command[i];
  }
}

/* One input with no command but the safe one. */
/*@ requires \valid(low) && \valid(high) && \valid(last) && \valid_read(safe) && \separated(low, high, last, safe);
    requires finite(*low) && finite(*high) && within(*low, *safe, *high);
    assigns *low, *high, *last;
    ensures finite(*low) && finite(*high) && within(*low, *safe, *high) && within(*low, *last, *high);
    ensures \eq_double(*low, *safe) && \eq_double(*high, *safe);
*/
static void close_input(double* low, double* high, double* last, const double* safe) { *low = *high = *last = *safe; }

void tiller_gate_close(tiller_gate_t* g) {
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < g->count ==> in_limits(g, k);
      loop invariant \forall integer k; 0 <= k < i ==> only_safe(g, k);
      loop assigns i, g->low[0 .. TILLER_MAX_INPUTS - 1], g->high[0 .. TILLER_MAX_INPUTS - 1],
                   g->last[0 .. TILLER_MAX_INPUTS - 1];
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i) close_input(&g->low[i], &g->high[i], &g->last[i], &g->safe_command[i]);
}

void tiller_gate_begin(tiller_gate_t* g, const double* safe) {
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < g->count ==> in_limits(g, k);
      loop assigns i, g->safe_command[0 .. TILLER_MAX_INPUTS - 1], g->last[0 .. TILLER_MAX_INPUTS - 1];
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i) {
    if (g->low[i] <= safe[i] && safe[i] <= g->high[i]) g->safe_command[i] = safe[i];
    g->last[i] = g->safe_command[i];
  }
}

double tiller_gate_step(const tiller_gate_t* g, uint32_t i, double elapsed_s) {
  return rate_step(g->rate_per_s[i], elapsed_s, g->period_s);
}

/* What the limits have changed, by more than rounding. */
/*@ requires \le_double(low, high);
    assigns \nothing;
*/
static tiller_status_t told(double wanted, double value, double low, double high) {
  const double tolerance = TILLER_GATE_ROUNDING * (high - low);
  const double within = brought_in(wanted, low, high);
  if (apart(wanted, within, tolerance)) return tiller_status_command_limited;
  return apart(within, value, tolerance) ? tiller_status_rate_limited : tiller_status_ok;
}

/* Every input by itself through limits and rates. */
/*@ requires \valid_read(g) && ready(g);
    requires \valid_read(source + (0 .. g->count - 1));
    requires \valid(out + (0 .. g->count - 1)) && \separated(g, out + (0 .. g->count - 1));
    requires \separated(out + (0 .. g->count - 1), source + (0 .. g->count - 1));
    assigns out[0 .. g->count - 1];
    ensures \forall integer i; 0 <= i < g->count ==> admissible(g, i, elapsed_s, out[i]);
*/
static tiller_status_t limit_each(const tiller_gate_t* g, const double* source, double elapsed_s, double* out) {
  tiller_status_t status = tiller_status_ok;
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < i ==> admissible(g, k, elapsed_s, out[k]);
      loop assigns i, status, out[0 .. g->count - 1];
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i) {
    out[i] = limit_input(g->low[i], g->high[i], g->rate_per_s[i], g->period_s, g->last[i], elapsed_s, source[i]);
    if (status == tiller_status_ok) status = told(source[i], out[i], g->low[i], g->high[i]);
  }
  return status;
}

/* Whether all of `u` may go out. */
/*@ requires \valid_read(g) && ready(g) && \valid_read(u + (0 .. g->count - 1));
    assigns \nothing;
    ensures \result ==> (\forall integer i; 0 <= i < g->count ==> admissible(g, i, elapsed_s, u[i]));
*/
static bool all_admissible(const tiller_gate_t* g, double elapsed_s, const double* u) {
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < i ==> admissible(g, k, elapsed_s, u[k]);
      loop assigns i;
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i)
    if (!may_go_out(g->low[i], g->high[i], g->rate_per_s[i], g->period_s, g->last[i], elapsed_s, u[i])) return false;
  return true;
}

/* Onto the cones. What is then not admissible does not go out: the command in force stays. */
/*@ requires \valid_read(g) && ready(g);
    requires \valid(out + (0 .. g->count - 1)) && \separated(g, out + (0 .. g->count - 1));
    requires \forall integer i; 0 <= i < g->count ==> admissible(g, i, elapsed_s, out[i]);
    assigns out[0 .. g->count - 1];
    ensures \forall integer i; 0 <= i < g->count ==> admissible(g, i, elapsed_s, out[i]);
*/
static tiller_status_t limit_cones(const tiller_gate_t* g, const tiller_gate_cones_t* cones, double elapsed_s,
                                   double* out) {
  double u[TILLER_MAX_INPUTS] = {0.0};
  tiller_status_t status = tiller_status_ok;
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop assigns i, u[0 .. TILLER_MAX_INPUTS - 1];
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i) u[i] = out[i];
  status = tiller_gate_apply_cones(cones, g, elapsed_s, u);
  if (!all_admissible(g, elapsed_s, u)) {
    (void)limit_each(g, g->last, elapsed_s, out);
    return tiller_status_command_not_finite;
  }
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < g->count ==> admissible(g, k, elapsed_s, u[k]);
      loop invariant \forall integer k; 0 <= k < g->count ==> admissible(g, k, elapsed_s, out[k]);
      loop assigns i, out[0 .. g->count - 1];
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i) out[i] = u[i];
  return status;
}

/* What went out is in force. */
/*@ requires \valid(g) && ready(g);
    requires \valid_read(out + (0 .. g->count - 1)) && \separated(g, out + (0 .. g->count - 1));
    requires \forall integer i; 0 <= i < g->count ==> within(g->low[i], out[i], g->high[i]);
    assigns g->last[0 .. TILLER_MAX_INPUTS - 1];
    ensures ready(g);
    ensures \forall integer i; 0 <= i < g->count ==> \eq_double(g->last[i], out[i]);
*/
static void keep(tiller_gate_t* g, const double* out) {
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < g->count ==> in_limits(g, k);
      loop invariant \forall integer k; 0 <= k < i ==> \eq_double(g->last[k], out[k]);
      loop assigns i, g->last[0 .. TILLER_MAX_INPUTS - 1];
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i) g->last[i] = out[i];
}

tiller_status_t tiller_gate_pass(tiller_gate_t* g, const tiller_gate_cones_t* cones, const double* wanted,
                                 const double* fallback, double elapsed_s, double* out) {
  tiller_status_t status = tiller_status_ok;
  const bool usable = all_finite(wanted, g->count);
  if (usable) {
    status = limit_each(g, wanted, elapsed_s, out);
  } else if (all_finite(fallback, g->count)) {
    status = limit_each(g, fallback, elapsed_s, out);
  } else {
    status = limit_each(g, g->safe_command, elapsed_s, out);
  }
  if (cones != NULL) {
    const tiller_status_t by_cones = limit_cones(g, cones, elapsed_s, out);
    if (status == tiller_status_ok) status = by_cones;
  }
  keep(g, out);
  if (status != tiller_status_ok) ++g->cuts;
  if (usable) return status;
  ++g->rejections;
  return tiller_status_command_not_finite;
}

void tiller_gate_send_safe(tiller_gate_t* g, double* out) {
  uint32_t i = 0;
  /*@ loop invariant 0 <= i <= g->count;
      loop invariant \forall integer k; 0 <= k < g->count ==> in_limits(g, k);
      loop invariant \forall integer k; 0 <= k < i ==> \eq_double(out[k], g->safe_command[k]);
      loop invariant \forall integer k; 0 <= k < i ==> \eq_double(g->last[k], out[k]);
      loop assigns i, out[0 .. g->count - 1], g->last[0 .. TILLER_MAX_INPUTS - 1];
      loop variant g->count - i;
  */
  for (i = 0; i < g->count; ++i) g->last[i] = out[i] = g->safe_command[i];
}
