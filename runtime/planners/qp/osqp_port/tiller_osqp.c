/* One translation unit of OSQP's sources, which the build finds in the Python wheel, and six functions around them. */

#include "tiller_osqp.h"

#include <limits.h>
#include <stdint.h>
#include <string.h>

#include "amd.h"
#include "tiller_osqp_memory.h"

#define TILLER_OSQP_API __attribute__((visibility("default")))

/* ---- memory: a block that is only ever filled, during a setup on this thread --------------------------------- */

enum { kAlign = 16 };

static _Thread_local unsigned char* block_now;
static _Thread_local size_t block_size, block_used;
static _Thread_local const int* order_now;
static long refused; /* read and written with the compiler's atomics */

void* tiller_osqp_take(size_t size) {
  const size_t rounded = (size + kAlign - 1) / kAlign * kAlign;
  if (!block_now) {
    __atomic_add_fetch(&refused, 1, __ATOMIC_RELAXED);
    return NULL;
  }
  if (size > block_size || rounded > block_size - block_used) return NULL;
  void* piece = block_now + block_used;
  block_used += rounded;
  return piece;
}
void* tiller_osqp_take_zeroed(size_t count, size_t size) {
  if (size != 0 && count > SIZE_MAX / size) return NULL;
  void* piece = tiller_osqp_take(count * size);
  if (piece) memset(piece, 0, count * size);
  return piece;
}
void* tiller_osqp_resize(void* old, size_t size) {
  (void)old;
  (void)size;
  __atomic_add_fetch(&refused, 1, __ATOMIC_RELAXED); /* no source that is built here resizes */
  return NULL;
}
void tiller_osqp_give_back(void* piece) { (void)piece; }

int amd_order(int n, const int* column, const int* row, int* order, double* control, double* info) {
  (void)column;
  (void)row;
  (void)control;
  (void)info;
  if (!order_now) return -1;
  for (int i = 0; i < n; ++i) order[i] = order_now[i];
  return 0;
}

/* What follows is not ours to mend, and OSQP names its macros. */
/* NOLINTBEGIN(bugprone-suspicious-include,readability-identifier-naming) */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpragmas"
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
/* Derivatives of solutions are never asked for; they are the only place that knows the heap by name. */
#define malloc tiller_osqp_take
#define free tiller_osqp_give_back
#include "algebra_libs.c"
#include "auxil.c"
#include "csc_math.c"
#include "csc_utils.c"
#include "error.c"
#include "kkt.c"
#include "matrix.c"
#include "osqp_api.c"
#include "qdldl.c"
#include "qdldl_interface.c"
#include "scaling.c"
#include "util.c"
#include "vector.c"
#undef malloc
#undef free
#pragma GCC diagnostic pop
/* NOLINTEND(bugprone-suspicious-include,readability-identifier-naming) */

/* ---- the six functions --------------------------------------------------------------------------------------- */

TILLER_OSQP_API size_t tiller_osqp_bytes(int n, int m, int p_entries, int a_entries, long factor_entries) {
  const size_t nm = (size_t)n + (size_t)m, kkt = (size_t)p_entries + (size_t)a_entries + nm;
  const size_t number = sizeof(OSQPFloat), index = sizeof(OSQPInt);
  /* copies of the problem; the matrix of the linear system, formed and permuted, with its maps; the factor; vectors
   * over z, over rows and over both; pieces are rounded up, and structs are small */
  const size_t problem = ((size_t)p_entries + (size_t)a_entries) * (number + index) + 2 * ((size_t)n + 1) * index;
  const size_t system = kkt * (3 * number + 5 * index) + 8 * (nm + 1) * index;
  const size_t factor = (size_t)factor_entries * (number + index);
  const size_t vectors = nm * (32 * number + 16 * index);
  return problem + system + factor + vectors + 16384;
}

static OSQPCscMatrix matrix_view(int rows, int columns, const int* column, const int* row, const double* value) {
  OSQPCscMatrix m;
  memset(&m, 0, sizeof m);
  m.m = rows;
  m.n = columns;
  m.p = (OSQPInt*)column;
  m.i = (OSQPInt*)row;
  m.x = (OSQPFloat*)value;
  m.nzmax = column[columns];
  m.nz = -1;
  return m;
}

TILLER_OSQP_API void* tiller_osqp_setup(const tiller_osqp_problem* problem, double tolerance, void* block, size_t size,
                                        size_t* used) {
  OSQPSettings settings;
  OSQPSolver* solver = NULL;
  const OSQPCscMatrix p = matrix_view(problem->n, problem->n, problem->p_column, problem->p_row, problem->p_value);
  const OSQPCscMatrix a = matrix_view(problem->m, problem->n, problem->a_column, problem->a_row, problem->a_value);
  osqp_set_default_settings(&settings);
  settings.verbose = 0;
  settings.polishing = 0;
  settings.warm_starting = 1;
  settings.adaptive_rho = OSQP_ADAPTIVE_RHO_UPDATE_ITERATIONS; /* never by time: same inputs, same bits */
  settings.adaptive_rho_interval = 25;                         /* solves come in slices of so many */
  settings.check_termination = 5;
  settings.eps_abs = tolerance;
  settings.eps_rel = tolerance;
  settings.scaling = 10;
  block_now = block;
  block_size = size;
  block_used = 0;
  order_now = problem->order;
  const OSQPInt error =
      osqp_setup(&solver, &p, problem->q, &a, problem->low, problem->high, problem->m, problem->n, &settings);
  *used = block_used;
  block_now = NULL;
  order_now = NULL;
  return error ? NULL : solver;
}

TILLER_OSQP_API int tiller_osqp_update(void* solver, const double* p_value, const double* a_value, const double* q,
                                       const double* low, const double* high) {
  OSQPSolver* s = solver;
  if (p_value || a_value) {
    const OSQPInt error = osqp_update_data_mat(s, p_value, NULL, 0, a_value, NULL, 0);
    if (error) return 1;
  }
  return osqp_update_data_vec(s, q, low, high) ? 1 : 0;
}

TILLER_OSQP_API void tiller_osqp_set_tolerance(void* solver, double tolerance) {
  OSQPSolver* s = solver;
  s->settings->eps_abs = tolerance;
  s->settings->eps_rel = tolerance;
}

TILLER_OSQP_API void tiller_osqp_warm_start(void* solver, const double* z, const double* y) {
  if (z)
    osqp_warm_start(solver, z, y);
  else
    osqp_cold_start(solver);
}

TILLER_OSQP_API tiller_osqp_result tiller_osqp_solve(void* solver, int iterations) {
  OSQPSolver* s = solver;
  tiller_osqp_result result;
  s->settings->max_iter = iterations;
  const OSQPInt error = osqp_solve(s);
  result.iterations = s->info->iter;
  result.primal_residual = s->info->prim_res;
  result.dual_residual = s->info->dual_res;
  result.z = s->solution->x;
  result.y = s->solution->y;
  const OSQPInt status = s->info->status_val;
  const int unfinished = status == OSQP_MAX_ITER_REACHED || status == OSQP_SOLVED_INACCURATE;
  result.solved = -1;
  if (!error && status == OSQP_SOLVED)
    result.solved = 1;
  else if (!error && unfinished)
    result.solved = 0;
  return result;
}

TILLER_OSQP_API long tiller_osqp_refused(void) { return __atomic_load_n(&refused, __ATOMIC_RELAXED); }
