#include "tools/learn/held_out.hpp"

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "rollout/late_reading.hpp"
#include "tools/smooth/grid_rollout.hpp"
#include "tools/smooth/smoother.hpp"

namespace tiller::tools::learn {
namespace {

constexpr std::uint32_t kLanes = 64;
constexpr double kHorizon_s = 1.0, kEvery_s = 0.25;

/// Sums over all rollouts.
struct Sums {
  double squares = 0, count = 0, covered = 0, intervals = 0, seconds = 0;
  std::vector<double> each;
};

class Judge {
 public:
  explicit Judge(const Hypotheses& who)
      : who_(who),
        model_(*who.config->model),
        calm_(*who.config, kLanes),
        noisy_(*who.config, kLanes),
        sensors_(has_sensor_effects(*who.config)),
        rng_(3, 1415, 9) {
    for (GridRollout* rollout : {&calm_, &noisy_})
      for (std::uint32_t p = 0; p < who.config->param_count; ++p)
        for (std::uint32_t l = 0; l < kLanes; ++l)
          rollout->params()[p * kLanes + l] = who.params[l % who.params.size()][p];
  }

  void take(const Grid& grid, const Eigen::MatrixXd& states, Sums& sums) {
    const auto horizon = static_cast<std::size_t>(std::max(1.0, std::round(kHorizon_s / grid.period_s)));
    const auto every = static_cast<std::size_t>(std::max(1.0, std::round(kEvery_s / grid.period_s)));
    std::size_t k = 0;
    while (k < grid.points() && !states.col(static_cast<Eigen::Index>(k)).allFinite()) ++k;
    for (; k + horizon < grid.points(); k += every) {
      if (!states.col(static_cast<Eigen::Index>(k)).allFinite()) continue;
      const double squares = sums.squares, count = sums.count;
      const double* const state = &states(0, static_cast<Eigen::Index>(k));
      errors(grid, k, horizon, calm_.run(grid, k, horizon, state), sums);
      cover(grid, k, horizon, run_noisy(grid, k, horizon, state), sums);
      sums.each.push_back((sums.squares - squares) / std::max(1.0, sums.count - count));
      sums.seconds += kEvery_s;
    }
  }

 private:
  /// What the lane's sensor would show at row `k` of a path.
  double reading(const Grid& grid, std::uint32_t channel, std::uint32_t lane, const double* path, std::size_t k) {
    const std::uint32_t i = who_.config->measured_state[channel];
    if (!sensors_) return path[(k * model_.state_count + i) * kLanes + lane];
    return reading_on_path(*who_.config, calm_.params() + lane, channel, path + lane, k, grid.period_s, kLanes);
  }
  /// The mean over the hypotheses against every reading of the second.
  void errors(const Grid& grid, std::size_t k, std::size_t horizon, const double* path, Sums& sums) {
    for (std::size_t s = 1; s <= horizon; ++s)
      for (std::uint32_t c = 0; c < who_.config->measurement_count; ++c) {
        const std::uint32_t i = who_.config->measured_state[c];
        const double measured = grid.state[i][k + s];
        if (!std::isfinite(measured)) continue;
        const double first = reading(grid, c, 0, path, s);
        double mean = 0.0;
        for (std::uint32_t l = 0; l < kLanes; ++l)
          mean += state_difference(model_, i, reading(grid, c, l, path, s), first) / kLanes;
        // a rollout that has left the world counts as far away, not as everything
        const double e = std::min(
            std::fabs(state_difference(model_, i, measured, first + mean)) / who_.config->measurement_sd[c], 1e6);
        sums.squares += std::isfinite(e) ? e * e : 1e12;
        sums.count += 1;
      }
  }
  const double* run_noisy(const Grid& grid, std::size_t k, std::size_t horizon, const double* state) {
    const std::uint32_t nx = model_.state_count;
    noise_.resize(horizon * nx * kLanes);
    const double root = std::sqrt(grid.period_s);
    for (std::size_t r = 0; r < horizon * nx; ++r) {
      const double sd = who_.process_sd(static_cast<Eigen::Index>(r % nx)) * root;
      for (std::uint32_t l = 0; l < kLanes; ++l) noise_[r * kLanes + l] = sd > 0.0 ? sd * rng_.normal() : 0.0;
    }
    const std::vector<double> first = noisy_.first_effect_state(grid, k);
    path_.resize((horizon + 1) * nx * kLanes);
    RolloutJob<double> job = noisy_.job(grid, k, horizon);
    job.state = {state, 0};
    job.effect_state.data = first.data();
    job.noise = {noise_.data(), kLanes};
    job.trajectory = path_.data();
    select_rollout(model_).rollout_f64(model_, job);
    return path_.data();
  }
  /// Central 90 % of the lanes, sensor noise added, against the reading at the end.
  void cover(const Grid& grid, std::size_t k, std::size_t horizon, const double* path, Sums& sums) {
    for (std::uint32_t c = 0; c < who_.config->measurement_count; ++c) {
      const std::uint32_t i = who_.config->measured_state[c];
      const double measured = grid.state[i][k + horizon];
      if (!std::isfinite(measured)) continue;
      double off[kLanes];
      for (std::uint32_t l = 0; l < kLanes; ++l)
        off[l] = state_difference(model_, i, reading(grid, c, l, path, horizon), measured) +
                 who_.config->measurement_sd[c] * rng_.normal();
      std::sort(off, off + kLanes);
      sums.covered += off[3] <= 0.0 && off[kLanes - 4] >= 0.0;
      sums.intervals += 1;
    }
  }

  const Hypotheses& who_;
  const tiller_model_t& model_;
  GridRollout calm_, noisy_;
  bool sensors_;
  Rng rng_;
  std::vector<double> noise_, path_;
};

}  // namespace

HeldOut judge_rollouts(const Hypotheses& who, const std::vector<Grid>& grids,
                       const std::vector<Eigen::MatrixXd>& states) {
  Judge judge(who);
  Sums sums;
  for (std::size_t g = 0; g < grids.size(); ++g) judge.take(grids[g], states[g], sums);
  HeldOut out;
  if (sums.count > 0) out.rms_sigma = std::sqrt(sums.squares / sums.count);
  if (sums.intervals > 0) out.covered = sums.covered / sums.intervals;
  out.rollouts = sums.each.size();
  out.squares = std::move(sums.each);
  out.seconds = sums.seconds;
  return out;
}

bool is_better(const HeldOut& before, const HeldOut& after) {
  double improved = 0.0;
  for (std::size_t i = 0; i < before.squares.size(); ++i) improved += after.squares[i] < before.squares[i];
  const double share = improved / static_cast<double>(before.squares.size());
  return share - 0.5 > 1.64 * 0.5 / std::sqrt(std::max(before.seconds, 1.0));
}

std::vector<Eigen::MatrixXd> filtered_states(const tiller_config_t& config, const std::vector<Grid>& grids,
                                             const std::vector<double>& params, const Eigen::VectorXd& force_sd) {
  std::vector<Eigen::MatrixXd> all;
  for (const Grid& grid : grids) {
    const auto points = static_cast<Eigen::Index>(grid.points());
    Eigen::MatrixXd states = Eigen::MatrixXd::Constant(config.model->state_count, points, NAN);
    SmoothSettings settings;
    settings.force_sd = force_sd;
    SmoothedGrid smoothed;
    std::string error;
    if (smooth_grid(config, params, grid, settings, smoothed, error))
      for (Eigen::Index k = kForceBegins; k < smoothed.filtered.cols(); ++k)
        states.col(static_cast<Eigen::Index>(smoothed.first) + k) = smoothed.filtered.col(k);
    all.push_back(std::move(states));
  }
  return all;
}

}  // namespace tiller::tools::learn
