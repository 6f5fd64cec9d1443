#include "safety/answer.h"

tiller_status_t tiller_answer(const tiller_machine_t* m, tiller_gate_t* g, const tiller_gate_cones_t* cones,
                              const double* planned, const double* hold, double elapsed_s, double* out) {
  if (!tiller_machine_moves(m)) {
    tiller_gate_send_safe(g, out);
    return tiller_status_ok;
  }
  if (m->state == tiller_state_hold) return tiller_gate_pass(g, cones, hold, hold, elapsed_s, out);
  return tiller_gate_pass(g, cones, planned, hold, elapsed_s, out);
}
