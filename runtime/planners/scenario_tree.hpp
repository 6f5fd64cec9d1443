#pragma once

#include "planners/path_plan.hpp"

namespace tiller {

struct ScenarioTree;

/// What a planner puts in the place of the tree's own solver, an active set over the inputs' limits.
struct TreeSolver {
  void* self = nullptr;  // null: none
  /// Solves the problem around the paths, and leaves steps and gains in the factors of branches and trunk. False where
  /// there is no solution.
  bool (*solve)(void* self, ScenarioTree& tree, const Deadline& deadline) = nullptr;
  /// What branch j's candidate `c` is to be charged beside its cost, in the unit of the tree's.
  double (*penalty)(const void* self, const ScenarioTree& tree, std::uint32_t j, std::uint32_t c) = nullptr;
  /// The paths' frame has moved.
  void (*move_frame)(void* self, const ScenarioTree& tree) = nullptr;
};

/// iLQR on a tree of scenarios: the inputs of the first `shared` periods are one sequence for all hypotheses (nothing
/// has been seen yet that tells them apart), each hypothesis then has inputs of its own (after that it is known; the
/// multi-stage MPC of Lucia, Finkler and Engell, J. Process Control 2013, with one branching). Single shooting.
///
/// Behind the shared periods the linear-quadratic problem falls apart: a sweep is M sweeps of one scenario each, whose
/// costs to go, under the risk's weights, end the one of M stacked scenarios over the shared periods. A stage behind
/// them updates M blocks of the value function in the place of M (M + 1) / 2.
struct ScenarioTree {
  PathPlan* branch = nullptr;  // (most) of one scenario each, over the whole horizon
  std::uint32_t most = 0;      // hypotheses that there is room for
  std::uint32_t count = 0;     // M of the last belief
  std::uint32_t shared = 0;    // r

  // ---- the linear-quadratic problem of the shared periods
  LqProblem trunk;
  LqFactor trunk_factor;  // held: the first rows of the first branch's
  const LqKernel* lq = nullptr;
  double *a = nullptr, *b = nullptr, *qxx = nullptr, *qux = nullptr, *quu = nullptr, *qx = nullptr, *qu = nullptr;
  double* x = nullptr;          // (r+1 x M x n)
  double* u = nullptr;          // (r x nu)
  double* own = nullptr;        // (N x nu) scratch
  float* hypothesis = nullptr;  // (np + nx + ns) one of the belief
  ScenarioRisk risk;
  TreeSolver solver;

  // ---- one plan
  double cost = 0.0;      // of the paths under the risk
  bool standing = false;  // the problem is that of the present paths
  bool converged = false;
  bool has_gain = false;
};

/// Whether the configuration asks for a tree: closed_loop, several hypotheses, and a horizon beyond the shared periods.
bool wants_tree(const tiller_config_t& config);
/// A branch's problem behind the shared periods, and its factor there.
LqProblem problem_behind(const ScenarioTree& t, std::uint32_t branch);
LqFactor factor_behind(const ScenarioTree& t, std::uint32_t branch);
/// The shared periods of all branches, stacked, under these weights (count); not the row that the branches begin with.
void stack_trunk(ScenarioTree& t, const double* weight);
/// One regularisation for the whole tree, raised to the largest that a branch asks for.
void raise_regularisation(ScenarioTree& t);

/// Null while the arena measures.
ScenarioTree* lay_out_tree(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                           const RolloutTable& table);
void reset_tree(ScenarioTree& t);
PlanResult plan_tree(ScenarioTree& t, const PlanRequest& request, double* command);
const float* tree_sequence(const ScenarioTree& t);
/// Mean over the branches under the risk's weights behind the shared periods.
bool tree_feedback(const ScenarioTree& t, std::uint32_t step, double* gain, double* state, double* input);

}  // namespace tiller
