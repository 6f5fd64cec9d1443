/* Polishing allocates at every solve: it is left out, and no setting here asks for it. */
#ifndef TILLER_OSQP_POLISH_H_
#define TILLER_OSQP_POLISH_H_

#include "osqp_api_types.h"

static OSQPInt polish(OSQPSolver* solver) {
  (void)solver;
  return 0;
}

#endif
