#include "tools/learn/own_params.hpp"

#include <cmath>

#include "posterior/prior.hpp"
#include "tools/gap/fit/hypothesis.hpp"

namespace tiller::tools::learn {
namespace {

using Vector = Eigen::VectorXd;

constexpr std::uint32_t kMostRefitJoints = 3;

}  // namespace

bool best_residual(const tiller_config_t& config, const std::vector<Grid>& grids, gap::ResidualFit& best) {
  double most = -HUGE_VAL;
  const std::vector<double> centre = gap::prior_centre(config);
  for (std::uint32_t j = 0; j < config.model->joint_count && config.model->joint_count <= kMostRefitJoints; ++j) {
    gap::ResidualFit fit;
    std::string error;
    if (!gap::fit_residual(config, grids, centre.data(), j, fit, error)) continue;
    if (!(fit.log_evidence > most) || fit.nominal.size() != config.param_count) continue;
    most = fit.log_evidence;
    best = fit;
  }
  return std::isfinite(most);
}

gap::Explanation own_params(const RobotFile& robot, const gap::ResidualFit& fit) {
  gap::Explanation own;
  const std::vector<double> centre = gap::prior_centre(robot.config);
  for (std::uint32_t p = 0; p < robot.config.param_count; ++p) {
    gap::Estimate e;
    e.name = robot.names.params[p];
    e.fixed = robot.config.priors[p].kind == tiller_prior_fixed;
    e.mean = centre[p];
    own.params.push_back(e);
  }
  const std::size_t d = fit.at.size();
  for (std::size_t i = 0; i < d; ++i) {
    const std::uint32_t p = fit.at[i];
    if (p >= robot.config.param_count) continue;  // a force of the residual
    const double sd = std::sqrt(fit.covariance[i * d + i]);
    own.params[p].mean = from_coordinate(robot.config.priors[p], fit.mean[i]);
    own.params[p].sd = robot.config.priors[p].kind == tiller_prior_log_normal ? own.params[p].mean * sd : sd;
  }
  return own;
}

HeldOut judge_residual(const gap::ResidualFit& fit, const std::vector<Grid>& grids,
                       const std::vector<Eigen::MatrixXd>& states) {
  std::vector<double> params = gap::prior_centre(fit.config);
  for (std::size_t i = 0; i < fit.at.size(); ++i)
    params[fit.at[i]] = from_coordinate(fit.config.priors[fit.at[i]], fit.mean[i]);
  return judge_rollouts(
      {&fit.config, {params}, Eigen::Map<const Vector>(fit.config.process_sd, fit.config.model->state_count)}, grids,
      states);
}

}  // namespace tiller::tools::learn
