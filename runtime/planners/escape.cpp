// A gradient planner stays in the valley in which it begins: it holds a motor at its limit where the torque just
// balances a pendulum, or leaves a pole hanging. Its scout begins elsewhere.
//
// Samples come first: straight lines between a few knots whose values are normal with twice the range of the input, cut
// by the limits, so that most of a sample switches between them. The line search's rollout takes eight multiples of one
// such sequence at once, in double and with the planner's own cost, so that the scout needs no sampler and no memory
// beside its path. Every other sequence is added to the present plan, the others to the middle of the range.
//
// Rejected: samples in every tick, as `hybrid` has them. They cost more than the gradient's iterations, and a plan that
// makes progress does not need them.

#include "planners/escape.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "core/rng.hpp"
#include "planners/line_search.hpp"

namespace tiller {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kCheaper = 1e-3;
constexpr double kProgress = 0.9;                 // of the mark: a plan that costs less than this has made progress
constexpr double kDone = 0.05;                    // of the worst cost: a plan that costs less is at its goal
constexpr std::uint32_t kDraws = 4, kRounds = 4;  // iterations of samples a search, and rollouts of eight in each
constexpr std::uint32_t kFewestKnots = 4, kMostKnots = 16;
constexpr std::uint32_t kMostIterations = 100;  // that a recording may hold: tiller_force_iterations

const double kMultiples[kCandidates] = {1.0, -1.0, 0.5, -0.5, 0.25, -0.25, 0.1, -0.1};
const double kNoGain[kCandidates] = {};

std::size_t input_count(const PathPlan& p) { return std::size_t{p.horizon} * p.nu; }

// ---- samples ------------------------------------------------------------------------------------

/// Straight lines between normal knots, as the step of the line search.
void draw_sequence(PathPlan& p, Rng& rng) {
  const std::uint32_t knots = std::min(kFewestKnots + rng.below(kMostKnots - kFewestKnots + 1), p.horizon);
  for (std::uint32_t i = 0; i < p.nu; ++i) {
    const double sd = kWidths * (p.high[i] - p.low[i]);
    double from = sd * rng.normal(), to = sd * rng.normal();
    std::uint32_t knot = 0;
    for (std::uint32_t k = 0; k < p.horizon; ++k) {
      const double at = static_cast<double>(k) * (knots - 1) / p.horizon - knot;
      p.factor.step[std::size_t{k} * p.nu + i] = from + at * (to - from);
      if (static_cast<std::uint64_t>(k + 1) * (knots - 1) / p.horizon == knot) continue;
      ++knot;
      from = to;
      to = sd * rng.normal();
    }
  }
}

/// Path and gains of an earlier search have no part in a rollout, which multiplies by them all the same.
void begin_samples(Escape& e) {
  Scout& s = e.scout;
  PathPlan& p = s.gradient->plan;
  for (std::size_t k = 0; k <= p.horizon; ++k)
    std::memcpy(p.state + k * p.nz, p.start, std::size_t{p.nz} * sizeof(double));
  std::memset(p.factor.gain, 0, input_count(p) * p.scenarios * p.n * sizeof(double));
  p.has_path = p.has_gain = false;
  p.problem.regularisation = p.settings->regularisation;
  e.drawn = 0;
  e.best_cost = kInfinity;
  ++s.begun;
}

/// The best sample so far from this tick's start.
void go_on_with_samples(Escape& e) {
  PathPlan& p = e.scout.gradient->plan;
  p.has_path = false;
  std::memcpy(e.scout.inputs, p.control, input_count(p) * sizeof(double));
  roll_candidates(p, kNoGain, kNoGain);
  e.best_cost = candidate_risk(p, kWarm);
}

void keep_cheapest(Escape& e) {
  const PathPlan& p = e.scout.gradient->plan;
  for (std::uint32_t c = 0; c < kCandidates; ++c) {
    const double cost = candidate_risk(p, c);
    if (!(cost < e.best_cost)) continue;
    e.best_cost = cost;
    for (std::size_t i = 0; i < input_count(p); ++i) e.scout.inputs[i] = p.candidate_control[i * kCandidates + c];
  }
}

void draw_samples(Escape& e, const PathPlan& present) {
  Scout& s = e.scout;
  PathPlan& p = s.gradient->plan;
  Rng rng(e.seed, kRngPlanner, s.begun * kDraws + e.drawn);
  for (std::uint32_t round = 0; round < kRounds; ++round) {
    for (std::size_t i = 0; i < input_count(p); ++i)
      p.control[i] = round % 2 != 0 ? present.control[i] : 0.5 * (p.low[i % p.nu] + p.high[i % p.nu]);
    draw_sequence(p, rng);
    roll_candidates(p, kMultiples, kNoGain);
    keep_cheapest(e);
  }
  std::memset(p.factor.step, 0, input_count(p) * sizeof(double));
  std::memcpy(p.control, std::isfinite(e.best_cost) ? s.inputs : present.control, input_count(p) * sizeof(double));
  ++e.drawn;
}

// ---- when ---------------------------------------------------------------------------------------

/// Half of the plan holds an input at a limit.
bool saturates(const PathPlan& p) {
  for (std::uint32_t i = 0; i < p.nu; ++i) {
    std::uint32_t held = 0;
    const double edge = 1e-6 * (p.high[i] - p.low[i]);
    for (std::uint32_t k = 0; k < p.horizon; ++k) {
      const double u = p.control[std::size_t{k} * p.nu + i];
      held += u <= p.low[i] + edge || u >= p.high[i] - edge;
    }
    if (2 * held >= p.horizon) return true;
  }
  return false;
}

/// A plan that follows a reference has a cost which stands still; it is stuck only where an input has nothing left. So
/// is one at a fixed goal, and there also one that is still far from it.
bool is_stuck(const Escape& e, const PathPlan& p) {
  if (e.least < kProgress * e.mark) return false;
  return (p.cost.reference == nullptr && e.least > kDone * e.worst) || saturates(p);
}

/// Looked at every quarter of a horizon: the cheapest plan of each says how far the robot is, for a single one around
/// an unstable state may cost any amount until its next iteration. What is wanted begins with the next plan: a first
/// plan is as quick as one without a scout.
void watch_progress(Escape& e, const PathPlan& p, double cost, std::uint64_t goal) {
  if (!e.begun || goal != e.goal) {
    e.begun = e.wanted = true;
    e.goal = goal;
    e.worst = 0.0;
    e.mark = e.least = kInfinity;
    e.age = 0;
  }
  e.least = std::fmin(e.least, cost);
  if (++e.age < (p.horizon + 3) / 4) return;
  e.wanted = is_stuck(e, p);
  e.worst = std::fmax(e.worst, e.least);
  e.mark = e.least;
  e.least = kInfinity;
  e.age = 0;
}

}  // namespace

std::uint32_t search_beside(Escape& e, const PathPlan& present, double cost, const PlanRequest& request,
                            std::uint32_t iterations) {
  Scout& s = e.scout;
  Ilqr& g = *s.gradient;
  const bool searches = s.plans > 0 || e.wanted;
  watch_progress(e, present, cost, request.goal);
  s.motion = false;
  if (!searches) return 0;
  if (!meet_request(s, present, request)) {
    s.plans = 0;
    return 0;
  }
  if (s.plans == 0) {
    begin_samples(e);
    e.wanted = false;
    s.plans = 1;
  } else if (e.drawn < kDraws) {
    go_on_with_samples(e);
  } else if (g.single && !roll_open(g)) {
    s.plans = 0;
    return 0;
  }
  std::uint32_t done = 0;
  while (done < iterations && e.drawn < kDraws) {
    if (request.deadline.passed()) return done;
    draw_samples(e, present);
    ++done;
    if (e.drawn < kDraws) continue;
    if (!restart_path(g, s.inputs)) {
      s.plans = 0;
      return done;
    }
    set_out(s);
  }
  return e.drawn < kDraws ? done : done + refine(s, request.deadline, iterations - done);
}

bool try_scout(Escape& e, PathPlan& p) {
  const Scout& s = e.scout;
  if (!s.motion || !(s.gradient->cost < p.path_cost[0])) return false;
  std::memcpy(s.inputs, p.control, input_count(p) * sizeof(double));
  std::memcpy(p.control, s.gradient->plan.control, input_count(p) * sizeof(double));
  roll_candidates(p, kNoGain, kNoGain);
  return true;
}

void take_back(Escape& e, PathPlan& p) { std::memcpy(p.control, e.scout.inputs, input_count(p) * sizeof(double)); }

bool saves(double cost, double worth) { return cost < worth - kCheaper * std::fabs(worth); }

void follow_scout(Escape& e, PathPlan& p) {
  take_candidate(p, kWarm);
  std::memset(p.factor.gain, 0, input_count(p) * p.scenarios * p.n * sizeof(double));
  std::memset(p.factor.step, 0, input_count(p) * sizeof(double));
  p.has_gain = false;
  p.problem.regularisation = p.settings->regularisation;
  e.scout.plans = 0;
}

IterationBudget iteration_budget(const Deadline& deadline, const tiller_planner_config_t& settings) {
  IterationBudget budget;
  budget.cap = deadline.replayed ? std::min(settings.iterations, deadline.iterations) : deadline.iterations;
  budget.total =
      deadline.replayed ? deadline.iterations : std::max(budget.cap, std::min(2 * budget.cap, kMostIterations));
  return budget;
}

Escape* lay_out_escape(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table) {
  auto* e = arena.take<Escape>(1);
  Scout scout;
  lay_out_scout(arena, config, setup, table, scout);
  if (!e || !arena.fits()) return nullptr;
  *e = {};
  e->scout = scout;
  e->seed = config.seed;
  reset_escape(*e);
  return e;
}

void reset_escape(Escape& e) {
  reset_scout(e.scout);
  e.begun = e.wanted = false;
  e.drawn = e.age = 0;
  e.mark = e.least = e.worst = 0.0;
}

}  // namespace tiller
