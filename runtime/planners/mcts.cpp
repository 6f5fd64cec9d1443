#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "planners/mcts_tree.hpp"
#include "planners/sampler.hpp"

namespace tiller {
namespace {

// Monte-Carlo tree search over a few values per input, each held for hold_steps periods (mcts_tree.hpp has the rule by
// which it grows). The sampling core rolls out: a lane is one simulation, its path through the tree and then a default
// policy to the end of the horizon. kPolicies lanes belong to a leaf: the old plan's rest, the leaf's last choice held,
// and random ones; the leaf is worth their mean. Every simulation starts at the present state, so that delays, rate
// limits and each of the M hypotheses are what they are for any planner, and nothing is stored of states.
//
// A tree over choices has one cost where the M hypotheses have M: the risk of a whole simulation over the hypotheses.
// It is an open-loop tree: a node is a sequence of choices, not what they lead to under one hypothesis, and its value
// is the mean over default policies of the risk over hypotheses. "worst" then prefers choices whose costliest
// hypothesis is cheap on average over what may follow; the plan is the cheapest simulation itself, under the risk as
// configured.
//
// One choice of the tree sets every input of a knot where levels^inputs choices fit a node. With more inputs they are
// set one after the other, each a level of the tree (factored actions): a node then has `levels` children however many
// inputs there are, and its value is the mean over what the inputs behind it may do.
//
// The plan is not the most visited path but the cheapest simulation, as in single-player games (Schadd et al.,
// "Single-player Monte-Carlo tree search", 2008): the same sequence always costs the same, so the best one seen is no
// lucky draw.

constexpr std::uint32_t kPolicies = 4;
constexpr std::uint32_t kLeavesAtOnce = 64;  // between two looks at the clock: some 10 us
constexpr std::uint32_t kReserved = 2;       // rollout 0 is the old plan, rollout 1 the best so far
constexpr double kFade = 0.5;                // of what the tree knew, every tick: it was about another state

/// Numbers of one simulation, from one Philox draw (xorshift128, Marsaglia 2003).
struct RandomStream {
  std::uint32_t w[4];
  std::uint32_t next() {
    const std::uint32_t t = w[3] ^ (w[3] << 11);
    w[3] = w[2];
    w[2] = w[1];
    w[1] = w[0];
    w[0] = w[0] ^ (w[0] >> 19) ^ t ^ (t >> 8);
    return w[0];
  }
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>((std::uint64_t{next()} * n) >> 32); }
};

/// The planner: a sampling core with a tree beside it.
struct Search {
  Sampler* core = nullptr;
  MctsTree tree;
  std::uint32_t levels = 2, actions = 2;
  std::uint32_t stages = 1;  // choices of the tree per knot: 1, or one for each input
  std::uint32_t leaf_count = 0;
  std::uint32_t* leaves = nullptr;  // (K / kPolicies) of the batch under way
  std::uint32_t* plan = nullptr;    // (knots x stages) the old plan's choices
  std::uint32_t* choice = nullptr;  // (knots x stages) of one simulation
  std::uint8_t* chosen = nullptr;   // (K x knots x stages) of all
  float* value = nullptr;           // (inputs x actions)

  std::uint32_t choices() const { return core->grid.knots * stages; }
  MctsTree::Range range;
  double cost_sum = 0.0;  // of this plan's simulations
  double cost_count = 0.0;
  double last_cost = 0.0;  // of the last plan
  bool has_cost = false;
};

Search& search_of(const Sampler& s) { return *static_cast<Search*>(s.companion); }

/// The value that `action` gives to `input`.
double value_of(const Search& t, std::uint32_t action, std::uint32_t input) {
  if (t.stages == 1)
    for (std::uint32_t i = 0; i < input; ++i) action /= t.levels;
  const InputLimit& limit = t.core->limits[input];
  const double share = static_cast<double>(action % t.levels) / (t.levels - 1);
  return (1.0 - share) * limit.low + share * limit.high;
}

std::uint32_t level_near(const Search& t, std::uint32_t input, double value) {
  const InputLimit& limit = t.core->limits[input];
  const double width = limit.high - limit.low;
  const double share = width > 0.0 ? (value - limit.low) / width : 0.0;
  return static_cast<std::uint32_t>(std::nearbyint(std::fmin(std::fmax(share, 0.0), 1.0) * (t.levels - 1)));
}

/// The action of `stage` nearest to knot `j` of the plan.
std::uint32_t action_near(const Search& t, const double* rows, std::uint32_t stride, std::uint32_t j,
                          std::uint32_t stage) {
  if (t.stages > 1) return level_near(t, stage, rows[stage * stride + j]);
  std::uint32_t action = 0, place = 1;
  for (std::uint32_t i = 0; i < t.core->inputs; ++i, place *= t.levels)
    action += place * level_near(t, i, rows[i * stride + j]);
  return action;
}

/// Knots that begin within the horizon.
std::uint32_t knots_within(const Sampler& s) { return (s.clock.horizon + s.clock.phase + s.clock.hold - 1) / s.clock.hold; }

void begin(Sampler& s) {
  Search& t = search_of(s);
  if (s.gone == 1)
    for (std::uint32_t stage = 0; stage < t.stages; ++stage)
      t.tree.descend(action_near(t, s.knot_before, 1, 0, stage));
  else if (s.gone > 1)
    t.tree.clear(t.actions);
  s.gone = 0;
  t.tree.fade(kFade);
  t.cost_sum = t.cost_count = 0.0;
}

/// One leaf's simulations: its path, and what follows by each default policy.
void choose_for_leaf(Search& t, std::uint32_t leaf, std::uint32_t first_lane, RandomStream& random) {
  const std::uint32_t depth = t.tree.path(leaf, t.choice);
  for (std::uint32_t policy = 0; policy < kPolicies; ++policy) {
    for (std::uint32_t j = depth; j < t.choices(); ++j) {
      const std::uint32_t before = j >= t.stages ? t.choice[j - t.stages] : t.plan[j];
      if (policy == 0)
        t.choice[j] = t.plan[j];
      else if (policy == 1 || (random.next() & 1u))
        t.choice[j] = before;
      else
        t.choice[j] = random.below(t.actions);
    }
    std::copy(t.choice, t.choice + t.choices(), t.chosen + std::size_t{first_lane + policy} * t.choices());
  }
}

bool draw(Sampler& s) {
  Search& t = search_of(s);
  for (std::uint32_t c = 0; c < t.choices(); ++c)
    t.plan[c] = action_near(t, s.mean, s.grid.knots, c / t.stages, c % t.stages);
  const std::uint32_t depth = knots_within(s) * t.stages;
  for (t.leaf_count = 0; t.leaf_count < s.rollouts / kPolicies; ++t.leaf_count) {
    if (t.leaf_count % kLeavesAtOnce == kLeavesAtOnce - 1 && s.request->deadline.passed()) return false;
    const std::uint64_t high = (std::uint64_t{kRngPlanner} << 32) | (s.iteration << 16) | t.leaf_count;
    const Philox::Words words = Philox::draw(s.seed, s.request->tick, high);
    RandomStream random = {{words.w[0] | 1u, words.w[1], words.w[2], words.w[3]}};
    const std::uint32_t leaf = t.tree.select(depth, t.plan, random.next(), t.range, s.settings->exploration);
    t.leaves[t.leaf_count] = leaf;
    choose_for_leaf(t, leaf, t.leaf_count * kPolicies, random);
  }
  // row by row: a lane's knots stand too far apart for the cache
  float* row = s.knots;
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    const float* value = t.value + std::size_t{i} * t.actions;
    const std::uint32_t stage = t.stages > 1 ? i : 0, stride = t.choices();
    for (std::uint32_t j = 0; j < s.grid.knots; ++j, row += s.rollouts)
      for (std::uint32_t lane = 0; lane < s.rollouts; ++lane)
        row[lane] = value[t.chosen[std::size_t{lane} * stride + j * t.stages + stage]];
  }
  return true;
}

void cancel(Sampler& s) {
  Search& t = search_of(s);
  t.tree.cancel(t.leaves, t.leaf_count);
}

/// A simulation without a finite cost counts as the costliest that has one.
double simulated_cost(const Sampler& s, std::uint32_t lane) {
  const float cost = s.cost[lane];
  return static_cast<double>(cost <= s.range.high ? cost : s.range.high);
}

void update(Sampler& s) {
  Search& t = search_of(s);
  // the old plan was simulated again: what it costs now and did not before, the tree's means have missed
  if (s.iteration == 0 && t.has_cost && s.warm_cost <= static_cast<double>(s.range.high))
    t.tree.offset(s.warm_cost - t.last_cost);
  for (std::uint32_t l = 0; l < t.leaf_count; ++l) {
    const std::uint32_t first = l > 0 ? 0 : kReserved;
    double sum = 0.0;
    for (std::uint32_t p = first; p < kPolicies; ++p) sum += simulated_cost(s, l * kPolicies + p);
    t.tree.back_up(t.leaves[l], sum / (kPolicies - first));
    t.cost_sum += sum;
    t.cost_count += kPolicies - first;
  }
  t.tree.commit();
  // between the cheapest and the mean: the costliest says how badly one can do, and drowns the differences that matter
  t.range = {s.best_cost, t.cost_sum / t.cost_count};
  for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] = s.best[r];
}

double choose(Sampler& s) {
  Search& t = search_of(s);
  // what begins beyond the horizon was not simulated: the last choice within it holds
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    double* row = s.mean + i * s.grid.knots;
    for (std::uint32_t j = knots_within(s); j < s.grid.knots; ++j) row[j] = row[j - 1];
  }
  t.last_cost = s.best_cost;
  t.has_cost = true;
  return s.best_cost;
}

void rebase(Sampler& s, double change) {
  Search& t = search_of(s);
  t.tree.offset(change);
  t.cost_sum += change * t.cost_count;
}

constexpr SamplingMethod kMethod = {"mcts", begin, update, choose, draw, cancel, true, rebase};

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t* hooks) {
  auto* t = arena.take<Search>(1);
  Search nobody;
  Search& place = t ? *t : nobody;
  const tiller_planner_config_t& p = config.planner;
  const std::uint32_t hold = std::max(std::uint32_t{1}, p.hold_steps), knots = held_knots(p.horizon, hold);
  place.levels = std::max(std::uint32_t{2}, p.levels);
  const std::uint32_t inputs = config.model->input_count, joint = tree_actions(place.levels, inputs);
  place.stages = joint > 0 ? 1 : inputs;
  place.actions = joint > 0 ? joint : place.levels;
  const std::uint32_t choices = knots * place.stages;
  place.tree.lay_out(arena, std::max(std::uint32_t{16}, p.nodes));
  place.leaves = arena.take<std::uint32_t>(p.rollouts / kPolicies);
  place.plan = arena.take<std::uint32_t>(choices);
  place.choice = arena.take<std::uint32_t>(choices);
  place.chosen = arena.take<std::uint8_t>(std::size_t{p.rollouts} * choices);
  place.value = arena.take<float>(std::size_t{inputs} * place.actions);
  Sampler* core = lay_out_sampler(arena, config, setup, table, hooks, kMethod);
  if (!core) return nullptr;
  place.core = core;
  core->companion = t;
  for (std::uint32_t i = 0; i < core->inputs; ++i)
    for (std::uint32_t a = 0; a < place.actions; ++a)
      place.value[i * place.actions + a] = lane_number(value_of(place, a, i));
  place.tree.clear(place.actions);
  return t;
}

PlanResult plan(void* self, const PlanRequest& request, double* command) {
  return plan_by_sampling(static_cast<Search*>(self)->core, request, command);
}

void reset(void* self) {
  Search& t = *static_cast<Search*>(self);
  reset_sampler(t.core);
  t.tree.clear(t.actions);
  t.range = {};
  t.has_cost = false;
}

const float* sequence(const void* self) { return sampled_sequence(static_cast<const Search*>(self)->core); }

}  // namespace

extern const PlannerTable mcts_planner;
const PlannerTable mcts_planner = {kMethod.name, lay_out, plan, reset, sequence};

}  // namespace tiller
