/* OSQP (Stellato et al., Mathematical Programming Computation 12, 2020) behind six functions. Everything else of it is
 * local to one object file, so that a program may link an OSQP of its own beside. */
#ifndef TILLER_OSQP_H_
#define TILLER_OSQP_H_

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/** min 1/2 z'Pz + q'z with low <= Az <= high. P's upper triangle and A in compressed columns; entries that may become
 *  nonzero later are part of the pattern. `order`: the order of elimination of (z, rows), a permutation of n + m. */
typedef struct tiller_osqp_problem {
  int n, m;
  const int *p_column, *p_row;
  const double* p_value;
  const int *a_column, *a_row;
  const double* a_value;
  const double *q, *low, *high;
  const int* order;
} tiller_osqp_problem;

typedef struct tiller_osqp_result {
  int solved; /**< 1: to the tolerance; 0: more iterations needed; -1: no solution exists or broken */
  int iterations;
  double primal_residual, dual_residual;
  const double *z, *y; /**< n, m; those of the last call */
} tiller_osqp_result;

/** Bytes that a setup takes from its block at most, for `factor_entries` entries in the factor. */
size_t tiller_osqp_bytes(int n, int m, int p_entries, int a_entries, long factor_entries);
/** Entries below the factor's diagonal for a pattern of that size are the caller's to bound. Null if the block is too
 *  small or the problem is refused. Everything lies in the block, which is never given back. */
void* tiller_osqp_setup(const tiller_osqp_problem* problem, double tolerance, void* block, size_t size, size_t* used);
/** New numbers in the same pattern; any pointer may be null. 0 if taken. */
int tiller_osqp_update(void* solver, const double* p_value, const double* a_value, const double* q, const double* low,
                       const double* high);
void tiller_osqp_set_tolerance(void* solver, double tolerance);
/** z and y of the next solve's start; null z: from zero. */
void tiller_osqp_warm_start(void* solver, const double* z, const double* y);
/** Up to `iterations` more, from where the last call ended. */
tiller_osqp_result tiller_osqp_solve(void* solver, int iterations);
/** How often OSQP asked for memory outside a setup, in all solvers of this process: has to stay zero. */
long tiller_osqp_refused(void);

#ifdef __cplusplus
}
#endif
#endif
