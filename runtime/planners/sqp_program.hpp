#pragma once

#include "planners/path_plan.hpp"
#include "planners/qp/riccati_qp.hpp"

namespace tiller {

/// The configured limits that a program of sqp has beyond those of the inputs.
struct HardBounds {
  bool of_rates = false;                                             // some input's rate is limited
  bool of_states = false;                                            // hard_bounds names a state with a bound
  std::uint32_t hard = 0;                                            // hard_bounds; of `sqp` alone
  double low[TILLER_MAX_STATES] = {}, high[TILLER_MAX_STATES] = {};  // in the frame of the path
  bool names(std::size_t i) const;
};
void lay_out_hard_bounds(const tiller_config_t& config, const PathPlan& p, HardBounds& bounds);
/// In the frame of the path.
void place_hard_bounds(const PathPlan& p, HardBounds& bounds);

/// Penalty of what bounds on states are exceeded by: exact where it is larger than their multipliers.
struct BoundPenalty {
  double linear = 0.0, quadratic = 0.0;
};
/// From the largest gradient of the states' cost: multipliers of bounds sum such gradients over the horizon.
BoundPenalty exact_penalty(double largest_gradient);
/// At least 1.
double largest_gradient(const PathPlan& p);

/// A rollout multiplies by gains even where it takes no share of them: what is not finite must not stay.
void drop_gains(PathPlan& p);
/// What candidate `c` exceeds the bounds by, with margins (N+1 x M x nx; null: none).
double candidate_excess(const PathPlan& p, const HardBounds& bounds, const double* margin, std::uint32_t c);

/// Sequential quadratic programming solves one program an iteration, with the dynamics linearised and the cost to
/// second order (Gauss-Newton) around the path, in its deviations. The programs differ in what they carry:
///
///   plain   states as the path has them; bounds on inputs and states
///   lifted  states (z, input before), inputs are the changes: bounds on changes are bounds on inputs, and bounds on
///           inputs are bounds on states. Built only where a limit of the rate is in the way
struct SqpProgram {
  Qp qp;
  QpSolution solution;
  double *state_low = nullptr, *state_high = nullptr;          // (N+1 x s) deviations
  double *slack_linear = nullptr, *slack_quadratic = nullptr;  // (s)
};

/// The lifted program's own numbers.
struct LiftedArrays {
  double *a = nullptr, *b = nullptr, *c = nullptr, *qxx = nullptr, *qux = nullptr, *quu = nullptr, *qx = nullptr,
         *qu = nullptr, *low = nullptr, *high = nullptr, *start = nullptr;
};

/// A part of a tree of scenarios, or all of a path, with both of its programs and room to solve them.
struct SqpPart {
  SqpProgram plain, lifted;
  LiftedArrays lift;
  ActiveSetQp set;  // on the plain program
  RiccatiQp whole;  // on the lifted one where rates are limited, else on the plain one; in a tree its interior point
};

/// Where a part's rows lie on paths.
struct PartPath {
  const double* state[TILLER_MAX_SCENARIOS] = {};   // of each scenario, row 0
  const double* margin[TILLER_MAX_SCENARIOS] = {};  // null: none
  std::size_t state_stride = 0, margin_stride = 0;  // from row to row
  const double* control = nullptr;                  // (N x nu)
  const double* before = nullptr;                   // (nu) the input before the first
  const double* change_before = nullptr;            // (nu) what the program adds to it; null: nothing
};

/// Programs of `sizes`: states are the plain program's. The factor of the active set is the caller's.
void lay_out_part(Arena& arena, const PathPlan& p, const HardBounds& bounds, const LqProblem& sizes, SqpPart& part);
LqProblem lifted_sizes(const PathPlan& p, const LqProblem& sizes);

/// Bounds on states, and on the inputs of a lifted program, for the program's deviations.
void take_state_bounds(const PathPlan& p, const HardBounds& bounds, const PartPath& path, const BoundPenalty& penalty,
                       SqpProgram& program, bool lifted);
/// The cones of its inputs; in a lifted program those are the inputs before, states of its first scenario.
inline QpCones part_cones(const PathPlan& p, const PartPath& path, bool lifted) {
  return {p.cones.count > 0 ? &p.cones : nullptr, path.control, lifted, lifted ? p.nz : 0};
}
/// The lifted program from the plain one, whose matrices and start it takes; a branch's start is the caller's to set.
void build_lifted(const PathPlan& p, const PartPath& path, SqpPart& part);
/// Whether the plain solution's inputs change by no more than they may.
bool changes_within(const PathPlan& p, const PartPath& path, const SqpPart& part);
/// Where the interior point starts: the plain program's last inputs, followed as fast as they may change. Off all
/// limits then, which saves a fifth of the iterations of the slowest ticks; differences that are cut one by one would
/// add up to inputs far beyond them. `last` (nu): the input before the first, and after the call the last one.
void start_lifted(const PathPlan& p, const PartPath& path, double* last, SqpPart& part);
/// Inputs and states of the plain program from the lifted one's.
void take_lifted_solution(const PathPlan& p, SqpPart& part);
/// Of the bounds on states.
double largest_violation(const PathPlan& p, const SqpProgram& program);
bool finite_inputs(const SqpProgram& program);
/// -1, 0, 1: whether an input of the plain solution is at its low or high bound.
std::int8_t bound_of(const SqpProgram& program, std::size_t at);

}  // namespace tiller
