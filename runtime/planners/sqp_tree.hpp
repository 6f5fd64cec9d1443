#pragma once

#include "planners/scenario_tree.hpp"
#include "planners/sqp_chance.hpp"
#include "planners/sqp_program.hpp"

namespace tiller {

/// sqp on a tree of scenarios (scenario_tree.hpp), and ilqr where inputs have cones: bounds on states, on inputs and on
/// their changes, and cones of inputs, hold in the shared periods and in every branch, each with its own margins. One
/// program an iteration (qp/qp_tree.hpp): an active set over the inputs' limits, and where more is in the way, an
/// interior point over all of the tree. Single shooting; what bounds on states are exceeded by counts in the line
/// search with the program's own penalty.
///
/// Weights. The branches enter the trunk under the risk's weights. With bounds on states no weight is below a
/// thousandth of an equal share: the trunk has to leave each hypothesis a way within its bounds, costly or not. The
/// penalty is the same for a state of any branch.
struct SqpTree {
  ScenarioTree* tree = nullptr;
  HardBounds bounds;
  SqpPart* part = nullptr;   // (1 + most) the trunk, then the branches
  double* margin = nullptr;  // (most x N+1 x nx) of chance constraints; null: bounds hold for the means
  SpreadRoom room;
  double weight[TILLER_MAX_SCENARIOS] = {};  // of the branches in the trunk
  double exact_weight = 0.0;                 // of the bounds' penalty, this iteration

  // ---- one plan
  double violation = 0.0;  // of the program's bounds on states
  bool unsolved = false;   // the last program ran into its cap
};

/// Null while the arena measures.
SqpTree* lay_out_sqp_tree(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table);
void reset_sqp_tree(SqpTree& s);
PlanResult plan_sqp_tree(SqpTree& s, const PlanRequest& request, double* command);

}  // namespace tiller
