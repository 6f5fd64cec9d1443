#include "planners/scout.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "core/rng.hpp"

namespace tiller {
namespace {

// of the planner's random numbers; no plan has so many iterations
constexpr std::uint64_t kStream = (std::uint64_t{kRngPlanner} << 32) | (0xffffu << 16);
constexpr std::uint32_t kWidest = 4;      // of the sampler's kScales scales
constexpr std::uint32_t kTried = 8;       // samples of which a search begins from the cheapest
constexpr std::uint32_t kMostPlans = 12;  // of a search; what has not become a cheaper motion by then seldom does

/// The cheapest of a few of the widest samples, drawn anew for each search.
std::uint32_t choose_sample(const Sampler& sampler, std::uint64_t begun) {
  const std::uint32_t groups = sampler.rollouts / kScales;
  std::uint32_t best = 0;
  float least = std::numeric_limits<float>::infinity();
  for (std::uint32_t n = 0; n < kTried; ++n) {
    const Philox::Words w = Philox::draw(sampler.seed, begun, kStream | n);
    const std::uint32_t k = w.w[0] % groups * kScales + w.w[1] % kWidest;
    if (k >= 2 && sampler.cost[k] < least) {
      best = k;
      least = sampler.cost[k];
    }
  }
  return best;
}

/// The sample's inputs; every other search adds what tells the sample from the sampler's mean to the present plan. What
/// that puts out of a cone, the path's first rollout brings into it.
bool begin(Scout& s, const Sampler& sampler, const PathPlan& present) {
  PathPlan& p = s.gradient->plan;
  const std::uint32_t sample = choose_sample(sampler, s.begun);
  for (std::uint32_t r = 0; r < sampler.rows; ++r)
    s.knots[r] = static_cast<double>(sampler.knots[std::size_t{r} * sampler.rollouts + sample]);
  expand_sequence(sampler.grid, sampler.limits, sampler.cones, s.knots, sampler.start, s.sequence, nullptr,
                  sampler.cubic ? sampler.knot_before : nullptr);
  const bool moves_plan = s.begun++ % 2 != 0;
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i) {
    s.inputs[i] = static_cast<double>(s.sequence[i]);
    if (!moves_plan) continue;
    const double moved = s.inputs[i] + present.control[i] - static_cast<double>(sampler.sequence[i]);
    s.inputs[i] = std::fmin(std::fmax(moved, p.low[i % p.nu]), p.high[i % p.nu]);
  }
  p.has_path = p.has_gain = false;
  p.problem.regularisation = p.settings->regularisation;
  return restart_path(*s.gradient, s.inputs);
}

}  // namespace

bool meet_request(Scout& s, const PathPlan& present, const PlanRequest& request) {
  Ilqr& g = *s.gradient;
  const Belief one = one_hypothesis(present, *request.belief, 0, s.hypothesis);
  PlanRequest own = request;
  own.belief = &one;
  s.motion = false;
  if (!take_request(g, own)) return false;
  g.standing = g.solved = g.converged = false;
  g.shooting.penalty = 0.0;
  return true;
}

void set_out(Scout& s) {
  Ilqr& g = *s.gradient;
  g.single = g.plan.settings->shooting == tiller_shooting_single;
}

std::uint32_t refine(Scout& s, const Deadline& deadline, std::uint32_t iterations) {
  Ilqr& g = *s.gradient;
  bool sound = true;
  std::uint32_t done = 0;
  for (; done < iterations && sound && !g.converged; ++done) {
    if (deadline.passed()) break;
    sound = g.single ? iterate_single(g) : iterate_multiple(g);
  }
  if (sound && !g.single) close_path(g);
  s.motion = g.single && std::isfinite(g.cost);
  ++s.plans;
  if (!sound || s.plans >= kMostPlans || (s.motion && g.converged)) s.plans = 0;
  return done;
}

std::uint32_t search_on(Scout& s, const Sampler& sampler, const PathPlan& present, const PlanRequest& request,
                        std::uint32_t iterations) {
  bool ready = meet_request(s, present, request);
  if (ready && s.plans > 0) {
    ready = !s.gradient->single || roll_open(*s.gradient);
  } else if (ready) {
    ready = begin(s, sampler, present);
    if (ready) set_out(s);
  }
  if (ready) return refine(s, request.deadline, iterations);
  s.plans = 0;
  return 0;
}

void lay_out_scout(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                   Scout& s) {
  const std::size_t count = std::size_t{config.planner.horizon} * config.model->input_count;
  s.gradient = lay_out_ilqr(arena, config, setup, table, true, 1);
  const std::size_t np = param_rows(config, setup), nx = config.model->state_count;
  s.hypothesis = arena.take<float>(np + nx + setup.effect_state_count);
  s.knots = arena.take<double>(std::size_t{config.planner.knots} * config.model->input_count);
  s.inputs = arena.take<double>(count);
  s.sequence = arena.take<float>(count);
}

void reset_scout(Scout& s) {
  reset_ilqr(*s.gradient);
  s.plans = 0;
  s.begun = 0;
  s.motion = false;
}

}  // namespace tiller
