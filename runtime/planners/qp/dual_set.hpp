#pragma once

#include "planners/qp/dual_rows.hpp"
#include "planners/qp/qp.hpp"

namespace tiller {

/// A dual active set (Goldfarb and Idnani 1983) over bounds on inputs and states, on responses: what one unit of a
/// bound's multiplier does to states and inputs is a column. A Riccati factor without bounds gives it in one pass of
/// matrix-vector products, and it is kept while the matrices stay. A set of w bounds is then a dense system of w
/// unknowns, and its solution w columns added up: one pass and no factorisation where the matrices stand and the bounds
/// were active before. Exact to rounding; a set that no multipliers hold together is an infeasible program.
///
/// Worth its memory where columns are short: worth_dual_set is the rule. A soft bound is held as long as its penalty
/// outweighs its multiplier; programs that exceed one, and cones, are for others.
struct DualQp {
  static constexpr std::uint32_t kMost = 64;  // bounds at once; more are for a method that is linear in the horizon
  static constexpr std::uint16_t kNone = 0xffff;
  struct Active {
    std::uint32_t row = 0;  // of (x, u)
    std::int8_t side = 0;   // 1: high, -1: low
    std::uint16_t column = 0;
    double y = 0.0;  // its multiplier, positive at the high side
  };
  const LqKernel* kernel = nullptr;
  LqFactor factor;            // without bounds, but for inputs without room
  LqFactor response;          // the same with vectors of its own
  std::size_t length = 0;     // of a column (x, u)
  double* base = nullptr;     // (length) without bounds
  double* iterate = nullptr;  // (length)
  double* column = nullptr;   // (kept x length)
  std::uint32_t kept = 0;
  std::uint32_t* owner = nullptr;               // (kept) rows of the columns
  std::uint16_t* column_of = nullptr;           // (x and u) or kNone
  double *unit_x = nullptr, *unit_u = nullptr;  // zeros, but for one while its column is made
  double* cholesky = nullptr;                   // (kMost x kMost) lower, its diagonal inverted
  double* gap = nullptr;                        // (kMost) scratch
  std::int8_t* held = nullptr;                  // (x and u) the set to start from: -1 low, 1 high
  Active active[kMost];
  std::uint32_t count = 0, columns = 0, next = 0;
  double* matrices = nullptr;  // those that take_matrices had last, and
  LqProblem taken;             // their sizes
  bool sound = false;          // factor and columns are those of the last solve
};

/// Whether a dual set is the first thing to try, by the length of a column.
bool worth_dual_set(const LqProblem& sizes);
/// `few_columns`: room for those of one set, where matrices rarely stand from solve to solve.
DualQp lay_out_dual_set(Arena& arena, const LqProblem& sizes, const LqKernel& kernel, bool few_columns = false);

void forget_active_set(DualQp& work);
/// Whether the matrices are those of the call before, to the bit: what Qp::repeats says.
bool take_matrices(DualQp& work, const LqProblem& problem);
/// Drops the sets of the first `steps` stages; the last one's is repeated.
void shift_active_set(DualQp& work, const LqProblem& sizes, std::uint32_t steps);

/// Starts from the set in `held` and leaves its own there. Solved, but for what complete_multipliers adds; infeasible:
/// inputs are within their bounds and states follow from them; broken; capped: for another method, `solution.x` and
/// `.u` are as they were. The clock is read before every new column, every eight bounds of a set and every ten
/// microseconds of other work, so a deadline is exceeded by one pass over the stages.
QpReport solve_dual_set(DualQp& work, const Qp& qp, const QpLimits& limits, QpSolution& solution);

}  // namespace tiller
