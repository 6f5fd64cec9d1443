#include "planners/sqp_chance.hpp"

#include <algorithm>
#include <cmath>

#include "planners/predicted_spread.hpp"
#include "planners/scenario_tree.hpp"

namespace tiller {
namespace {

// Bounds never meet: a spread as wide as their distance leaves a tenth of it in the middle.
constexpr double kMostMargin = 0.45;

std::size_t work_size(const PathPlan& p, std::uint32_t forces) {
  const std::uint32_t n = p.nz + forces;
  return std::size_t{2} * n * n + spread_scratch_size(n) + std::size_t{p.nu} * p.nz;
}

/// How a force that wanders moves the path's states on, from the difference that one of a deviation makes, one way and
/// the other. It does not fade meanwhile, and the other forces are none: states move on by it nearly in proportion.
void predict_pushes(const PathPlan& p, const SpreadRoom& room) {
  const StateSpread& spread = *p.spread;
  const std::size_t rows = std::size_t{p.horizon} * p.scenarios * p.nz, f = spread.forces;
  PathJob job;
  job.setup = p.setup;
  job.horizon = p.horizon;
  job.scenarios = p.scenarios;
  job.state = p.state;
  job.control = p.control;
  job.params = room.params;
  job.param_count = p.np;
  std::copy(p.params, p.params + std::size_t{p.scenarios} * p.np, room.params);
  for (std::size_t i = 0; i < f; ++i) {
    const double width = spread.force_sd[i] > 0.0 ? spread.force_sd[i] : 1.0;
    for (const bool less : {false, true}) {
      for (std::size_t j = 0; j < p.scenarios; ++j) {
        double* const force = room.params + j * p.np + p.setup->fading_param;
        std::fill(force, force + p.setup->extra_params(), 0.0);
        force[i] = less ? -width : width;
      }
      job.next = room.next + (less ? rows : 0);
      p.path->linearise(*p.model, job);
    }
    for (std::size_t row = 0; row < rows; ++row)
      room.push[row * f + i] = (room.next[row] - room.next[rows + row]) / (2.0 * width);
  }
}

/// The answer to a deviation that all scenarios share, the estimate's: gains (nu x M x n) summed over the scenarios.
void sum_gains(const PathPlan& p, const double* gains, std::size_t m, double* gain) {
  const std::size_t n = p.n;
  for (std::size_t i = 0; i < p.nu; ++i)
    for (std::size_t c = 0; c < p.nz; ++c) {
      double sum = 0.0;
      for (std::size_t j = 0; j < m; ++j) sum += gains[(i * m + j) * n + c];
      gain[i * p.nz + c] = sum;
    }
}

/// Deviations of the bounded states along scenario j's path, into its margins. `gain_at(k, gain)` writes the gain of
/// period k; false: there is none.
template <class Gain>
void predict_deviations(const PathPlan& p, const HardBounds& bounds, const SpreadRoom& room, std::size_t j,
                        const Gain& gain_at, double* margin) {
  const StateSpread& spread = *p.spread;
  const std::size_t m = p.scenarios, n = p.n, all = spread_size(spread, p.nz);
  double* const error = room.work;
  double* const estimate = error + all * all;
  double* const gain = estimate + all * all;
  double* const scratch = gain + std::size_t{p.nu} * p.nz;
  begin_spread(spread, p.nz, error, estimate);
  for (std::size_t k = 0; k < p.horizon; ++k) {
    SpreadStage stage;
    stage.size = p.nz;
    stage.inputs = p.nu;
    stage.a = p.a + (k * m + j) * n * n;
    stage.stride = n;
    stage.b = p.b + (k * m + j) * n * p.nu;
    stage.gain = gain_at(k, gain) ? gain : nullptr;
    stage.gain_stride = p.nz;
    if (spread.forces > 0) stage.push = room.push + (k * m + j) * p.nz * spread.forces;
    step_spread(spread, stage, error, estimate, scratch);
    for (std::size_t i = 0; i < p.nx; ++i)
      if (bounds.names(i))
        margin[((k + 1) * m + j) * p.nx + i] = std::sqrt(std::fmax(0.0, error[i * all + i] + estimate[i * all + i]));
  }
}

/// How many states of scenario j's path are nearer to a bound than the quantile of an equal share.
std::uint32_t count_near(const PathPlan& p, const HardBounds& bounds, double quantile, std::size_t j,
                         const double* margin) {
  std::uint32_t near = 0;
  for (std::size_t k = 1; k <= p.horizon; ++k)
    for (std::size_t i = 0; i < p.nx; ++i) {
      if (!bounds.names(i)) continue;
      const std::size_t row = k * p.scenarios + j;
      const double x = p.state[row * p.nz + i];
      const double left = std::fmin(x - bounds.low[i], bounds.high[i] - x);
      near += left < quantile * margin[row * p.nx + i] ? 1u : 0u;
    }
  return near;
}

/// Boole's inequality: the risk of the path is at most the sum of its states'. It is shared by those that come near a
/// bound (risk allocation: Ono and Williams, CDC 2008, in one step).
void share_risk(const PathPlan& p, const HardBounds& bounds, double equal_share, std::size_t j, double* margin) {
  const std::uint32_t near = count_near(p, bounds, equal_share, j, margin);
  const double quantile = gaussian_quantile_above(p.frame.cost().bound_risk / (near > 1 ? near : 1));
  for (std::size_t k = 1; k <= p.horizon; ++k)
    for (std::size_t i = 0; i < p.nx; ++i) {
      double& at = margin[(k * p.scenarios + j) * p.nx + i];
      if (bounds.names(i)) at = std::fmin(quantile * at, kMostMargin * (bounds.high[i] - bounds.low[i]));
    }
}

}  // namespace

bool wants_margins(const tiller_config_t& config) { return config.cost.bound_risk > 0.0; }

void lay_out_spread_room(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const PathPlan& p,
                         SpreadRoom& room) {
  room.quantile = gaussian_quantile_above(config.cost.bound_risk / p.horizon);
  const std::uint32_t forces = setup.fading;
  room.work = arena.take<double>(work_size(p, forces));
  if (forces == 0) return;
  const std::size_t rows = std::size_t{p.horizon} * p.most_scenarios * p.nz;
  room.push = arena.take<double>(rows * forces);
  room.next = arena.take<double>(2 * rows);
  room.params = arena.take<double>(std::size_t{p.most_scenarios} * p.np);
}

void predict_margins(const PathPlan& p, const HardBounds& bounds, const SpreadRoom& room, double* margin) {
  std::fill(margin, margin + (std::size_t{p.horizon} + 1) * p.scenarios * p.nx, 0.0);
  const auto gain_at = [&](std::size_t k, double* gain) {
    if (p.has_gain) sum_gains(p, p.factor.gain + k * p.nu * p.scenarios * p.n, p.scenarios, gain);
    return p.has_gain;
  };
  if (p.spread && p.spread->forces > 0) predict_pushes(p, room);
  for (std::size_t j = 0; p.spread && j < p.scenarios; ++j) {
    predict_deviations(p, bounds, room, j, gain_at, margin);
    share_risk(p, bounds, room.quantile, j, margin);
  }
}

void predict_branch_margins(const ScenarioTree& t, std::uint32_t j, const HardBounds& bounds, const SpreadRoom& room,
                            double* margin) {
  const PathPlan& p = t.branch[j];
  std::fill(margin, margin + (std::size_t{p.horizon} + 1) * p.nx, 0.0);
  if (!p.spread) return;
  if (p.spread->forces > 0) predict_pushes(p, room);
  const auto gain_at = [&](std::size_t k, double* gain) {
    if (t.has_gain && k < t.shared)
      sum_gains(p, t.trunk_factor.gain + k * p.nu * t.count * p.n, t.count, gain);
    else if (t.has_gain)
      sum_gains(p, p.factor.gain + k * p.nu * p.n, 1, gain);
    return t.has_gain;
  };
  predict_deviations(p, bounds, room, 0, gain_at, margin);
  share_risk(p, bounds, room.quantile, 0, margin);
}

}  // namespace tiller
