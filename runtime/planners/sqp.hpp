#pragma once

#include "planners/cone_program.hpp"
#include "planners/multiple_shooting.hpp"
#include "planners/qp/osqp_qp.hpp"
#include "planners/qp/riccati_qp.hpp"

namespace tiller {

/// Sequential quadratic programming on a path: one program an iteration, with the dynamics linearised and the cost to
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

struct Sqp {
  PathPlan plan;
  SqpProgram plain, lifted;
  LiftedArrays lift;
  ActiveSetQp set;            // on the plain program; its factor is the plan's
  InteriorPoint interior;     // on the lifted program where rates are limited, else on the plain one
  OsqpQp osqp;                // likewise
  bool rate_limits = false;   // some input's rate is limited
  bool state_bounds = false;  // hard_bounds names a state with a bound
  double state_low[TILLER_MAX_STATES] = {}, state_high[TILLER_MAX_STATES] = {};
  double exact_weight = 0.0;  // of the bounds' penalty, this iteration
  // chance constraints (sqp_chance.cpp): how much nearer the bounds stand at each state of the path
  double quantile = 0.0;     // of the spread where every state has an equal share of the risk, in deviations
  double* margin = nullptr;  // (N+1 x M x nx); null: bounds hold for the means
  double* spread_work = nullptr;
  MultipleShooting shooting;
  bool multiple = false;  // the next iteration is one of multiple shooting
  bool open = false;      // the path is not a motion; the inputs of one, plan.settled, are sent
  double settled_cost = 0.0, settled_excess = 0.0;  // of that motion: risk, and what it exceeds the bounds by

  // ---- one plan
  double cost = 0.0, merit = 0.0;  // of the path: risk, and with the penalty of the bounds
  double violation = 0.0;          // of the program's bounds on states
  bool unsolved = false;           // the last program ran into its cap
  bool prepared = false;           // linearised around the shifted path, for `prepared_tick`
  std::uint64_t prepared_tick = 0;
  bool converged = false;
};

/// The configured hard bounds in the frame of the path.
void place_hard_bounds(Sqp& s);
/// sqp_chance.cpp: margins from the spread that is predicted along the linearised path under its gains; none without a
/// belief that knows its spread.
void lay_out_margins(Arena& arena, const tiller_config_t& config, Sqp& s);
void predict_margins(Sqp& s);
/// Of state i at row (stage, scenario) of the path.
inline double margin_at(const Sqp& s, std::size_t row, std::size_t i) {
  return s.margin ? s.margin[row * s.plan.nx + i] : 0.0;
}
/// The cones of the inputs before, which are states of the lifted program.
inline QpCones lifted_cones(const PathPlan& p) {
  QpCones cones = path_cones(p);
  cones.of_state = true;
  cones.first = p.nz;
  return cones;
}
/// sqp_program.cpp: around the plan's path, after linearise_path and quadratise_path.
void take_state_bounds(Sqp& s, SqpProgram& program, bool lifted);
void build_lifted(Sqp& s);
void lay_out_programs(Arena& arena, const tiller_config_t& config, const RolloutTable& table, Sqp& s);

/// sqp_solve.cpp: solves the program around the path; leaves step and gains for the line search in the plan's factor.
/// False where there is no solution at all.
bool solve_program(Sqp& s, const Deadline& deadline);
/// The first sweep of the program's active set ahead of its measurement: with the set of the last plan, only vectors
/// are left to do.
void prefactorise(Sqp& s);
/// A rollout multiplies by gains even where it takes no share of them: what is not finite must not stay.
void drop_gains(PathPlan& p);

}  // namespace tiller
