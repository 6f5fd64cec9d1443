#pragma once

#include "planners/cone_program.hpp"
#include "planners/multiple_shooting.hpp"
#include "planners/qp/osqp_qp.hpp"
#include "planners/sqp_chance.hpp"
#include "planners/sqp_program.hpp"

namespace tiller {

struct Escape;
struct SqpTree;

/// Sequential quadratic programming on a path (sqp.cpp).
struct Sqp {
  SqpTree* tree = nullptr;  // plans in the place of everything below where it is set
  Escape* escape = nullptr;
  PathPlan plan;
  HardBounds bounds;
  SqpPart part;               // of all of the path; the active set's factor is the plan's
  OsqpQp osqp;                // in the interior point's place
  double exact_weight = 0.0;  // of the bounds' penalty, this iteration
  double* margin = nullptr;   // (N+1 x M x nx) of chance constraints; null: bounds hold for the means
  SpreadRoom room;
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

/// sqp_solve.cpp
void lay_out_programs(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                      Sqp& s);
/// Solves the program around the path; leaves step and gains for the line search in the plan's factor.
/// False where there is no solution at all.
bool solve_program(Sqp& s, const Deadline& deadline);
/// The first sweep of the program's active set ahead of its measurement: with the set of the last plan, only vectors
/// are left to do.
void prefactorise(Sqp& s);

}  // namespace tiller
