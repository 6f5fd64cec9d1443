#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "core/input_cone.hpp"
#include "planners/planner.hpp"
#include "rollout/lq.hpp"

namespace tiller {

/// States of one scenario: the model's, its effects', and the inputs before, where their changes are bounded.
constexpr std::uint32_t kMostQpStates = TILLER_MAX_STATES + TILLER_MAX_EFFECT_STATES + TILLER_MAX_INPUTS;

/// Second-order cones of every stage's inputs, which are `base` (N x m) and what the program adds to it: its inputs, or
/// with `of_state` the states of scenario 0 from `first` on, a stage later (the lifted problem's).
struct QpCones {
  const InputCones* cones = nullptr;  // null: none
  const double* base = nullptr;
  bool of_state = false;
  std::uint32_t first = 0;
  std::uint32_t count() const { return cones ? cones->count : 0; }
};

/// A quadratic program along a horizon: the linear-quadratic problem of rollout/lq.hpp (costs, dynamics, input bounds
/// lq.low and lq.high, scenarios under one input sequence) with a start and bounds on the states. s = scenarios x n.
///
///     minimise  [lq]  +  sum_{k=1..N} sum_i  l_i e_ki + 1/2 w_i e_ki^2
///     subject to  dynamics,  low <= u <= high,  state_low - e <= x_k <= state_high + e,  e >= 0
///
/// A soft bound's linear weight l makes an exact penalty: if it is larger than the multiplier that the hard bound
/// would have, the bound holds to the last digit wherever it can, and where it cannot, the violation is the least in
/// the l1 norm (Kerrigan and Maciejowski 2000). Bounds on the change of the inputs are input bounds of the lifted
/// problem, whose states carry the input before and whose inputs are the changes (rate_lift.hpp).
struct Qp {
  LqProblem lq;                             // lq.low, lq.high (N x m): infinite or null for none; no diagonals
  const double* start = nullptr;            // (s) x_0
  const double* state_low = nullptr;        // (N+1 x s), row 0 has no say; null: no bounds on states
  const double* state_high = nullptr;       // (N+1 x s)
  const double* slack_linear = nullptr;     // (s) l; infinity: a hard bound. Null: all hard
  const double* slack_quadratic = nullptr;  // (s) w
  /// The matrices, not the vectors and bounds, are those of the solve before on the same workspace: the dual set's
  /// factor and columns are used again.
  bool repeats = false;
  QpCones cones;  // the interior point alone knows them; kkt_residual does not count them
  std::uint32_t stacked() const { return lq.states * lq.scenarios; }
  bool soft(std::uint32_t i) const;
};

/// The problem from stage k on, and its factor.
LqProblem stages_from(const LqProblem& problem, std::size_t k);
LqFactor stages_from(const LqFactor& factor, const LqProblem& problem, std::size_t k);

/// Primal and dual solution; arrays are the caller's. A bound's multiplier is positive at the high side, negative at
/// the low side. Stationarity: d cost / du + b' pi_{k+1} + input_multiplier = 0, likewise for x.
struct QpSolution {
  double* x = nullptr;                 // (N+1 x s)
  double* u = nullptr;                 // (N x m)
  double* multiplier = nullptr;        // pi (N+1 x s): of the dynamics into row k
  double* input_multiplier = nullptr;  // (N x m)
  double* state_multiplier = nullptr;  // (N+1 x s)
};
QpSolution lay_out_qp_solution(Arena& arena, const LqProblem& sizes);

/// Largest violation of each of the optimality conditions (infinity norm, absolute).
struct KktResidual {
  double stationarity = 0.0;
  double primal = 0.0;           // dynamics, input bounds, hard state bounds
  double dual = 0.0;             // sign of the multipliers; soft bounds: at most l + w e
  double complementarity = 0.0;  // multiplier times distance from its bound
  double worst() const;          // NaN if any is
};
KktResidual kkt_residual(const Qp& qp, const QpSolution& solution);

/// Multipliers of the dynamics, and of inputs without room, from a solution with those of the bounds.
void complete_multipliers(const Qp& qp, QpSolution& solution);

/// Brings the inputs within their bounds, and the states are those that follow.
void follow_inputs(const Qp& qp, QpSolution& solution);

/// Whether the program's inputs u (N x m) with their base are within its cones, to rounding; not for lifted ones.
bool cones_within(const QpCones& cones, const LqProblem& sizes, const double* u);

/// Cost with the soft bounds' penalties, and the largest violation of a soft bound.
double qp_cost(const Qp& qp, const QpSolution& solution);
double worst_violation(const Qp& qp, const QpSolution& solution);

enum class QpStatus {
  solved,      // to the tolerance
  capped,      // iterations or deadline ran out
  infeasible,  // hard bounds that no input keeps (or that no double can tell from it)
  broken       // not convex, or not finite
};

struct QpLimits {
  std::uint32_t iterations = 50;
  double tolerance = 1e-9;  // on every part of the KKT residual
  Deadline deadline;        // read once an iteration; its own count of iterations has no say here
};

struct QpReport {
  QpStatus status = QpStatus::broken;
  std::uint32_t iterations = 0;  // of the solver: sweeps, or ADMM steps
  double residual = 0.0;         // what the solver believes of it
};

}  // namespace tiller
