#include <algorithm>
#include <cmath>

#include "planners/sampler.hpp"

namespace tiller {
namespace {

// Cross-entropy method (Rubinstein 1999; for control: Kobilarov 2012) with a diagonal Gaussian over the knots. From
// iCEM (Pinneri et al., "Sample-efficient cross-entropy method for real-time planning", CoRL 2020) come the elite that
// is kept over the iterations and over the ticks (as rollouts 1 and 0 of the core) and the choice of the best sample
// where the mean of the elites is worse; its coloured noise is noise_colour, for every method.

constexpr double kSpreadFloor = 0.1;    // of noise_sd: a collapsed spread finds nothing when the scene changes
constexpr double kSpreadCeiling = 2.0;  // as adapt_covariance has it

void begin(Sampler& s) {
  if (s.settings->adapt_covariance) return;  // the spread goes on from the tick before
  for (std::uint32_t r = 0; r < s.rows; ++r) s.spread[r] = s.noise_sd[r / s.grid.knots];
}

std::uint32_t elite_count(const Sampler& s) {
  const double wish = std::nearbyint(s.settings->elite_fraction * s.rollouts);
  const std::uint32_t count = wish < 2.0 ? 2u : static_cast<std::uint32_t>(wish);
  return std::min(count, s.range.finite);
}

/// Weight 1 for the cheapest `count` rollouts, the first of equals, else 0.
void mark_elites(Sampler& s, std::uint32_t count) {
  std::copy(s.cost, s.cost + s.rollouts, s.weight);
  std::nth_element(s.weight, s.weight + (count - 1), s.weight + s.rollouts);
  const float threshold = s.weight[count - 1];
  std::uint32_t below = 0;
  for (std::uint32_t k = 0; k < s.rollouts; ++k) below += s.cost[k] < threshold ? 1u : 0u;
  std::uint32_t equals = count - below;
  for (std::uint32_t k = 0; k < s.rollouts; ++k) {
    const bool tie = s.cost[k] == threshold && equals > 0;
    if (tie) --equals;
    s.weight[k] = s.cost[k] < threshold || tie ? 1.0f : 0.0f;
  }
}

/// Mean square of the elites' scales on the ladder. Rollouts 0 and 1 were not drawn: nothing of the spread is in them.
double elite_scale(const Sampler& s, std::uint32_t count) {
  double sum = 0.0;
  for (std::uint32_t k = 2; k < s.rollouts; ++k) {
    const double scale = static_cast<double>(s.scale[k % kScales]);
    sum += static_cast<double>(s.weight[k]) * scale * scale;
  }
  return sum / count;
}

void take_moments(Sampler& s) {
  s.lanes->moments(s.knots, s.rows, s.rollouts, s.rollouts, s.weight, s.row_mean, s.row_sum, s.row_squares);
}

/// Elites without rollouts 0 and 1, which lie as far apart as samples of earlier iterations did: where those were drawn
/// with several times the spread, two of them are more than the variance of all others. Their number.
std::uint32_t drop_undrawn(Sampler& s, std::uint32_t count) {
  count -= static_cast<std::uint32_t>(s.weight[0] + s.weight[1]);
  s.weight[0] = s.weight[1] = 0.0f;
  if (count > 0) take_moments(s);
  return count;
}

/// Moves the spread towards that of `count` elites. Samples stand at several scales of the spread, so the elites'
/// variance is set against that of their scales: elites that were chosen by chance leave the spread as it was.
void refit_spread(Sampler& s, std::uint32_t count) {
  const double keep = s.settings->smoothing, scale = count > 0 ? elite_scale(s, count) : 0.0;
  if (!(scale > 0.0)) return;
  for (std::uint32_t r = 0; r < s.rows; ++r) {
    const double shift = static_cast<double>(s.row_sum[r]) / count;  // of the elites' mean from the old mean
    double variance = (static_cast<double>(s.row_squares[r]) / count - shift * shift) / scale;
    if (!take_back_annealing(s, r, variance)) continue;
    const double spread = keep * s.spread[r] + (1.0 - keep) * std::sqrt(std::fmax(variance, 0.0));
    const double noise_sd = s.noise_sd[r / s.grid.knots];
    s.spread[r] = std::fmin(std::fmax(spread, kSpreadFloor * noise_sd), kSpreadCeiling * noise_sd);
  }
}

void update(Sampler& s) {
  const std::uint32_t count = elite_count(s);
  mark_elites(s, count);
  take_moments(s);
  for (std::uint32_t r = 0; r < s.rows; ++r)
    s.mean[r] += (1.0 - s.settings->smoothing) * (static_cast<double>(s.row_sum[r]) / count);
  if (s.settings->adapt_covariance) return adapt_spread(s);
  refit_spread(s, s.anneals ? drop_undrawn(s, count) : count);
}

double choose(Sampler& s) {
  const double cost = evaluate_mean(s);
  if (cost <= s.best_cost) return cost;
  for (std::uint32_t r = 0; r < s.rows; ++r) s.mean[r] = s.best[r];
  return s.best_cost;
}

constexpr SamplingMethod kMethod = {"cem", begin, update, choose};

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t* hooks) {
  return lay_out_sampler(arena, config, setup, table, hooks, kMethod);
}

}  // namespace

extern const PlannerTable cem_planner;
const PlannerTable cem_planner = {
    kMethod.name, lay_out, plan_by_sampling, reset_sampler, sampled_sequence, nullptr, sampled_feedback, false, true};

}  // namespace tiller
