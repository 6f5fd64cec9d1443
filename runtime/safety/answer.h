/** Which command a tick sends, in C99 with contracts (ACSL) that ./dev prove discharges: docs/safety/proof.md. */
#ifndef TILLER_SAFETY_ANSWER_H_
#define TILLER_SAFETY_ANSWER_H_

#include "safety/gate.h"
#include "safety/machine.h"

#ifdef __cplusplus
extern "C" {
#endif

/** In motion the plan's command `planned`, in HOLD the feedback `hold`, each through the gate with `hold` to fall back
 *  on; in every other state the safe command. Arrays (nu), null where there is none. Returns what the gate does; ok for
 *  the safe command. */
/* Requirement: SR-1, SR-2, SR-3 */
/*@ requires \valid_read(m) && orderly(m) && \valid(g) && ready(g);
    requires planned == \null || \valid_read(planned + (0 .. g->count - 1));
    requires hold == \null || \valid_read(hold + (0 .. g->count - 1));
    requires \valid(out + (0 .. g->count - 1)) && \separated(g, m, out + (0 .. g->count - 1));
    requires \separated(out + (0 .. g->count - 1), planned + (0 .. g->count - 1));
    requires \separated(out + (0 .. g->count - 1), hold + (0 .. g->count - 1));
    assigns out[0 .. g->count - 1], g->last[0 .. TILLER_MAX_INPUTS - 1], g->cuts, g->rejections;
    ensures ready(g);
    ensures in_limits: \forall integer i; 0 <= i < g->count ==> within(g->low[i], out[i], g->high[i]);
    ensures in_rates: moves(m->state) ==>
      (\forall integer i; 0 <= i < g->count ==> admissible{Pre}(g, i, elapsed_s, out[i]));
    ensures safe_unless_in_motion: !moves(m->state) ==>
      (\forall integer i; 0 <= i < g->count ==> \eq_double(out[i], g->safe_command[i]));
    ensures safe_unless_armed: !m->armed ==>
      (\forall integer i; 0 <= i < g->count ==> \eq_double(out[i], g->safe_command[i]));
*/
tiller_status_t tiller_answer(const tiller_machine_t* m, tiller_gate_t* g, const tiller_gate_cones_t* cones,
                              const double* planned, const double* hold, double elapsed_s, double* out);

#ifdef __cplusplus
}
#endif

#endif /* TILLER_SAFETY_ANSWER_H_ */
