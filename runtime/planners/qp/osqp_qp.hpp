#pragma once

#include "planners/qp/qp.hpp"

namespace tiller {

/// Programs along a horizon for OSQP: z = (u_0, x_1, u_1, ..., x_N, slacks), rows = (dynamics, input bounds, bounds on
/// states). The pattern is set once; numbers may change with every solve.
struct OsqpShape {
  LqProblem sizes;                        // sizes alone are read, and whether qux is null
  const std::uint8_t* bounded = nullptr;  // (s) 1: the state has bounds; null: none
  const std::uint8_t* soft = nullptr;     // (s) 1: and they are soft; null: all hard
  // Entries that may be nonzero, row-major (n x n), (n x m), (n x n), (m x m), for every stage and scenario; null: all.
  const std::uint8_t *a = nullptr, *b = nullptr, *qxx = nullptr, *quu = nullptr;
  const std::int32_t* order = nullptr;  // of elimination; null: stage by stage
  double tolerance = 1e-6;              // absolute and relative, as OSQP means it
};

struct OsqpQp {
  OsqpShape shape;
  void* solver = nullptr;  // null: not built, or refused
  int n = 0, m = 0, slacks = 0;
  int *p_column = nullptr, *p_row = nullptr, *a_column = nullptr, *a_row = nullptr, *order = nullptr;
  double *p_value = nullptr, *a_value = nullptr, *q = nullptr, *low = nullptr, *high = nullptr;
  double *z = nullptr, *y = nullptr;             // start of the next solve
  bool matrices_stand = false;                   // the solver's are p_value and a_value, and its last solve went well
  std::size_t memory_used = 0, memory_size = 0;  // of OSQP's own block
};

/// False if this build has no OSQP.
bool has_osqp();

/// Pattern and solver in the arena; nothing allocates afterwards. The shape's arrays are copied from, not kept.
OsqpQp lay_out_osqp(Arena& arena, const OsqpShape& shape);

/// Starts from solution (x, u and the multipliers) if `warm`, and fills it. The deadline is read every 25 steps.
QpReport solve_osqp(OsqpQp& work, const Qp& qp, const QpLimits& limits, bool warm, QpSolution& solution);

/// How often OSQP asked for memory after its setup, in all of the process: zero, or something is broken.
long osqp_refused_allocations();

}  // namespace tiller
