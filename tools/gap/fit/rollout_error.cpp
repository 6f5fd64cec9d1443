#include "tools/gap/fit/rollout_error.hpp"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "rollout/model_adapter.hpp"
#include "tools/gap/fit/shooting.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

/// A hundred seconds: the RMS of so many windows is known to some percent.
constexpr std::size_t kMostErrorWindows = 100;
constexpr std::size_t kRatePoints = 5;

// The state of a row as far as it is measured, at 0 what is not.
std::vector<double> state_of(const Grid& grid, std::size_t row) {
  std::vector<double> x;
  for (const auto& column : grid.state) x.push_back(row < column.size() && std::isfinite(column[row]) ? column[row] : 0);
  return x;
}

// The largest eigenvalue of the equations, 1/s, in some rows of the log.
double fastest_rate_1_s(const tiller_config_t& config, const Grid& grid) {
  const tiller_model_t& model = *config.model;
  const auto nx = static_cast<Eigen::Index>(model.state_count);
  const std::vector<double> params = prior_centre(config);
  const double force[TILLER_MAX_JOINTS] = {};
  double fastest = 0;
  for (std::size_t n = 0; n < kRatePoints; ++n) {
    const std::size_t row = n * grid.points() / kRatePoints;
    std::vector<double> x = state_of(grid, row), u, up(model.state_count), down(model.state_count);
    for (const auto& input : grid.input) u.push_back(input[row]);
    Eigen::MatrixXd slopes(nx, nx);
    for (Eigen::Index i = 0; i < nx; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const double centre = x[at], step = 1e-6 * std::max(1.0, std::fabs(centre));
      x[at] = centre + step;
      model.dynamics(x.data(), u.data(), force, &config.body, params.data(), up.data());
      x[at] = centre - step;
      model.dynamics(x.data(), u.data(), force, &config.body, params.data(), down.data());
      x[at] = centre;
      for (Eigen::Index r = 0; r < nx; ++r)
        slopes(r, i) = (up[static_cast<std::size_t>(r)] - down[static_cast<std::size_t>(r)]) / (2 * step);
    }
    if (slopes.allFinite())
      fastest = std::max(fastest, Eigen::EigenSolver<Eigen::MatrixXd>(slopes, false).eigenvalues().cwiseAbs().maxCoeff());
  }
  return fastest;
}

}  // namespace

Config with_fine_steps(const tiller_config_t& config, const Grid& grid) {
  const tiller_model_t& model = *config.model;
  Config fine = config;
  double steps = std::ceil(config.period_s / (kSubstep_s * grid.time_scale) - 1e-9);
  const auto joints = static_cast<int>(model.joint_count);
  if (joints > 0 && model.dynamics && grid.points() > 0 &&
      states_of_no_joint(model.joints, joints, static_cast<int>(model.state_count)) != 0)
    steps = std::max(steps, std::ceil(config.period_s * fastest_rate_1_s(config, grid) / kSubstepRate));
  fine.substeps = std::max(config.substeps, static_cast<std::uint32_t>(std::min(64.0, steps)));
  return fine;
}

double rollout_error_sigma(const tiller_config_t& config, std::vector<Grid> grids, const std::vector<double>& params) {
  if (grids.empty()) return NAN;
  const Config fine = with_fine_steps(config, grids.front());
  const WindowData data = make_window_data(std::move(grids), fine);
  const std::vector<Window> windows = make_windows(data, fine, kWindow_s, 0, data.grids.size());
  std::vector<std::size_t> some;
  const std::size_t count = std::min(windows.size(), kMostErrorWindows);
  for (std::size_t i = 0; i < count; ++i) some.push_back(i * windows.size() / count);
  Hypothesis model;
  if (some.empty() || !make_hypothesis(fine, {}, nullptr, model)) return NAN;
  const Scales scales = measure_scales(data, windows, fine, params.data());
  Shooting shooting(data, windows, fine, scales);
  Fit fit = shooting.begin(model, params, nullptr);
  FitSettings states;
  states.fix_params = true;
  shooting.prepare_whitening(model, fit);
  shooting.fit(model, some, states, fit);
  if (!fit.finite) return NAN;
  double sum = 0, freedom = 0;
  for (const std::size_t w : some) {
    sum += fit.cost[w];
    freedom += static_cast<double>(shooting.values(w)) - fine.model->state_count;
  }
  return freedom > 0 ? std::sqrt(sum / freedom) : NAN;
}

}  // namespace tiller::tools::gap
