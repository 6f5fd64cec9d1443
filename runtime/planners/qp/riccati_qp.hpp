#pragma once

#include "planners/qp/dual_set.hpp"
#include "planners/qp/interior_point.hpp"

namespace tiller {

/// An active set over the inputs' bounds, whose step is one Riccati sweep with the held inputs at their bounds (a
/// semi-smooth Newton method; Hintermueller, Ito, Kunisch 2002): without an active bound the first sweep is the answer,
/// with the last solve's set as a start mostly the second, and it is exact to rounding.
struct ActiveSetQp {
  const LqKernel* kernel = nullptr;
  LqFactor factor;              // factor.held is the set of the sweep that it stands for
  std::int8_t* held = nullptr;  // (N x m) the set to start from: -1 low, 1 high
  std::int8_t* wish = nullptr;  // (N x m) bounds that the last sweep ran into
  bool stands = false;          // the factor is that of these matrices and this set: the first sweep resolves alone
};

/// Sweeps until the set settles (solved; bounds on states are not looked at), the cap or the deadline. Inputs are
/// within their bounds and states follow from them whatever the status, unless it is broken.
QpReport solve_active_set(ActiveSetQp& work, const Qp& qp, const QpLimits& limits, QpSolution& solution);
/// The same on a tree, with a workspace for each part. A branch whose set did not change is not swept again.
QpReport solve_active_set(ActiveSetQp* const* work, const QpTree& tree, const QpLimits& limits);
bool states_within(const Qp& qp, const QpSolution& solution);
/// Drops the sets of the first `steps` stages; the last one's is repeated.
void shift_active_set(ActiveSetQp& work, const LqProblem& sizes, std::uint32_t steps);

/// Whole programs, bounds on states and all, by size and structure: the dual active set where columns are short
/// (worth_dual_set) and there are no cones; where there is none, or it gives up (a soft bound exceeded, too many
/// bounds, the deadline), the interior point. Past the deadline the caller's inputs are kept within their bounds.
struct RiccatiQp {
  DualQp dual;
  InteriorPoint interior;
};
RiccatiQp lay_out_riccati_qp(Arena& arena, const LqProblem& sizes, const LqKernel& kernel, const QpCones& cones = {},
                             bool few_columns = false);
QpReport solve_riccati_qp(RiccatiQp& work, const Qp& qp, const QpLimits& limits, QpSolution& solution);

}  // namespace tiller
