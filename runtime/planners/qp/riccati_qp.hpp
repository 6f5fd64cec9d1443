#pragma once

#include "planners/qp/interior_point.hpp"

namespace tiller {

/// The structure-exploiting solver. First an active set over the inputs' bounds alone, whose step is one Riccati sweep
/// with the held inputs at their bounds (a semi-smooth Newton method; Hintermueller, Ito, Kunisch 2002): without an
/// active bound the first sweep is the answer, with the last solve's set as a start mostly the second, and it is exact
/// to rounding. If it does not settle, or states leave their bounds, the interior point takes over.
struct RiccatiQp {
  InteriorPoint interior;
  std::int8_t* held = nullptr;  // (N x m) active set of the last solve; -1 low, 1 high
};

RiccatiQp lay_out_riccati_qp(Arena& arena, const LqProblem& sizes, const LqKernel& kernel);

/// Starts from work.held (and, in the interior, from solution.u); fills all of the solution.
QpReport solve_riccati_qp(RiccatiQp& work, const Qp& qp, const QpLimits& limits, QpSolution& solution);

/// Drops the active set of the first `steps` stages; the last one's is repeated.
void shift_active_set(RiccatiQp& work, const LqProblem& sizes, std::uint32_t steps);

}  // namespace tiller
