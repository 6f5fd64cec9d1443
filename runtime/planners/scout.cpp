#include "planners/scout.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "core/rng.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

// of the planner's random numbers; no plan has so many iterations
constexpr std::uint64_t kStream = (std::uint64_t{kRngPlanner} << 32) | (0xffffu << 16);
constexpr std::uint32_t kWidest = 4;      // of the sampler's kScales scales
constexpr std::uint32_t kTried = 8;       // samples of which a search begins from the cheapest
constexpr std::uint32_t kMostPlans = 12;  // of a search; what has not become a cheaper motion by then seldom does

// Eight searches begin in turn from a sample, from the plan moved by a sample, from the mirrored plan, and five times
// from the plan itself: those from the plan descend a cost of their own first. What they settle into there is a motion
// that another task would have, and from it they descend the cost itself.
constexpr std::uint32_t kTurns = 8;
constexpr std::uint64_t kTilts = std::uint64_t{0xfffe0000u} << 32;  // random numbers
constexpr std::uint32_t kTilted = 2;                                // plans under a cost of the search's own
constexpr double kLeast = 0.135, kMost = 1.65;  // strength of a tilt; the following are those of strength 1
constexpr double kStates = 1.0;                 // deviation of the logarithm of the states' weights
constexpr double kInputs = 1.5;                 // and of the inputs'
constexpr double kTargets = 0.3;                // deviation of the target, in widths of the plan
constexpr double kFades = 4.0;                  // most that the logarithm of a penalty's weight may lose
constexpr double kObstacles = 0.5;              // deviation of an obstacle's place, in its radii

// Every other eight searches keep their turns of the target for so many plans, as the plan does; the others never.
constexpr std::uint32_t kHolds = 6;

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

double scatter(Rng& rng, double deviation) { return math::exp(deviation * rng.normal()); }

/// Largest less smallest value of a state along the first hypothesis's path.
double width(const PathPlan& p, std::uint32_t i) {
  double low = p.state[i], high = low;
  for (std::size_t k = 1; k <= p.horizon; ++k) {
    low = std::fmin(low, p.state[k * p.scenarios * p.nz + i]);
    high = std::fmax(high, p.state[k * p.scenarios * p.nz + i]);
  }
  return high - low;
}

/// The search's cost: other weights, another target, obstacles elsewhere.
void tilt(Scout& s, const Sampler& sampler, const PathPlan& present) {
  PathPlan& p = s.gradient->plan;
  CostTerms<double>& c = p.cost;
  Rng rng(sampler.seed, kRngPlanner, kTilts + s.begun);
  const double strength = kLeast * math::exp(rng.uniform() * math::log(kMost / kLeast));
  for (std::uint32_t i = 0; i < p.nx; ++i) {
    c.state[i] *= scatter(rng, strength * kStates);
    c.terminal[i] *= scatter(rng, strength * kStates);
    c.bound[i] *= math::exp(-strength * kFades * rng.uniform());
    c.target[i] += strength * kTargets * width(present, i) * rng.normal();
  }
  for (std::uint32_t i = 0; i < p.nu; ++i) c.input[i] *= scatter(rng, strength * kInputs);
  for (std::uint32_t t = 0; t < c.penalty_count; ++t) {
    CatalogueTerm<double>& term = c.terms[t];
    term.weight *= math::exp(-strength * kFades * rng.uniform());
    if (term.kind != tiller_cost_term_obstacles) continue;
    for (std::uint32_t i = 0; i < 2; ++i) term.params[i] += strength * kObstacles * term.params[2] * rng.normal();
  }
  p.hessians_stand = false;
  s.tilted = kTilted;
}

/// The search's cost becomes that of the plan.
void right(Scout& s, const PathPlan& present) {
  s.gradient->plan.cost = present.cost;
  s.gradient->plan.hessians_stand = false;
  s.tilted = 0;
}

void take_plan(Scout& s, const PathPlan& present, bool mirrored) {
  const PathPlan& p = s.gradient->plan;
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i) {
    const double u = present.control[i];
    s.inputs[i] = mirrored ? p.low[i % p.nu] + p.high[i % p.nu] - u : u;
  }
}

/// The sample's inputs, or what tells the sample from the sampler's mean added to the present plan.
void take_sample(Scout& s, const Sampler& sampler, const PathPlan& present, bool moves_plan) {
  PathPlan& p = s.gradient->plan;
  const std::uint32_t sample = choose_sample(sampler, s.begun);
  for (std::uint32_t r = 0; r < sampler.rows; ++r)
    s.knots[r] = static_cast<double>(sampler.knots[std::size_t{r} * sampler.rollouts + sample]);
  expand_sequence(sampler.grid, sampler.limits, sampler.cones, s.knots, sampler.start, s.sequence, nullptr,
                  sampler.cubic ? sampler.knot_before : nullptr);
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i) {
    s.inputs[i] = static_cast<double>(s.sequence[i]);
    if (!moves_plan) continue;
    const double moved = s.inputs[i] + present.control[i] - static_cast<double>(sampler.sequence[i]);
    s.inputs[i] = std::fmin(std::fmax(moved, p.low[i % p.nu]), p.high[i % p.nu]);
  }
}

/// What is put out of a cone here, the path's first rollout brings into it.
bool begin(Scout& s, const Sampler& sampler, const PathPlan& present) {
  PathPlan& p = s.gradient->plan;
  if (s.tilted > 0) right(s, present);
  const std::uint64_t turn = s.begun % kTurns;
  if (turn < 2)
    take_sample(s, sampler, present, turn == 1);
  else {
    take_plan(s, present, turn == 2);
    tilt(s, sampler, present);
  }
  ++s.begun;
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
  s.motion = s.tilted == 0 && g.single && std::isfinite(g.cost);
  ++s.plans;
  if (!sound || s.plans >= kMostPlans || (s.motion && g.converged)) s.plans = 0;
  return done;
}

std::uint32_t search_on(Scout& s, const Sampler& sampler, const PathPlan& present, const PlanRequest& request,
                        std::uint32_t iterations) {
  bool ready = meet_request(s, present, request);
  if (ready && s.plans > 0) {
    const bool righted = s.tilted == 1;
    if (righted)
      right(s, present);
    else if (s.tilted > 1)
      --s.tilted;
    ready = !(righted || s.gradient->single) || roll_again(*s.gradient);
  } else if (ready) {
    ready = begin(s, sampler, present);
    if (ready) set_out(s);
  }
  s.gradient->plan.hold_rad = s.begun / kTurns % 2 != 0 && s.plans < kHolds ? kHold_rad : 0.0;
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
