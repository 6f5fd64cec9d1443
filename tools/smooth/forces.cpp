#include "tools/smooth/forces.hpp"

#include <algorithm>
#include <cmath>

#include "tools/smooth/forced_step.hpp"
#include "tools/smooth/smoother.hpp"

namespace tiller::tools {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr double kHalfWidth_s = 0.05;  // of the parabolas that tell a typical acceleration

/// The columns of `m` before the last, appended to `all`.
void append(const Matrix& m, Matrix& all) {
  const Eigen::Index at = all.cols();
  all.conservativeResize(m.rows(), at + m.cols() - 1);
  all.rightCols(m.cols() - 1) = m.leftCols(m.cols() - 1);
}

}  // namespace

bool smooth_forces(const tiller_config_t& config, const std::vector<Grid>& grids, const std::vector<double>& params,
                   const Eigen::VectorXd& force_sd, SmoothedForces& out, std::string& error) {
  out = SmoothedForces{};
  SmoothSettings settings;
  settings.force_sd = force_sd;
  const std::uint32_t nu = config.model->input_count;
  for (const Grid& grid : grids) {
    SmoothedGrid smoothed;
    if (!smooth_grid(config, params, grid, settings, smoothed, error)) return false;
    if (smoothed.state.cols() == 0) continue;  // nothing to learn from
    const Eigen::Index at = out.state.cols(), count = smoothed.state.cols() - 1;
    append(smoothed.state, out.state);
    append(smoothed.filtered, out.filtered);
    append(smoothed.force, out.force);
    append(smoothed.force_variance.cwiseMax(1e-12), out.variance);
    out.input.conservativeResize(nu, at + count);
    for (Eigen::Index k = 0; k < count; ++k) {
      for (std::uint32_t i = 0; i < nu; ++i)
        out.input(i, at + k) = grid.input[i][smoothed.first + static_cast<std::size_t>(k)];
      out.weight.push_back(k < kForceBegins ? 0.0 : 1.0);
    }
  }
  if (out.force.cols() > 0) return true;
  error = "no log holds ten periods in which every measured state is known";
  return false;
}

Eigen::VectorXd typical_forces(const tiller_config_t& config, const std::vector<Grid>& grids,
                               const std::vector<double>& params) {
  const std::uint32_t nx = config.model->state_count, nf = config.model->joint_count;
  Vector squares = Vector::Zero(nf), count = Vector::Zero(nf), response = Vector::Zero(nf);
  Config forced;
  std::string error;
  if (!with_forces(config, forced, error)) return squares;
  ForcedStep step(forced, params, Vector::Ones(nf));
  int responses = 0;
  for (const Grid& logged : grids) {
    const Grid grid = unwrapped(logged, *config.model);
    // twentieths of a second: between neighbours at a kilohertz the sensors' noise is most of the difference
    const auto every = static_cast<std::size_t>(std::max(2.0, std::round(0.05 / grid.period_s)));
    double before[TILLER_MAX_STATES], state[TILLER_MAX_STATES];
    bool knew = false;
    for (std::size_t point = 0; point + 1 < grid.points(); point += every) {
      const bool knows = estimate_state(grid, config, point, kHalfWidth_s, state);
      Vector z = Vector::Zero(nx + nf), next;
      Matrix slope;
      for (std::uint32_t i = 0; knows && i < nx; ++i) z(i) = state[i];
      step.begin(grid, point);
      if (knows && step.run(grid, point, z, next, slope)) {
        for (std::uint32_t j = 0; j < nf; ++j)
          response(j) += std::fabs(slope(config.model->joints[j].velocity, nx + j)) / grid.period_s;
        ++responses;
      }
      for (std::uint32_t j = 0; knows && knew && j < nf; ++j) {
        const std::uint32_t v = config.model->joints[j].velocity;
        squares(j) += std::pow((state[v] - before[v]) / (static_cast<double>(every) * grid.period_s), 2);
        count(j) += 1;
      }
      std::copy(state, state + nx, before);
      knew = knows;
    }
  }
  for (std::uint32_t j = 0; j < nf; ++j)
    squares(j) = count(j) > 0 && response(j) > 0 ? std::sqrt(squares(j) / count(j)) * responses / response(j) : 0.0;
  return squares;
}

Eigen::VectorXd choose_force_sd(const tiller_config_t& config, const std::vector<Grid>& grids,
                                const std::vector<double>& params, const Eigen::VectorXd& typical,
                                double* log_likelihood) {
  const auto likelihood = [&](const Vector& sd) {
    SmoothSettings settings;
    settings.force_sd = sd;
    return filter_log_likelihood(config, params, grids, settings);
  };
  // walks that reach the typical force in three hundred seconds to three milliseconds
  constexpr double kFactors[] = {0.05, 0.15, 0.5, 1.5, 5.0, 15.0};
  Vector best = typical;
  double most = -HUGE_VAL;
  for (const double factor : kFactors) {
    const double value = likelihood(factor * typical);
    if (value > most) {
      most = value;
      best = factor * typical;
    }
  }
  for (Eigen::Index j = 0; best.size() > 1 && j < best.size(); ++j)
    for (const double factor : {0.1, 0.33, 3.0}) {
      Vector other = best;
      other(j) *= factor;
      const double value = likelihood(other);
      if (!(value > most)) continue;
      most = value;
      best = other;
    }
  if (log_likelihood) *log_likelihood = most;
  return best;
}

Config with_honest_sensors(const tiller_config_t& config, const std::vector<Grid>& grids,
                           const std::vector<double>& params, const Eigen::VectorXd& typical,
                           Eigen::VectorXd& force_sd) {
  Config best = config;
  double most = -HUGE_VAL;
  for (const double factor : {1.0, 2.0, 4.0, 8.0}) {
    Config with = config;
    for (std::uint32_t c = 0; c < config.measurement_count; ++c) with.measurement_sd[c] *= factor;
    double likelihood = -HUGE_VAL;
    const Vector sd = choose_force_sd(with, grids, params, typical, &likelihood);
    if (!(likelihood > most)) {
      if (std::isfinite(most)) break;  // it has one maximum
      continue;
    }
    most = likelihood;
    best = with;
    force_sd = sd;
  }
  return best;
}

}  // namespace tiller::tools
