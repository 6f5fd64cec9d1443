// Chance constraints of sqp: hard bounds stand back by a quantile of the predicted spread, so that the motion ahead
// leaves them, anywhere, with the probability asked for. The spread is that of a robot that is measured and steered
// along the path (predicted_spread.hpp): without the feedback an unstable one would leave no room between its bounds.

#include <algorithm>
#include <cmath>

#include "planners/predicted_spread.hpp"
#include "planners/sqp.hpp"

namespace tiller {
namespace {

// Bounds never meet: a spread as wide as their distance leaves a tenth of it in the middle.
constexpr double kMostMargin = 0.45;

std::size_t work_size(const PathPlan& p) {
  return std::size_t{2} * p.nz * p.nz + spread_scratch_size(p.nz) + std::size_t{p.nu} * p.nz;
}

/// The answer to a deviation that all scenarios share, the estimate's: gains summed over the scenarios.
const double* common_gain(const PathPlan& p, std::size_t k, double* gain) {
  if (!p.has_gain) return nullptr;
  const std::size_t m = p.scenarios, n = p.n;
  for (std::size_t i = 0; i < p.nu; ++i)
    for (std::size_t c = 0; c < p.nz; ++c) {
      double sum = 0.0;
      for (std::size_t j = 0; j < m; ++j) sum += p.factor.gain[((k * p.nu + i) * m + j) * n + c];
      gain[i * p.nz + c] = sum;
    }
  return gain;
}

bool is_bounded(const Sqp& s, std::size_t i) { return std::isfinite(s.state_low[i]) || std::isfinite(s.state_high[i]); }

/// Deviations of the bounded states along scenario j's path, into its margins.
void predict_deviations(Sqp& s, std::size_t j) {
  const PathPlan& p = s.plan;
  const StateSpread& spread = *p.spread;
  const std::size_t m = p.scenarios, n = p.n, nz = p.nz;
  double* const error = s.spread_work;
  double* const estimate = error + nz * nz;
  double* const gain = estimate + nz * nz;
  double* const scratch = gain + p.nu * nz;
  begin_spread(spread, p.nz, error, estimate);
  for (std::size_t k = 0; k < p.horizon; ++k) {
    SpreadStage stage;
    stage.size = p.nz;
    stage.inputs = p.nu;
    stage.a = p.a + (k * m + j) * n * n;
    stage.stride = n;
    stage.b = p.b + (k * m + j) * n * p.nu;
    stage.gain = common_gain(p, k, gain);
    stage.gain_stride = nz;
    step_spread(spread, stage, error, estimate, scratch);
    for (std::size_t i = 0; i < p.nx; ++i)
      if (is_bounded(s, i))
        s.margin[((k + 1) * m + j) * p.nx + i] = std::sqrt(std::fmax(0.0, error[i * nz + i] + estimate[i * nz + i]));
  }
}

/// How many states of scenario j's path are nearer to a bound than the quantile of an equal share.
std::uint32_t count_near(const Sqp& s, std::size_t j) {
  const PathPlan& p = s.plan;
  std::uint32_t near = 0;
  for (std::size_t k = 1; k <= p.horizon; ++k)
    for (std::size_t i = 0; i < p.nx; ++i) {
      if (!is_bounded(s, i)) continue;
      const std::size_t row = k * p.scenarios + j;
      const double x = p.state[row * p.nz + i];
      const double left = std::fmin(x - s.state_low[i], s.state_high[i] - x);
      near += left < s.quantile * s.margin[row * p.nx + i] ? 1u : 0u;
    }
  return near;
}

/// Boole's inequality: the risk of the path is at most the sum of its states'. It is shared by those that come near a
/// bound (risk allocation: Ono and Williams, CDC 2008, in one step).
void share_risk(Sqp& s, std::size_t j) {
  const PathPlan& p = s.plan;
  const std::uint32_t near = count_near(s, j);
  const double quantile = gaussian_quantile_above(p.frame.cost().bound_risk / (near > 1 ? near : 1));
  for (std::size_t k = 1; k <= p.horizon; ++k)
    for (std::size_t i = 0; i < p.nx; ++i) {
      double& margin = s.margin[(k * p.scenarios + j) * p.nx + i];
      if (is_bounded(s, i)) margin = std::fmin(quantile * margin, kMostMargin * (s.state_high[i] - s.state_low[i]));
    }
}

}  // namespace

void lay_out_margins(Arena& arena, const tiller_config_t& config, Sqp& s) {
  const PathPlan& p = s.plan;
  if (!(config.cost.bound_risk > 0.0)) return;
  s.quantile = gaussian_quantile_above(config.cost.bound_risk / p.horizon);
  s.margin = arena.take<double>((std::size_t{p.horizon} + 1) * p.most_scenarios * p.nx);
  s.spread_work = arena.take<double>(work_size(p));
}

void predict_margins(Sqp& s) {
  const PathPlan& p = s.plan;
  if (!s.margin || !s.state_bounds) return;
  std::fill(s.margin, s.margin + (std::size_t{p.horizon} + 1) * p.scenarios * p.nx, 0.0);
  for (std::size_t j = 0; p.spread && j < p.scenarios; ++j) {
    predict_deviations(s, j);
    share_risk(s, j);
  }
}

}  // namespace tiller
