#include "tools/gap/localise/residual_force.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/smooth/forces.hpp"
#include "tools/smooth/smoother.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kRateHalfWidth = 0.04;  // s, of the slope of an input
// Points that choose the walks' intensities, which are a factor of three apart: the likelihoods of so many readings
// differ by tens.
constexpr std::size_t kChoosingPoints = 2000;

double sd_of(const tiller_config_t& config, std::uint32_t state) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (config.measured_state[k] == state) return config.measurement_sd[k];
  return kNaN;
}

// A command is held from its point to the next: at the point itself it is the mean of two.
void put_inputs(const Grid& grid, ResidualForce& r) {
  const auto reach =
      static_cast<std::ptrdiff_t>(std::max(1.0, std::round(kRateHalfWidth * grid.time_scale / grid.period_s)));
  const auto points = static_cast<std::ptrdiff_t>(grid.points());
  for (const std::vector<double>& u : grid.input) {
    std::vector<double> mean(grid.points(), kNaN), slope(grid.points(), kNaN);
    for (std::ptrdiff_t k = 1; k < points; ++k) {
      mean[static_cast<std::size_t>(k)] = 0.5 * (u[static_cast<std::size_t>(k - 1)] + u[static_cast<std::size_t>(k)]);
      double cross = 0, square = 0;
      for (std::ptrdiff_t i = -reach; i < reach; ++i) {  // command k + i acts around (k + i + 1/2) periods
        const auto at = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(k + i, 0, points - 1));
        const double t = (static_cast<double>(i) + 0.5) * grid.period_s;
        cross += t * u[at];
        square += t * t;
      }
      slope[static_cast<std::size_t>(k)] = cross / square;
    }
    r.input.push_back(std::move(mean));
    r.input_rate.push_back(std::move(slope));
  }
}

// Whether a sensor of the joint was read there: between readings the force is the walk's guess.
bool is_read(const tiller_config_t& config, const Grid& grid, const tiller_joint_t& joint, std::size_t point) {
  const auto has = [&](std::uint32_t state) {
    return std::isfinite(sd_of(config, state)) && !grid.state[state].empty() && std::isfinite(grid.state[state][point]);
  };
  return has(joint.velocity) || (joint.position != TILLER_NO_POSITION && has(joint.position));
}

// A row of the smoothed columns, NaN at the points before the first of them.
std::vector<double> row_of(const Eigen::MatrixXd& columns, std::uint32_t row, const SmoothedGrid& s,
                           std::size_t points) {
  std::vector<double> values(points, kNaN);
  for (Eigen::Index k = 0; k < columns.cols(); ++k) values[s.first + static_cast<std::size_t>(k)] = columns(row, k);
  return values;
}

// The force over a period acts around its middle: at a point it is the mean of the two periods around it, as inputs
// are.
void put_forces(const tiller_config_t& config, const Grid& grid, const SmoothedGrid& s, std::uint32_t j,
                ResidualForce& r) {
  std::vector<double> over = row_of(s.force, j, s, grid.points()), sd = row_of(s.force_variance, j, s, grid.points());
  for (double& value : sd) value = std::sqrt(value);
  std::vector<double> at(grid.points(), kNaN);
  for (std::size_t k = 1; k < grid.points(); ++k)
    if (is_read(config, grid, config.model->joints[j], k)) at[k] = 0.5 * (over[k - 1] + over[k]);
  r.force.push_back(std::move(at));
  r.force_sd.push_back(std::move(sd));
}

ResidualForce of_grid(const tiller_config_t& config, const Grid& grid, const SmoothedGrid& s) {
  const tiller_model_t& model = *config.model;
  ResidualForce r;
  r.period_s = grid.period_s;
  r.time_scale = grid.time_scale;
  for (std::size_t k = 0; k < grid.points(); ++k)
    r.time_s.push_back(grid.first_time_s + static_cast<double>(k) * grid.period_s);
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const std::uint32_t q = model.joints[j].position;
    r.position.push_back(q == TILLER_NO_POSITION ? std::vector<double>() : row_of(s.state, q, s, grid.points()));
    if (q != TILLER_NO_POSITION && (model.angle_mask >> q & 1u) != 0)
      for (double& angle : r.position.back()) angle = std::remainder(angle, 6.283185307179586);
    r.velocity.push_back(row_of(s.state, model.joints[j].velocity, s, grid.points()));
    put_forces(config, grid, s, j, r);
  }
  put_inputs(grid, r);
  return r;
}

std::vector<Grid> first_points(const std::vector<Grid>& grids, std::size_t wanted) {
  std::vector<Grid> some;
  for (const Grid& grid : grids) {
    if (wanted == 0) break;
    some.push_back(part_of(grid, 0, std::min(wanted, grid.points())));
    wanted -= some.back().points();
  }
  return some;
}

}  // namespace

std::vector<double> test_function(double half_width_s, double period_s) {
  const auto half = static_cast<std::ptrdiff_t>(std::max(3.0, std::round(half_width_s / period_s)));
  std::vector<double> values;
  double sum = 0;
  for (std::ptrdiff_t k = -half; k <= half; ++k) {
    const double t = static_cast<double>(k) / (static_cast<double>(half) + 1);
    values.push_back(std::pow(1 - t * t, 3));
    sum += values.back();
  }
  for (double& value : values) value /= sum;
  return values;
}

bool states_are_measured(const tiller_config_t& config, std::string& why) {
  const tiller_model_t& model = *config.model;
  why = model.joint_count == 0 ? "the model has no joint" : "";
  for (std::uint32_t i = 0; i < model.state_count && why.empty(); ++i) {
    bool known = std::isfinite(sd_of(config, i));
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      if (model.joints[j].velocity == i && model.joints[j].position != TILLER_NO_POSITION)
        known = known || std::isfinite(sd_of(config, model.joints[j].position));
    if (!known) why = std::string(model.state_names[i]) + " is neither measured nor the change of a measured position";
  }
  return why.empty();
}

std::vector<ResidualForce> residual_forces(const tiller_config_t& config, const std::vector<Grid>& grids,
                                           const double* params, std::string& why) {
  std::vector<ResidualForce> all;
  if (!states_are_measured(config, why)) return all;
  const std::vector<double> fixed(params, params + config.param_count);
  const std::vector<Grid> some = first_points(grids, kChoosingPoints);
  const Eigen::VectorXd typical = typical_forces(config, some, fixed);
  SmoothSettings settings;
  settings.force_sd = choose_force_sd(config, some, fixed, typical.cwiseMax(1e-6 * typical.maxCoeff()));
  for (const Grid& grid : grids) {
    SmoothedGrid smoothed;
    if (!smooth_grid(config, fixed, grid, settings, smoothed, why)) return {};
    all.push_back(of_grid(config, grid, smoothed));
  }
  return all;
}

}  // namespace tiller::tools::gap
