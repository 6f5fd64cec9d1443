#pragma once

#include <cstdint>

#include "planners/mcts_outcomes.hpp"
#include "planners/mcts_tree.hpp"
#include "planners/sampler.hpp"

namespace tiller {

constexpr std::uint32_t kPolicies = 4;  // default policies that simulate a leaf: a set of lanes
constexpr std::uint32_t kReserved = 2;  // rollout 0 is the old plan, rollout 1 the best so far

/// The planner `mcts`: a sampling core with a tree beside it. A set is kPolicies rollouts that share a walk through the
/// tree. Where outcomes are seen the walk forks, and hypotheses in different outcomes have different choices; a member
/// is one way through, from the root to a leaf.
struct Search {
  Sampler* core = nullptr;
  MctsTree tree;
  std::uint32_t levels = 2, actions = 2;
  std::uint32_t stages = 1;  // choices of the tree per knot: 1, or one for each input
  std::uint32_t most_members = 1, most_ends = 1;
  std::uint32_t set_count = 0;          // of the batch under way
  std::uint32_t* ends = nullptr;        // (K / kPolicies x most_ends) where the walks of a set end
  std::uint32_t* end_count = nullptr;   // (K / kPolicies)
  std::uint32_t* leaves = nullptr;      // (K / kPolicies x most_members) those of the ends that are leaves
  std::uint32_t* leaf_count = nullptr;  // (K / kPolicies)
  std::uint32_t* deepest = nullptr;     // (K / kPolicies) knot that begins behind the deepest of the leaves
  std::uint32_t* plan = nullptr;        // (choices) the old plan's
  std::uint32_t* choice = nullptr;      // (choices) of one simulation
  std::uint8_t* chosen = nullptr;       // (K x most_members x choices) of all
  float* value = nullptr;               // (inputs x actions)

  MctsTree::Range range;
  double cost_sum = 0.0;  // of this plan's simulations
  double cost_count = 0.0;
  double last_cost = 0.0;  // of the last plan's sequence
  bool has_cost = false;

  // ---- where hypotheses can be told apart; else null
  Outcomes outcomes;
  SubsetRisk risk;
  std::uint8_t* member = nullptr;    // (K / kPolicies x M) of each hypothesis
  std::uint32_t* way = nullptr;      // (choices + M) scratch: nodes of one walk
  std::uint8_t* sequence = nullptr;  // (choices) scratch
  std::uint8_t* variants = nullptr;  // (M x choices) the plan's sequences, one an outcome; the first is that of `plan`
  std::uint32_t variant_count = 1;
  float* penalty_before = nullptr;  // (M) least penalties of the iteration before
  double plan_cost = 0.0;           // of the plan with its outcomes
  bool plan_branches = false;

  std::uint32_t choices() const { return core->grid.knots * stages; }
  bool branches() const { return member != nullptr; }
  const std::uint8_t* chosen_by(std::uint32_t lane, std::uint32_t which) const {
    return chosen + (std::size_t{lane} * most_members + which) * choices();
  }
  std::uint8_t* chosen_by(std::uint32_t lane, std::uint32_t which) {
    return chosen + (std::size_t{lane} * most_members + which) * choices();
  }
  /// Whether hypotheses of the set have different choices.
  bool forks(std::uint32_t set) const { return end_count[set] > 1; }
  /// The first lanes of a set may be no simulations of its leaves: sequences of the old plan, given to all hypotheses.
  std::uint32_t reserved(std::uint32_t set) const {
    return set == 0 ? kReserved : core->iteration == 0 && set < variant_count ? 1 : 0;
  }
};

inline Search& search_of(const Sampler& s) { return *static_cast<Search*>(s.companion); }

/// Knots that begin within the horizon.
inline std::uint32_t knots_within(const Sampler& s) {
  return (s.clock.horizon + s.clock.phase + s.clock.hold - 1) / s.clock.hold;
}

// ---- branching on outcomes (mcts_branches.cpp) --------------------------------------------------

void lay_out_branches(Arena& arena, const tiller_config_t& config, std::uint32_t knots, std::uint32_t choices,
                      Search& t);
/// Moves the plan's sequences up by the knots that fell off.
void shift_variants(Search& t, std::uint32_t gone);
bool aim_particle(Sampler& s, std::uint32_t slot, std::uint32_t chunk, std::uint32_t m);
void observe_particle(Sampler& s, std::uint32_t slot, std::uint32_t chunk, std::uint32_t m);
/// Gives outcomes to the nodes that the batch has passed.
void tell_apart(Search& t);
/// Mean cost of a walk of the set, over its lanes and under the risk over the hypotheses that took part.
double walk_cost(const Search& t, std::uint32_t set, std::uint32_t end);
/// Offers the batch's sequences to all outcomes that they pass.
void credit_outcomes(Search& t);
/// Takes the plan, the cheapest sequence for each outcome; the mean is then that of the likeliest one. False, and no
/// more than the plan's cost is taken, if one sequence for all hypotheses is the cheapest.
bool take_plan(Search& t);
/// Costs are from now on `change` more than they were.
void rebase_branches(Search& t, double change);

}  // namespace tiller
