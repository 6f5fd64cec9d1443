#pragma once

#include "planners/path_plan.hpp"
#include "planners/qp/interior_point.hpp"

namespace tiller {

// Second-order cones in the linear-quadratic problem around a path. The problem with its cones is convex, and the
// interior point solves it as it is, so an iteration of a gradient planner linearises the dynamics and nothing of a
// cone.

/// The interior point for a planner whose own solver knows a box alone.
struct ConeProgram {
  InteriorPoint interior;
  QpSolution solution;
};

/// The cones of the path's inputs, for problems in their changes.
inline QpCones path_cones(const PathPlan& p) { return {p.cones.count > 0 ? &p.cones : nullptr, p.control, false, 0}; }

/// Whether the path's inputs with the changes du (N x nu) are within the cones, to rounding.
inline bool path_within_cones(const PathPlan& p, const double* du) {
  return cones_within(path_cones(p), p.problem, du);
}

/// Gains around a solution dx, du of the path's problem: one sweep with the inputs at their bounds held and the cones'
/// curvature added (null: none; N x nu x nu), so that answers to deviations go along the cones that are in force; and
/// the step with which the gains end at the solution.
void take_gains(PathPlan& p, const double* dx, const double* du, const double* curvature);

/// Room for it where the plan has cones.
void lay_out_cone_program(Arena& arena, const RolloutTable& table, const PathPlan& p, ConeProgram& program);
/// Solves the path's problem with box and cones from p.du; fills dx, du and factor. False, and nothing is changed,
/// where no solution came of it. Costs ten to twenty sweeps.
bool solve_with_cones(PathPlan& p, ConeProgram& program, const Deadline& deadline);

}  // namespace tiller
