// What `mcts` does beside a plain tree search where hypotheses can be told apart: simulations whose hypotheses go
// different ways, outcomes from the readings that they predict, and a plan with a sequence for each outcome.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "planners/mcts_search.hpp"

namespace tiller {

void lay_out_branches(Arena& arena, const tiller_config_t& config, std::uint32_t knots, std::uint32_t choices,
                      Search& t) {
  if (!Outcomes::are_seen(config)) return;
  const std::uint32_t sets = config.planner.rollouts / kPolicies, particles = config.planner.particles;
  t.risk = SubsetRisk(config.planner);
  t.outcomes.lay_out(arena, config, sets, knots);
  t.member = arena.take<std::uint8_t>(std::size_t{sets} * particles);
  t.way = arena.take<std::uint32_t>(choices + particles + 1);
  t.sequence = arena.take<std::uint8_t>(choices);
  t.variants = arena.take<std::uint8_t>(std::size_t{particles} * choices);
  t.penalty_before = arena.take<float>(particles);
}

void shift_variants(Search& t, std::uint32_t gone) {
  const std::uint32_t choices = t.choices(), stages = t.stages;
  for (std::uint32_t v = 0; v < t.variant_count && t.branches(); ++v) {
    std::uint8_t* row = t.variants + std::size_t{v} * choices;
    for (std::uint32_t c = 0; c < choices; ++c)
      row[c] = row[std::min(c + gone * stages, choices - stages + c % stages)];
  }
}

// ---- while a batch is rolled out: any thread, each its own chunks -------------------------------

bool aim_particle(Sampler& s, std::uint32_t slot, std::uint32_t chunk, std::uint32_t m) {
  const Search& t = search_of(s);
  const std::uint32_t first = first_of_chunk(s, chunk), lanes = lanes_of_chunk(s, chunk);
  const std::uint32_t begin = first / kPolicies, end = (first + lanes) / kPolicies;
  if (std::none_of(t.end_count + begin, t.end_count + end, [](std::uint32_t n) { return n > 1; })) return false;
  float* row = own_knots_of(s, slot);
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    const float* value = t.value + std::size_t{i} * t.actions;
    const std::uint32_t stage = t.stages > 1 ? i : 0;
    for (std::uint32_t j = 0; j < s.grid.knots; ++j, row += lanes)
      for (std::uint32_t l = 0; l < lanes; ++l) {
        const std::uint32_t lane = first + l;
        const std::uint32_t member = t.member[std::size_t{lane / kPolicies} * s.most_particles + m];
        row[l] = lane < kReserved ? s.knots[(i * s.grid.knots + j) * s.rollouts + lane]
                                  : value[t.chosen_by(lane, member)[j * t.stages + stage]];
      }
  }
  return true;
}

void observe_particle(Sampler& s, std::uint32_t slot, std::uint32_t chunk, std::uint32_t m) {
  Search& t = search_of(s);
  const std::uint32_t first = first_of_chunk(s, chunk), lanes = lanes_of_chunk(s, chunk);
  const float* trajectory = trajectory_of(s, slot);
  const std::uint32_t last = knots_within(s) - 1;
  for (std::uint32_t set = first / kPolicies; set < (first + lanes) / kPolicies; ++set) {
    const std::uint32_t lane = set * kPolicies + t.reserved(set) - first;
    for (std::uint32_t k = 1; k <= std::min(t.deepest[set], last); ++k)
      t.outcomes.record(set, k, m, trajectory + std::size_t{s.grid.first_step[k]} * s.states * lanes + lane, lanes);
  }
}

// ---- after it -----------------------------------------------------------------------------------

namespace {

/// Nodes from the root, or from the outcome where the walk began, down to `end`, into t.way; their number.
std::uint32_t nodes_of_walk(Search& t, std::uint32_t end) {
  std::uint32_t count = 0;
  for (std::uint32_t n = end; n != MctsTree::kNone; n = t.tree.is_outcome(n) ? MctsTree::kNone : t.tree.parent(n))
    t.way[count++] = n;
  std::reverse(t.way, t.way + count);
  return count;
}

/// The knot that begins where the node's last choice ends; 0 where there is none to branch at.
std::uint32_t knot_behind(const Search& t, std::uint32_t node) {
  const std::uint32_t level = t.tree.level(node);
  if (level % t.stages != 0 || level / t.stages >= knots_within(*t.core)) return 0;
  return level / t.stages;
}

void tell_walk(Search& t, std::uint32_t set, std::uint32_t end) {
  const Sampler& s = *t.core;
  const std::uint32_t count = nodes_of_walk(t, end);
  for (std::uint32_t i = 0; i < count && !t.tree.splits(t.way[i]); ++i) {
    const std::uint32_t node = t.way[i], knot = knot_behind(t, node);
    if (knot == 0 || t.tree.is_told(node)) continue;
    std::uint64_t groups[kMostHypotheses];
    const double ahead_s = s.grid.first_step[knot] * s.setup->period_s;
    const std::uint32_t found = t.outcomes.partition(set, knot, ahead_s, t.tree.hypotheses(node), groups);
    t.tree.tell(node, groups, found);
  }
}

void costs_of(const Sampler& s, std::uint32_t lane, double* cost) {
  for (std::uint32_t m = 0; m < s.particles; ++m) cost[m] = static_cast<double>(particle_cost(s, lane, m));
}

double subset_cost(const Search& t, std::uint32_t lane, std::uint64_t hypotheses) {
  double cost[kMostHypotheses], weight[kMostHypotheses];
  std::uint32_t n = 0;
  for (std::uint64_t left = hypotheses; left != 0; left &= left - 1, ++n) {
    cost[n] = static_cast<double>(particle_cost(*t.core, lane, static_cast<std::uint32_t>(__builtin_ctzll(left))));
    weight[n] = t.tree.weight_of(left & (~left + 1));
  }
  return t.risk.value(cost, weight, n);
}

/// The outcome in which a walk began; the root.
std::uint32_t begin_of_walk(const Search& t, std::uint32_t end) {
  while (end != MctsTree::kRoot && !t.tree.is_outcome(end)) end = t.tree.parent(end);
  return end;
}

/// Whether the old plan, rollout 0, is a sequence of choices.
bool plan_is_on_levels(const Search& t) {
  const Sampler& s = *t.core;
  for (std::uint32_t r = 0; r < s.rows; ++r) {
    const std::uint32_t i = r / s.grid.knots, j = r % s.grid.knots;
    const std::uint32_t choice = t.plan[j * t.stages + (t.stages > 1 ? i : 0)];
    if (t.value[std::size_t{i} * t.actions + choice] != s.row_mean[r]) return false;
  }
  return true;
}

/// The lanes of a set that play one sequence to all hypotheses, whatever its walk.
void credit_reserved(Search& t, std::uint32_t set) {
  double cost[kMostHypotheses];
  if (set == 0) {
    if (!plan_is_on_levels(t)) return;
    costs_of(*t.core, 0, cost);
    std::copy(t.plan, t.plan + t.choices(), t.sequence);
    t.tree.credit(MctsTree::kRoot, t.sequence, cost, t.risk);
  } else if (t.reserved(set) > 0) {
    costs_of(*t.core, set * kPolicies, cost);
    t.tree.credit(MctsTree::kRoot, t.chosen_by(set * kPolicies, 0), cost, t.risk);
  }
}

void credit_set(Search& t, std::uint32_t set) {
  credit_reserved(t, set);
  for (std::uint32_t policy = t.reserved(set); policy < kPolicies; ++policy) {
    const std::uint32_t lane = set * kPolicies + policy;
    double cost[kMostHypotheses];
    costs_of(*t.core, lane, cost);
    for (std::uint32_t i = 0; i < t.leaf_count[set]; ++i) {
      const std::uint32_t leaf = t.leaves[std::size_t{set} * t.most_members + i];
      t.tree.credit(begin_of_walk(t, leaf), t.chosen_by(lane, i), cost, t.risk);
    }
  }
}

/// The sequences of all outcomes, each once, that of the likeliest one first.
void take_variants(Search& t) {
  const std::size_t choices = t.choices();
  const std::uint32_t most = std::min(t.core->particles, t.set_count / 2);
  std::copy_n(t.tree.best_sequence(t.tree.likeliest()), choices, t.variants);
  t.variant_count = 1;
  for (std::uint32_t m = 0; m < t.core->particles && t.variant_count < most; ++m) {
    const std::uint8_t* sequence = t.tree.best_sequence(m);
    bool known = false;
    for (std::uint32_t v = 0; v < t.variant_count; ++v)
      known = known || std::memcmp(t.variants + v * choices, sequence, choices) == 0;
    if (!known) std::copy_n(sequence, choices, t.variants + choices * t.variant_count++);
  }
}

}  // namespace

void tell_apart(Search& t) {
  for (std::uint32_t set = 0; set < t.set_count; ++set)
    for (std::uint32_t i = 0; i < t.leaf_count[set]; ++i)
      tell_walk(t, set, t.leaves[std::size_t{set} * t.most_members + i]);
}

double walk_cost(const Search& t, std::uint32_t set, std::uint32_t end) {
  const double highest = static_cast<double>(t.core->range.high);
  double sum = 0.0;
  for (std::uint32_t policy = t.reserved(set); policy < kPolicies; ++policy)
    sum += std::fmin(subset_cost(t, set * kPolicies + policy, t.tree.hypotheses(end)), highest);
  return sum / (kPolicies - t.reserved(set));
}

void credit_outcomes(Search& t) {
  if (!t.tree.has_outcomes()) return;
  for (std::uint32_t set = 0; set < t.set_count; ++set) credit_set(t, set);
}

bool take_plan(Search& t) {
  Sampler& s = *t.core;
  if (s.penalised) std::copy_n(s.least_penalty, s.particles, t.penalty_before);
  t.plan_cost = s.best_cost;
  t.variant_count = 1;
  if (!t.tree.has_outcomes()) return false;
  t.plan_cost = t.tree.evaluate(s.best_cost, t.risk);
  if (!t.tree.best_sequence(0)) return false;
  take_variants(t);
  for (std::uint32_t r = 0; r < s.rows; ++r) {
    const std::uint32_t i = r / s.grid.knots, j = r % s.grid.knots;
    const std::uint32_t choice = t.variants[j * t.stages + (t.stages > 1 ? i : 0)];
    s.mean[r] = static_cast<double>(t.value[std::size_t{i} * t.actions + choice]);
  }
  return true;
}

void rebase_branches(Search& t, double change) {
  const Sampler& s = *t.core;
  if (!t.branches() || !t.tree.has_outcomes()) return t.tree.offset(change);
  double each[kMostHypotheses];
  for (std::uint32_t m = 0; m < s.particles; ++m)
    each[m] = s.settings->risk == tiller_risk_mean
                  ? static_cast<double>(t.penalty_before[m]) - static_cast<double>(s.least_penalty[m])
                  : change;
  t.tree.offset_each(each);
}

}  // namespace tiller
