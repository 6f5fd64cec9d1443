#pragma once

#include "planners/cone_program.hpp"
#include "planners/multiple_shooting.hpp"

namespace tiller {

struct Escape;
struct ScenarioTree;
struct SqpTree;

/// Iterative LQR: see ilqr.cpp. Also the second half of `hybrid`.
struct Ilqr {
  ScenarioTree* tree = nullptr;  // plans in the place of everything below where it is set
  SqpTree* cone_tree = nullptr;  // and where inputs have cones, this around it
  Escape* escape = nullptr;      // of the planner `ilqr`; null in `hybrid`, which has a scout of its own, and in scouts
  PathPlan plan;
  double cost = 0.0;  // of the path under the risk; infinity: not known
  MultipleShooting shooting;
  ConeProgram cones;
  Deadline deadline;      // of the plan under way
  bool single = true;     // single shooting
  bool standing = false;  // the problem is that of the present path
  bool solved = false;    // and the factor is its
  bool converged = false;
  bool settled = false;  // multiple shooting: the sequence to send is not the path's
};

/// Null while the arena measures. For no more than `most_scenarios`.
Ilqr* lay_out_ilqr(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                   bool single, std::uint32_t most_scenarios = TILLER_MAX_SCENARIOS);
void reset_ilqr(Ilqr& s);

/// Takes command, belief and tick of a request; the path is the old plan's, shifted. False without a belief.
bool take_request(Ilqr& s, const PlanRequest& request);

/// The path becomes the motion of the model from the start under its inputs; false, and it stays, where that is not
/// finite.
bool roll_open(Ilqr& s);

/// The same, under the old gains where they have something to hold.
bool roll_again(Ilqr& s);

/// The path becomes the motion under `inputs` (N x nu), and single shooting goes on from it; false where it is not
/// finite. A rollout multiplies by the path's states even where it takes no share of them: those given up go first.
bool restart_path(Ilqr& s, const double* inputs);

/// One iteration of single shooting from a path that is a motion; false where nothing finite came of it.
bool iterate_single(Ilqr& s);

/// One iteration of multiple shooting from any path; false where nothing finite came of it.
bool iterate_multiple(Ilqr& s);
/// The inputs that multiple shooting sends: those of the path from the present start, as they are or under the gains,
/// whichever costs less; which candidate that is. The path itself stays what the next tick begins with.
std::uint32_t settle_multiple(Ilqr& s);
/// settle_multiple; where the motion costs no more than the path, the path becomes it, and single shooting goes on.
void close_path(Ilqr& s);

}  // namespace tiller
