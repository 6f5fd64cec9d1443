#include "tools/gap/fit/fine_steps.hpp"

#include <algorithm>
#include <cmath>

#include "rollout/model_adapter.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/robot/fastest_rate.hpp"

namespace tiller::tools::gap {
namespace {

constexpr std::size_t kRatePoints = 5;  // of a log: equations that are stiff somewhere are so at one of them
constexpr double kMostSteps = 64;

// In some rows of the log; what is not measured is taken at 0.
double fastest_rate_in(const tiller_config_t& config, const Grid& grid) {
  double fastest = 0;
  for (std::size_t n = 0; n < kRatePoints; ++n) {
    const std::size_t row = n * grid.points() / kRatePoints;
    double x[TILLER_MAX_STATES] = {}, u[TILLER_MAX_INPUTS] = {};
    for (std::size_t i = 0; i < grid.state.size(); ++i)
      if (!grid.state[i].empty() && std::isfinite(grid.state[i][row])) x[i] = grid.state[i][row];
    for (std::size_t i = 0; i < grid.input.size(); ++i) u[i] = grid.input[i][row];
    fastest = std::max(fastest, fastest_rate_1_s(config, x, u));
  }
  return fastest;
}

}  // namespace

Config with_fine_steps(const tiller_config_t& config, const Grid& grid) {
  const tiller_model_t& model = *config.model;
  const auto joints = static_cast<int>(model.joint_count), states = static_cast<int>(model.state_count);
  Config fine = config;
  double steps = std::ceil(config.period_s / (kSubstep_s * grid.time_scale) - 1e-9);
  if (joints > 0 && grid.points() > 0 && states_of_no_joint(model.joints, joints, states) != 0)
    steps = std::max(steps, std::ceil(config.period_s * fastest_rate_in(config, grid) / kSubstepRate));
  fine.substeps = std::max(config.substeps, static_cast<std::uint32_t>(std::min(kMostSteps, steps)));
  return fine;
}

}  // namespace tiller::tools::gap
