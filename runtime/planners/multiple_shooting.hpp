#pragma once

#include "planners/path_plan.hpp"

namespace tiller {

// Multiple shooting (Bock and Plitt 1984) on a path: the states are variables beside the inputs, and the path need not
// be a motion of the model. Its defects, next - state, are constant terms of the program's dynamics (take_defects). A
// step along the program's solution is judged by an l1 merit function:
//
//     risk of the path + penalty * |defects|_1 + weight * |excess over bounds on states|_1

/// Bounds on states that the merit counts; without arrays there are none.
struct MeritBounds {
  const double *low = nullptr, *high = nullptr;  // (nx)
  const double* margin = nullptr;                // (N+1 x M x nx) by which they stand nearer; null: by nothing
  double weight = 0.0;
};

/// The solution of the program around the path.
struct PathStep {
  const double* dx = nullptr;  // (N+1 x M x n)
  const double* du = nullptr;  // (N x nu)
};

struct MultipleShooting {
  double penalty = 0.0;  // of defects; grows within a plan
  // ---- of the last step
  double merit = 0.0;     // of the path that it began from
  double expected = 0.0;  // change of the merit, to first order
};

/// l1 norm of what the path lacks of being a motion of the model from the start, after linearise_path.
double path_defects(const PathPlan& p);
/// l1 norm of what the path's states are beyond the bounds.
double path_excess(const PathPlan& p, const MeritBounds& bounds);

/// Moves the path along the step, with as much of it as lowers the merit. Needs the problem of the present path
/// (linearise_path, quadratise_path). True: the problem is that of the moved path. False: the path is as it was, and
/// the problem is void. Overwrites the line search's candidates.
bool step_by_merit(PathPlan& p, const PathStep& step, const MeritBounds& bounds, MultipleShooting& shooting);

}  // namespace tiller
