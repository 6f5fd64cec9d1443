#include "tools/refit/refit_prior.hpp"

#include <cmath>

#include "tools/identify/identify_fit.hpp"
#include "tools/identify/identify_method.hpp"
#include "tools/identify/laboratory.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools {
namespace {

bool is_one_step(const std::string& method) { return method == "simopt"; }

/// Names, coordinates and sizes as store_posterior() has them; the mixture is the method's Gaussian.
StoredPosterior of_gaussian(const RobotFile& robot, const MethodResult& found) {
  StoredPosterior out;
  out.model = robot.config.model->name;
  out.created_by = std::string("tiller ") + tiller_version();
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    const tiller_prior_t& prior = robot.config.priors[i];
    if (prior.kind == tiller_prior_fixed) continue;
    out.params.push_back(robot.names.params[i]);
    out.is_logarithm.push_back(prior.kind == tiller_prior_log_normal);
  }
  out.particles = static_cast<std::uint32_t>(found.simulations);
  out.mixture.dimension = static_cast<std::uint32_t>(out.params.size());
  out.mixture.weight = {1.0};
  out.mixture.mean = found.mean;
  out.mixture.covariance = found.covariance;
  return out;
}

StoredPosterior of_result(const RobotFile& robot, const MethodResult& found) {
  StoredPosterior out = found.gaussian
                            ? of_gaussian(robot, found)
                            : store_posterior(robot.config, robot.names.params,
                                              {resample(found.params, found.weight, robot.config.param_count), {}});
  out.effective_samples = found.effective_samples;
  out.noise_scale = out.exponent = 1.0;  // the methods know of neither
  return out;
}

void take_moments(const RobotFile& robot, const MethodResult& found, RefittedPrior& out) {
  MethodIteration all;
  weighted_moments(found.params, found.weight, robot.config.param_count, all);
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    if (robot.config.priors[i].kind == tiller_prior_fixed) continue;
    out.mean.push_back(all.mean[i]);
    out.sd.push_back(all.sd[i]);
  }
}

/// One nat takes three quarters off the deviation of a normal in one dimension, half off each in three, and 30 % off
/// each in ten: so the bound goes by their number.
double learnt_count(const tiller_config_t& config) {
  double count = 0;
  for (std::uint32_t i = 0; i < config.param_count; ++i) count += config.priors[i].kind != tiller_prior_fixed ? 1 : 0;
  return count;
}

std::string note_of(const std::string& method, const MethodResult& found) {
  const MethodIteration& last = found.history.back();
  std::string text = method == "reps" ? format("mean log likelihood %.6g", -last.discrepancy)
                                      : format("discrepancy %.4g", last.discrepancy);
  text += format(", divergence %.3g", last.kl);
  if (found.diverged > 0)
    text += format(", %llu of %llu simulations diverged", static_cast<unsigned long long>(found.diverged),
                   static_cast<unsigned long long>(found.simulations));
  return text + few_draws(method, found.effective_samples, found.simulations);
}

}  // namespace

Words refit_methods() { return {"simopt", "trajectory_simopt", "reps"}; }

bool check_refit(const RefitOptions& options, const RobotFile& robot, std::string& error) {
  if (is_one_step(options.method) && refuse_hidden_states(robot.config, error)) {
    error = robot.path + ": --method " + options.method + ": " + error;
    return false;
  }
  return can_be_fitted(robot.config, error) && laboratory_is_ready(error);
}

RefitPrior make_refit(const RefitOptions& options) {
  return [options](const RobotFile& robot, const Log& log, RefittedPrior& out, std::string& error) {
    const std::vector<Grid> grids = make_grids(log, LogMap(), robot.config);
    MethodProblem problem;
    problem.config = &robot.config;
    problem.params = robot.names.params;
    problem.grids = &grids;
    problem.options = options.how;
    if (std::isnan(problem.options.kl)) problem.options.kl = learnt_count(robot.config);
    MethodResult found;
    if (!run_in_laboratory(options.method, problem, found, error)) {
      error = options.method + ": " + error;
      return false;
    }
    out = {};
    out.posterior = of_result(robot, found);
    take_moments(robot, found, out);
    out.note = note_of(options.method, found);
    return true;
  };
}

}  // namespace tiller::tools
