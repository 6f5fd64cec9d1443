#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "planners/mcts_search.hpp"

namespace tiller {
namespace {

// Monte-Carlo tree search over a few values per input, each held for hold_steps periods (mcts_tree.hpp has the rule by
// which it grows). The sampling core rolls out: a lane is one simulation, its path through the tree and then a default
// policy to the end of the horizon. kPolicies lanes belong to a leaf: the old plan's rest, the leaf's last choice held,
// and the old plan's rest with a few changes; the leaf is worth their mean. Random choices in the place of changes fell
// an unstable robot in every simulation, and so told nothing. Every simulation starts at the present state, so that
// delays, rate limits and each of the M hypotheses are what they are for any planner, and nothing is stored of states.
//
// A node has one cost where its hypotheses have one each: the risk of a whole simulation over the hypotheses, and the
// mean of that over default policies. Hypotheses that the sensors will tell apart after a choice have different nodes
// from there on, and so different choices (mcts_branches.cpp); those that are not told apart share every choice. With
// one hypothesis, or nothing measured, a node is a sequence of choices and nothing else.
//
// One choice of the tree sets every input of a knot where levels^inputs choices fit a node. With more inputs they are
// set one after the other, each a level of the tree (factored actions): a node then has `levels` children however many
// inputs there are, and its value is the mean over what the inputs behind it may do.
//
// The plan is not the most visited path but the cheapest simulation, as in single-player games (Schadd et al.,
// "Single-player Monte-Carlo tree search", 2008): the same sequence always costs the same, so the best one seen is no
// lucky draw. Where hypotheses are told apart it is the cheapest sequence for each outcome.

constexpr std::uint32_t kLeavesAtOnce = 64;                // between two looks at the clock: some 10 us
constexpr std::uint32_t kMostMoves = 3, kLongestMove = 5;  // of a changed plan; in knots
constexpr std::uint32_t kPieces = 5;                       // of a random sequence
constexpr double kFade = 0.5;  // of what the tree knew, every tick: it was about another state

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

void begin(Sampler& s) {
  Search& t = search_of(s);
  double weight[kMostHypotheses];
  fill_relative_weights(*s.request->belief, s.particles, weight);
  t.tree.begin_belief(s.particles, s.weighted ? weight : nullptr);
  shift_variants(t, s.gone);
  if (s.gone == 1)
    for (std::uint32_t stage = 0; stage < t.stages; ++stage) t.tree.descend(action_near(t, s.knot_before, 1, 0, stage));
  else if (s.gone > 1)
    t.tree.clear(t.actions);
  s.gone = 0;
  t.tree.fade(kFade);
  t.cost_sum = t.cost_count = 0.0;
}

/// Moves one input of choice `c` a level up or down, if there is one.
void move_level(Search& t, std::uint32_t c, std::uint32_t place, bool up) {
  const std::uint32_t level = t.choice[c] / place % t.levels;
  if (up && level + 1 < t.levels) t.choice[c] += place;
  if (!up && level > 0) t.choice[c] -= place;
}

/// One change of the choices from `depth` on, one input a level up or down: for up to kLongestMove knots on end, or at
/// two knots in opposite directions, so that hardly more than the time between them counts.
void move_choices(Search& t, std::uint32_t depth, RandomStream& random) {
  const std::uint32_t at = depth + random.below(t.choices() - depth), length = 1 + random.below(kLongestMove);
  std::uint32_t place = 1;
  for (std::uint32_t i = t.stages > 1 ? 0 : random.below(t.core->inputs); i > 0; --i) place *= t.levels;
  const std::uint32_t word = random.next();
  const bool up = word & 1u, opposed = word & 2u;
  const std::uint32_t step = opposed ? length * t.stages : t.stages, last = at + length * t.stages;
  for (std::uint32_t c = at; c < t.choices() && (c < last || (opposed && c == last)); c += step)
    move_level(t, c, place, up != (opposed && c == last));
}

/// Choices at random, some kPieces of them over the horizon.
void choose_at_random(Search& t, RandomStream& random) {
  for (std::uint32_t j = 0; j < t.choices(); ++j) {
    const bool held = j >= t.stages && random.below(t.core->grid.knots) >= kPieces;
    t.choice[j] = held ? t.choice[j - t.stages] : random.below(t.actions);
  }
}

/// Whether this iteration looks for a first plan: a quarter of them do, for there is none whose rest could say what a
/// choice is worth. Of one input alone: random sequences of several are no good beginning.
bool explores(const Sampler& s) { return s.cold && s.inputs == 1 && 4 * (s.iteration + 1) <= s.settings->iterations; }

/// How the lane's simulation goes on from choice `from`.
void follow_policy(Search& t, std::uint32_t policy, std::uint32_t from, std::uint32_t variant, RandomStream& random) {
  for (std::uint32_t j = from; j < t.choices(); ++j) {
    if (policy == 1)
      t.choice[j] = j >= t.stages ? t.choice[j - t.stages] : t.plan[j];
    else
      t.choice[j] = variant == 0 ? t.plan[j] : t.variants[std::size_t{variant} * t.choices() + j];
  }
  if (policy < 2 || from == t.choices()) return;
  for (std::uint32_t moves = 1 + random.below(kMostMoves); moves > 0; --moves) move_choices(t, from, random);
}

/// One leaf's simulations: its path, and what follows by each default policy.
void choose_for_leaf(Search& t, std::uint32_t set, std::uint32_t member, RandomStream& random) {
  const std::uint32_t leaf = t.leaves[std::size_t{set} * t.most_members + member];
  std::uint32_t depth = t.tree.path(leaf, t.choice);
  for (std::uint32_t policy = 0; policy < kPolicies; ++policy) {
    const bool reserved = set > 0 && policy < t.reserved(set);
    if (explores(*t.core) && !reserved)
      choose_at_random(t, random);
    else
      follow_policy(t, policy, reserved ? 0 : depth, set % t.variant_count, random);
    std::copy(t.choice, t.choice + t.choices(), t.chosen_by(set * kPolicies + policy, member));
    if (reserved) depth = t.tree.path(leaf, t.choice);
  }
}

/// The ends of the set's walks that are leaves, and which of them each hypothesis comes to.
void find_leaves(Search& t, std::uint32_t set) {
  const std::uint32_t* ends = t.ends + std::size_t{set} * t.most_ends;
  std::uint32_t* leaves = t.leaves + std::size_t{set} * t.most_members;
  std::uint32_t count = 0, level = 0;
  for (std::uint32_t e = 0; e < t.end_count[set]; ++e) {
    if (t.tree.splits(ends[e])) continue;
    level = std::max(level, t.tree.level(ends[e]));
    for (std::uint32_t m = 0; m < t.core->particles && t.branches(); ++m)
      if ((t.tree.hypotheses(ends[e]) >> m) & 1u)
        t.member[std::size_t{set} * t.core->most_particles + m] = static_cast<std::uint8_t>(count);
    leaves[count++] = ends[e];
  }
  t.leaf_count[set] = count;
  t.deepest[set] = level / t.stages;
}

void draw_set(Sampler& s, std::uint32_t set, std::uint32_t depth) {
  Search& t = search_of(s);
  const std::uint64_t high = (std::uint64_t{kRngPlanner} << 32) | (s.iteration << 16) | set;
  const Philox::Words words = Philox::draw(s.seed, s.request->tick, high);
  RandomStream random = {{words.w[0] | 1u, words.w[1], words.w[2], words.w[3]}};
  const MctsTree::Guide guide = {depth, t.plan, random.next(), t.range, s.settings->exploration};
  std::uint32_t* ends = t.ends + std::size_t{set} * t.most_ends;
  t.end_count[set] = t.tree.select_all(guide, ends);
  find_leaves(t, set);
  for (std::uint32_t member = 0; member < t.leaf_count[set]; ++member) choose_for_leaf(t, set, member, random);
}

bool draw(Sampler& s) {
  Search& t = search_of(s);
  for (std::uint32_t c = 0; c < t.choices(); ++c)
    t.plan[c] = action_near(t, s.mean, s.grid.knots, c / t.stages, c % t.stages);
  const std::uint32_t depth = explores(s) ? 0 : knots_within(s) * t.stages;
  std::uint32_t leaves = 1;  // since the last look at the clock
  for (t.set_count = 0; t.set_count < s.rollouts / kPolicies; ++t.set_count) {
    if (leaves >= kLeavesAtOnce) {
      if (s.request->deadline.passed()) return false;
      leaves = 0;
    }
    draw_set(s, t.set_count, depth);
    leaves += t.leaf_count[t.set_count];
  }
  // row by row: a lane's knots stand too far apart for the cache
  float* row = s.knots;
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    const float* value = t.value + std::size_t{i} * t.actions;
    const std::uint32_t stage = t.stages > 1 ? i : 0;
    for (std::uint32_t j = 0; j < s.grid.knots; ++j, row += s.rollouts)
      for (std::uint32_t lane = 0; lane < s.rollouts; ++lane)
        row[lane] = value[t.chosen_by(lane, 0)[j * t.stages + stage]];
  }
  return true;
}

void cancel(Sampler& s) {
  Search& t = search_of(s);
  for (std::uint32_t set = 0; set < t.set_count; ++set)
    for (std::uint32_t e = 0; e < t.end_count[set]; ++e) t.tree.cancel(t.ends[std::size_t{set} * t.most_ends + e]);
  t.tree.remove_uncommitted();
}

/// The cheapest sequence that all hypotheses went through alike.
void keep(Sampler& s) {
  const Search& t = search_of(s);
  std::uint32_t best = 0;
  for (std::uint32_t lane = 1; lane < s.rollouts; ++lane) {
    const std::uint32_t set = lane / kPolicies;
    if (t.forks(set) && lane % kPolicies >= t.reserved(set)) continue;
    if (s.cost[lane] < s.cost[best] || !(s.cost[best] <= s.range.high)) best = lane;
  }
  keep_rollout(s, best);
}

/// A simulation without a finite cost counts as the costliest that has one.
double simulated_cost(const Sampler& s, std::uint32_t lane) {
  const float cost = s.cost[lane];
  return static_cast<double>(cost <= s.range.high ? cost : s.range.high);
}

/// The mean of a set's simulations, to all nodes on its walks.
void back_up(Search& t, std::uint32_t set) {
  const Sampler& s = *t.core;
  const std::uint32_t* ends = t.ends + std::size_t{set} * t.most_ends;
  const std::uint32_t first = t.reserved(set);
  double sum = 0.0;
  for (std::uint32_t p = first; p < kPolicies; ++p) sum += simulated_cost(s, set * kPolicies + p);
  t.tree.back_up(ends[0], sum / (kPolicies - first));
  for (std::uint32_t e = 1; e < t.end_count[set]; ++e) t.tree.back_up(ends[e], walk_cost(t, set, ends[e]));
  t.cost_sum += sum;
  t.cost_count += kPolicies - first;
}

void update(Sampler& s) {
  Search& t = search_of(s);
  // the old plan was simulated again: what it costs now and did not before, the tree's means have missed
  if (s.iteration == 0 && t.has_cost && s.warm_cost <= static_cast<double>(s.range.high))
    t.tree.offset(s.warm_cost - t.last_cost);
  if (t.branches()) tell_apart(t);
  for (std::uint32_t set = 0; set < t.set_count; ++set) back_up(t, set);
  if (t.branches()) credit_outcomes(t);
  t.tree.commit();
  for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] = s.best[r];
  t.plan_cost = s.best_cost;
  t.plan_branches = t.branches() && take_plan(t);
  // between the cheapest and the mean: the costliest says how badly one can do, and drowns the differences that matter
  t.range = {t.plan_cost, t.cost_sum / t.cost_count};
}

double choose(Sampler& s) {
  Search& t = search_of(s);
  // what begins beyond the horizon was not simulated: the last choice within it holds
  const std::uint32_t within = knots_within(s);
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    double* row = s.mean + i * s.grid.knots;
    for (std::uint32_t j = within; j < s.grid.knots; ++j) row[j] = row[j - 1];
  }
  for (std::uint32_t v = 0; v < t.variant_count && t.branches(); ++v) {
    std::uint8_t* row = t.variants + std::size_t{v} * t.choices();
    for (std::uint32_t c = within * t.stages; c < t.choices(); ++c) row[c] = row[c - t.stages];
  }
  t.last_cost = t.plan_branches ? evaluate_mean(s) : s.best_cost;
  t.has_cost = std::isfinite(t.last_cost);
  return t.plan_cost;
}

void rebase(Sampler& s, double change) {
  Search& t = search_of(s);
  rebase_branches(t, change);
  t.cost_sum += change * t.cost_count;
}

constexpr SamplingMethod kMethod = {
    "mcts",       begin,           update, choose, draw, cancel, true, rebase, keep, Outcomes::are_seen,
    aim_particle, observe_particle};

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
  const bool branches = Outcomes::are_seen(config);
  const std::uint32_t sets = p.rollouts / kPolicies;
  place.most_members = branches ? p.particles : 1;
  place.most_ends = branches ? 2 * p.particles : 1;
  place.tree.lay_out(arena, std::max(std::uint32_t{16}, p.nodes), branches ? choices : 0);
  place.ends = arena.take<std::uint32_t>(std::size_t{sets} * place.most_ends);
  place.end_count = arena.take<std::uint32_t>(sets);
  place.leaves = arena.take<std::uint32_t>(std::size_t{sets} * place.most_members);
  place.leaf_count = arena.take<std::uint32_t>(sets);
  place.deepest = arena.take<std::uint32_t>(sets);
  place.plan = arena.take<std::uint32_t>(choices);
  place.choice = arena.take<std::uint32_t>(choices);
  place.chosen = arena.take<std::uint8_t>(std::size_t{p.rollouts} * place.most_members * choices);
  place.value = arena.take<float>(std::size_t{inputs} * place.actions);
  lay_out_branches(arena, config, knots, choices, place);
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
  t.variant_count = 1;
}

const float* sequence(const void* self) { return sampled_sequence(static_cast<const Search*>(self)->core); }

}  // namespace

extern const PlannerTable mcts_planner;
const PlannerTable mcts_planner = {kMethod.name, lay_out, plan, reset, sequence};

}  // namespace tiller
