#pragma once

#include "planners/scout.hpp"

namespace tiller {

/// How `ilqr` and `sqp` leave a local minimum: a scout beside the plan, which begins from the cheapest of some wide
/// samples and is refined over several plans before the two are compared. It searches from a cold start and a new goal
/// on, and where plans make no progress. In every other tick it costs one comparison.
struct Escape {
  Scout scout;
  std::uint64_t seed = 0;
  double best_cost = 0.0;   // of the sample in scout.inputs
  std::uint32_t drawn = 0;  // iterations of samples in the present search

  // ---- progress of the plan
  std::uint64_t goal = 0;  // changes of the goal so far
  bool begun = false;      // a plan was made since the reset
  bool wanted = false;     // a search is due
  std::uint32_t age = 0;   // plans in the present quarter of a horizon
  double least = 0.0;      // cost of the cheapest of them
  double mark = 0.0;       // of the quarter before
  double worst = 0.0;      // the highest such cost since the goal came
};

/// Null while the arena measures.
Escape* lay_out_escape(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);
void reset_escape(Escape& e);

/// Iterations that a plan may have, those of the scout included: `cap` for the plan itself.
struct IterationBudget {
  std::uint32_t cap = 0, total = 0;
  std::uint32_t left(std::uint32_t done) const {
    const std::uint32_t rest = total > done ? total - done : 0;
    return rest < cap ? rest : cap;
  }
};
/// A recording counts both, so that a replay cuts the scout where the recording's clock cut it.
IterationBudget iteration_budget(const Deadline& deadline, const tiller_planner_config_t& settings);

/// After the iterations of a plan that costs `cost`: up to `iterations` of the scout; the number completed. Where
/// e.scout.motion says so, the scout's path is a motion that may be cheaper.
std::uint32_t search_beside(Escape& e, const PathPlan& present, double cost, const PlanRequest& request,
                            std::uint32_t iterations);

/// The scout's inputs become those of the path where the first hypothesis may gain, and the candidate kWarm is their
/// motion under all hypotheses: for the caller to weigh against what it has. Else false. take_back undoes it.
bool try_scout(Escape& e, PathPlan& p);
void take_back(Escape& e, PathPlan& p);
/// Share of its cost that the scout has to save: equal ones take no turns.
bool saves(double cost, double worth);
/// The candidate kWarm becomes the path, without gains; the next search is another.
void follow_scout(Escape& e, PathPlan& p);

}  // namespace tiller
