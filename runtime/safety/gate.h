/** The output gate's decisions in C99, with contracts (ACSL) that ./dev prove discharges: docs/safety/proof.md. What is
 *  stated here holds for every double that comes in, NaN and infinities included. OutputGate is its C++ side. */
#ifndef TILLER_SAFETY_GATE_H_
#define TILLER_SAFETY_GATE_H_

#include <float.h>
#include <stdint.h>

#include "tiller/tiller.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Cuts below this share of the range are rounding, not news: a planner that samples in single precision lands within
 *  6e-8 of a limit. They are made all the same, but neither reported nor counted. */
#define TILLER_GATE_ROUNDING 1e-6

/** Limits, the command in force and what the gate has counted. */
typedef struct tiller_gate {
  uint32_t count; /**< nu */
  double low[TILLER_MAX_INPUTS];
  double high[TILLER_MAX_INPUTS];
  double rate_per_s[TILLER_MAX_INPUTS]; /**< INFINITY: none */
  double safe_command[TILLER_MAX_INPUTS];
  double period_s;                /**< of the control tick */
  double last[TILLER_MAX_INPUTS]; /**< the command in force */
  uint64_t cuts;                  /**< commands that were cut to a limit */
  uint64_t rejections;            /**< commands with a NaN or an infinity */
} tiller_gate_t;

/** Cones that tie inputs together: the core carries them to tiller_gate_apply_cones and does not look inside. */
typedef struct tiller_gate_cones tiller_gate_cones_t;

/* Comparisons are those of C: false where a side is NaN.

   finite          neither NaN nor an infinity
   within          low <= x <= high
   near            x is within `step` of `last`, by one of two sums in doubles; they differ by a rounding
   allows          `step` is what a rate allows in a time: of an infinite rate anything, of one that is not positive or
                   a time that is not positive nothing, else the rate times the shorter of period and elapsed time,
                   which counts a microsecond more: stamps are whole ones
   in_limits       finite limits around the safe command and the command in force, of input i
   only_safe       no other command than the safe one is within the limits of input i
   ready           all inputs of a gate are in_limits: what tiller_gate_settle makes true and every function keeps
   admissible      what may go out for input i after `elapsed_s`

   \\eq_double stands for ==, which in a contract compares real numbers.                                            */
/*@ predicate finite(double x) = \le_double((double)(-DBL_MAX), x) && \le_double(x, (double)DBL_MAX);
    predicate within(double low, double x, double high) = \le_double(low, x) && \le_double(x, high);
    predicate positive(double x) = \lt_double((double)0.0, x);
    predicate step_like(double x) = \le_double((double)0.0, x);

    logic double below(double last, double step) = \sub_double(last, step);
    logic double above(double last, double step) = \add_double(last, step);
    logic double change(double from, double to) = \sub_double(to, from);
    predicate near(double last, double step, double x) =
      within(below(last, step), x, above(last, step)) ||
      (\le_double(change(last, x), step) && \le_double(change(x, last), step));

    logic double counted(double elapsed_s) = \add_double(elapsed_s, (double)0x1.0c6f7a0b5ed8dp-20);
    predicate product(double x, double a, double b) = \eq_double(x, \mul_double(a, b));
    predicate zero(double x) = \eq_double(x, (double)0.0);
    predicate allows(double rate_per_s, double elapsed_s, double period_s, double step) = step_like(step) &&
      (!positive(rate_per_s) ? zero(step) :
       \lt_double((double)DBL_MAX, rate_per_s) ? \eq_double(step, rate_per_s) :
       !positive(elapsed_s) ? zero(step) :
       !\lt_double(period_s, counted(elapsed_s)) ? product(step, rate_per_s, counted(elapsed_s)) :
       positive(period_s) ? product(step, rate_per_s, period_s) : zero(step));

    predicate in_limits{L}(tiller_gate_t* g, integer i) = \at(
      finite(g->low[i]) && finite(g->high[i]) && within(g->low[i], g->safe_command[i], g->high[i]) &&
      within(g->low[i], g->last[i], g->high[i]), L);
    predicate only_safe{L}(tiller_gate_t* g, integer i) = \at(
      \eq_double(g->low[i], g->safe_command[i]) && \eq_double(g->high[i], g->safe_command[i]), L);
    predicate ready{L}(tiller_gate_t* g) = \at(
      g->count <= TILLER_MAX_INPUTS && (\forall integer i; 0 <= i < g->count ==> in_limits(g, i)), L);
    predicate admits(double low, double high, double rate_per_s, double period_s, double last, double elapsed_s,
                     double x) = within(low, x, high) &&
      (\exists double step; allows(rate_per_s, elapsed_s, period_s, step) && near(last, step, x));
    predicate admissible{L}(tiller_gate_t* g, integer i, double elapsed_s, double x) = \at(
      admits(g->low[i], g->high[i], g->rate_per_s[i], g->period_s, g->last[i], elapsed_s, x), L);
*/

/** Takes any limits and leaves usable ones: reversed limits or such that are not finite leave only the safe command, a
 *  safe command that is not finite becomes 0, and one outside of the limits is brought in. */
/*@ requires \valid(g);
    assigns g->count, g->low[0 .. TILLER_MAX_INPUTS - 1], g->high[0 .. TILLER_MAX_INPUTS - 1],
            g->safe_command[0 .. TILLER_MAX_INPUTS - 1], g->last[0 .. TILLER_MAX_INPUTS - 1];
    ensures ready(g);
*/
void tiller_gate_settle(tiller_gate_t* g);

/** Leaves only the safe command, which is then in force. */
/*@ requires \valid(g) && ready(g);
    assigns g->low[0 .. TILLER_MAX_INPUTS - 1], g->high[0 .. TILLER_MAX_INPUTS - 1],
            g->last[0 .. TILLER_MAX_INPUTS - 1];
    ensures ready(g);
    ensures \forall integer i; 0 <= i < g->count ==> only_safe(g, i);
*/
void tiller_gate_close(tiller_gate_t* g);

/** Another safe command (nu), from which the first change of the command counts. What lies outside of the limits is
 *  not taken. */
/*@ requires \valid(g) && ready(g);
    requires \valid_read(safe + (0 .. g->count - 1)) && \separated(g, safe + (0 .. g->count - 1));
    assigns g->safe_command[0 .. TILLER_MAX_INPUTS - 1], g->last[0 .. TILLER_MAX_INPUTS - 1];
    ensures ready(g);
*/
void tiller_gate_begin(tiller_gate_t* g, const double* safe);

/** What input `i` may change in `elapsed_s`; never NaN. */
/*@ requires \valid_read(g) && i < TILLER_MAX_INPUTS;
    assigns \nothing;
    ensures step_like(\result);
    ensures allows(g->rate_per_s[i], elapsed_s, g->period_s, \result);
*/
double tiller_gate_step(const tiller_gate_t* g, uint32_t i, double elapsed_s);

/** Puts `u`, which is within limits and rates, onto the cones. Defined in output_gate.cpp, which is not proven: nothing
 *  is assumed of it but what it writes. */
/*@ requires \valid_read(g) && \valid(u + (0 .. TILLER_MAX_INPUTS - 1));
    assigns u[0 .. TILLER_MAX_INPUTS - 1], \result;
*/
tiller_status_t tiller_gate_apply_cones(const tiller_gate_cones_t* cones, const tiller_gate_t* g, double elapsed_s,
                                        double* u);

/** `wanted` (nu) through the limits into `out` (nu); null or not finite: `fallback` (nu), and where that is not either,
 *  the safe command. What the cones make of it goes out if it is admissible; else the command in force stays. Cones
 *  null: none. Returns ok, command_limited, rate_limited or command_not_finite. */
/* Requirement: SR-1, SR-2 */
/*@ requires \valid(g) && ready(g);
    requires wanted == \null || \valid_read(wanted + (0 .. g->count - 1));
    requires fallback == \null || \valid_read(fallback + (0 .. g->count - 1));
    requires \valid(out + (0 .. g->count - 1)) && \separated(g, out + (0 .. g->count - 1));
    requires \separated(out + (0 .. g->count - 1), wanted + (0 .. g->count - 1));
    requires \separated(out + (0 .. g->count - 1), fallback + (0 .. g->count - 1));
    assigns out[0 .. g->count - 1], g->last[0 .. TILLER_MAX_INPUTS - 1], g->cuts, g->rejections;
    ensures ready(g);
    ensures \forall integer i; 0 <= i < g->count ==> admissible{Pre}(g, i, elapsed_s, out[i]);
    ensures \forall integer i; 0 <= i < g->count ==> \eq_double(g->last[i], out[i]);
    ensures in_limits: \forall integer i; 0 <= i < g->count ==> within(g->low[i], out[i], g->high[i]);
*/
tiller_status_t tiller_gate_pass(tiller_gate_t* g, const tiller_gate_cones_t* cones, const double* wanted,
                                 const double* fallback, double elapsed_s, double* out);

/** The safe command at once, whatever the rate limit says. */
/* Requirement: SR-1, SR-3 */
/*@ requires \valid(g) && ready(g);
    requires \valid(out + (0 .. g->count - 1)) && \separated(g, out + (0 .. g->count - 1));
    assigns out[0 .. g->count - 1], g->last[0 .. TILLER_MAX_INPUTS - 1];
    ensures ready(g);
    ensures \forall integer i; 0 <= i < g->count ==> \eq_double(out[i], g->safe_command[i]);
    ensures \forall integer i; 0 <= i < g->count ==> \eq_double(g->last[i], out[i]);
    ensures in_limits: \forall integer i; 0 <= i < g->count ==> within(g->low[i], out[i], g->high[i]);
*/
void tiller_gate_send_safe(tiller_gate_t* g, double* out);

#ifdef __cplusplus
}
#endif

#endif /* TILLER_SAFETY_GATE_H_ */
