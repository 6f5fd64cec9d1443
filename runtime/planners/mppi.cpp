#include <cmath>

#include "planners/sampler.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

// Model predictive path integral control in its information-theoretic form: weights exp(-(S - S_min) / lambda) and the
// weighted mean of the noise (Williams et al., "Information theoretic MPC for model-based reinforcement learning",
// ICRA 2017, eqs. 20-26 and algorithm 2). Differences, and why:
//   - the base distribution is the present mean, so the cross term lambda u' Sigma^-1 eps of their eq. 25 is gone (the
//     limit alpha -> 1 of their later papers); the cost of control is the configured quadratic alone;
//   - the mean is taken over the noise as applied, after the limits: an input that cannot be had earns no weight;
//   - lambda is not a setting: it is solved for, so that the effective sample size (sum w)^2 / sum w^2 is the
//     configured share of K. A fixed lambda means something else for every cost, state and horizon;
//   - the mean of good samples may be worse than any of them (two ways around an obstacle), so the step towards it is
//     halved while it costs more than staying.

constexpr double kShareTolerance = 0.02;  // of log effective sample size; the update hardly depends on it
constexpr int kMostHalvings = 3;
constexpr double kRounding = 6e-8;  // of single precision, relative

/// log(effective sample size / wished) as a function of log lambda, growing; each value costs one pass over K.
struct ShareEquation {
  const Sampler& s;
  double wished;
  WeightSums sums;

  double operator()(double log_lambda) {
    sums = s.lanes->weigh(s.cost, s.rollouts, s.range.low, static_cast<float>(math::exp(-log_lambda)), s.weight);
    return math::log(static_cast<double>(sums.sum) * static_cast<double>(sums.sum) /
                     (static_cast<double>(sums.sum_of_squares) * wished));
  }
};

struct Point {
  double x, y;  // log lambda, the equation's value
  bool solves() const { return std::fabs(y) <= kShareTolerance; }
};

/// Steps that double, from `a` uphill or downhill, until the sign changes or an end of [low, high] is reached; the last
/// two points (the last one is the better if nothing brackets).
void bracket(ShareEquation& f, Point& a, Point& b, double low, double high) {
  double step = a.y < 0.0 ? 0.5 : -0.5;
  b = a;
  while (!b.solves() && (b.y < 0.0) == (a.y < 0.0) && (step > 0.0 ? b.x < high : b.x > low)) {
    a = b;
    b.x = std::fmin(std::fmax(a.x + step, low), high);
    b.y = f(b.x);
    step *= 2.0;
  }
}

/// False position, Illinois variant: an end that stays is given half its weight, so that both ends move.
Point close_in(ShareEquation& f, Point a, Point b) {
  for (int i = 0; i < 20 && !b.solves(); ++i) {
    Point next;
    next.x = (a.x * b.y - b.x * a.y) / (b.y - a.y);
    next.y = f(next.x);
    if ((next.y < 0.0) == (b.y < 0.0))
      a.y *= 0.5;
    else
      a = b;
    b = next;
  }
  return b;
}

/// Some five passes over K. At an end of [low, high] where the wish is out of reach. The weights are those of the value
/// returned.
double solve_log_lambda(ShareEquation& f, double start, double low, double high) {
  Point a, b;
  a.x = std::fmin(std::fmax(start, low), high);
  a.y = f(a.x);
  bracket(f, a, b, low, high);
  const bool bracketed = (a.y < 0.0) != (b.y < 0.0);
  return (bracketed ? close_in(f, a, b) : b).x;
}

/// Fills the weights; their sum.
double weigh_samples(Sampler& s) {
  const double width = static_cast<double>(s.range.high) - static_cast<double>(s.range.low);
  if (!(width > 0.0)) return static_cast<double>(s.lanes->weigh(s.cost, s.rollouts, s.range.low, 1.0f, s.weight).sum);
  ShareEquation f{s, std::fmax(1.0, s.settings->temperature * s.range.finite), {}};
  const double scale = math::log(width);
  const double start = s.lambda > 0.0 ? math::log(s.lambda) : scale - 2.0;
  // between the two ends a single sample and all of them get the weight, as far as f32 can tell: at the low end by the
  // digits of the cheapest cost, for samples beyond a limit may cost a billion times as much as all that separates the
  // others
  const double digits = kRounding * std::fmax(std::fabs(static_cast<double>(s.range.low)), kRounding * width);
  const double least = std::fmin(scale - 16.0, math::log(digits));
  s.lambda = math::exp(solve_log_lambda(f, start, least, scale + 7.0));
  return static_cast<double>(f.sums.sum);
}

void begin(Sampler&) {}

void update(Sampler& s) {
  const double total = weigh_samples(s);
  s.lanes->moments(s.knots, s.rows, s.rollouts, s.rollouts, s.weight, s.row_mean, s.row_sum, nullptr);
  for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] += static_cast<double>(s.row_sum[r]) / total;
  if (s.settings->adapt_covariance) adapt_spread(s);
}

double choose(Sampler& s) {
  double cost = evaluate_mean(s);
  for (int i = 0; i < kMostHalvings && !(cost <= s.mean_cost_before); ++i) {
    for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] = 0.5 * (s.mean[r] + s.before[r]);
    cost = evaluate_mean(s);
  }
  if (!(cost <= s.mean_cost_before)) {
    for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] = s.before[r];
    cost = s.mean_cost_before;
  }
  if (cost <= s.warm_cost) return cost;
  // several updates that were not looked at led astray: the best sample is at least as good as the warm start
  for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] = s.best[r];
  return s.best_cost;
}

constexpr SamplingMethod kMethod = {"mppi", begin, update, choose};

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t* hooks) {
  return lay_out_sampler(arena, config, setup, table, hooks, kMethod);
}

}  // namespace

extern const PlannerTable mppi_planner;
const PlannerTable mppi_planner = {
    kMethod.name, lay_out, plan_by_sampling, reset_sampler, sampled_sequence, nullptr, sampled_feedback, false, true};

}  // namespace tiller
