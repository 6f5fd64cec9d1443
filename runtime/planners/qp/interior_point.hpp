#pragma once

#include "planners/qp/cone_bound.hpp"

namespace tiller {

/// Interior point over the Riccati sweep: Mehrotra's predictor and corrector (SIAM J. Optimization 2, 1992) for
/// programs along a horizon (Rao, Wright, Rawlings 1998). Bounds enter a sweep as additions to diagonals and gradients,
/// so an iteration costs one factorisation (cubic in s, linear in N) and one more pass of matrix-vector products.
/// Slacks of soft bounds are eliminated one by one and cost nothing. Cones of a stage's inputs add a block to their
/// curvature and to their gradient (cone_bound.hpp), so a program with cones costs hardly more.
struct InteriorPoint {
  /// One side of one variable's bound: t = sign (v - bound) + e > 0 with multiplier y > 0; soft: e > 0 with multiplier
  /// r > 0 and l + w e - y - r = 0.
  struct Bound {
    std::uint32_t at = 0;  // index into x (k * s + i) or u (k * m + i)
    bool of_state = false, soft = false;
    double sign = 1.0, bound = 0.0, linear = 0.0, quadratic = 0.0;
    double t = 1.0, y = 1.0, e = 0.0, r = 0.0;
    // of one iteration
    double gap_residual = 0.0, slack_residual = 0.0, target = 0.0, slack_target = 0.0;
    double dt = 0.0, dy = 0.0, de = 0.0, dr = 0.0;
  };
  const LqKernel* kernel = nullptr;
  LqFactor factor;
  std::uint32_t most_bounds = 0, count = 0;
  Bound* bound = nullptr;               // (most_bounds)
  double *dx = nullptr, *du = nullptr;  // (N+1 x s), (N x m)
  double* pi = nullptr;                 // (N+1 x s) change of the multipliers
  double *gx = nullptr, *gu = nullptr;  // gradient of the Lagrangian at the iterate
  double *hx = nullptr, *hu = nullptr;  // and with the eliminated bounds' share
  double *px = nullptr, *pu = nullptr;  // additions to the diagonals
  double* fixed_low = nullptr;          // (N x m) zero: an input with low = high takes no step
  // cones; null where there are none
  std::uint32_t cone_count = 0, most_cones = 0;
  ConeBound* cone = nullptr;         // (most_cones)
  double* cone_curvature = nullptr;  // (N x m x m) what cones add to the inputs' curvature at the last iterate
  double* cone_hessian = nullptr;    // quu, or of the lifted problem qxx, with it
};

/// Room for programs of these sizes.
InteriorPoint lay_out_interior_point(Arena& arena, const LqProblem& sizes, const LqKernel& kernel,
                                     const QpCones& cones = {});

/// Starts from solution.u (brought inside its bounds); fills all of the solution. Never leaves an input outside its
/// bounds; out of a cone by no more than the tolerance. The cap and the deadline leave the best iterate so far, whose
/// dynamics hold exactly.
QpReport solve_interior_point(InteriorPoint& work, const Qp& qp, const QpLimits& limits, QpSolution& solution);

}  // namespace tiller
