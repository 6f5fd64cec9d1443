#include "tools/smooth/forced_step.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {
namespace {

std::uint32_t padded(std::uint32_t lanes) { return (lanes + kLanePadding - 1) / kLanePadding * kLanePadding; }

}  // namespace

bool with_forces(const tiller_config_t& config, Config& out, std::string& error) {
  const std::uint32_t nf = config.model->joint_count;
  if (config.effect_count + nf > TILLER_MAX_EFFECTS || config.param_count + nf > TILLER_MAX_PARAMS) {
    error = "no room for " + std::to_string(nf) + " forces beside the robot's " + std::to_string(config.effect_count) +
            " effects and " + std::to_string(config.param_count) + " parameters";
    return false;
  }
  out = config;
  for (std::uint32_t j = 0; j < nf; ++j) {
    out.effects[out.effect_count++] = {tiller_effect_constant_offset, j};
    out.priors[out.param_count++] = {tiller_prior_fixed, 0, 0.0, 0.0, -HUGE_VAL, HUGE_VAL};
  }
  out.prior_mixture = nullptr;
  return true;
}

ForcedStep::ForcedStep(const tiller_config_t& config, const std::vector<double>& params,
                       const Eigen::VectorXd& force_step)
    : nx_(config.model->state_count),
      nf_(static_cast<std::uint32_t>(force_step.size())),
      np_(static_cast<std::uint32_t>(params.size())),
      model_(*config.model),
      rollout_(config, padded(1 + 2 * (nx_ + nf_))),
      force_step_(force_step) {
  const std::uint32_t lanes = rollout_.lanes();
  for (std::uint32_t p = 0; p < np_; ++p) std::fill_n(rollout_.params() + p * lanes, lanes, params[p]);
  state_.resize(std::size_t{nx_} * lanes);
  next_.resize(std::size_t{nx_} * lanes);
  effect_.resize(std::size_t{rollout_.setup().effect_state_count + 1} * lanes);
  effect_next_ = effect_;
}

void ForcedStep::begin(const Grid& grid, std::size_t point) {
  const std::vector<double> first = rollout_.first_effect_state(grid, point);
  const std::uint32_t lanes = rollout_.lanes();
  for (std::size_t s = 0; s < rollout_.setup().effect_state_count; ++s)
    std::fill_n(&effect_[s * lanes], lanes, first[s]);
}

bool ForcedStep::run(const Grid& grid, std::size_t point, const Eigen::VectorXd& z, Eigen::VectorXd& next,
                     Eigen::MatrixXd& slope) {
  const std::uint32_t lanes = rollout_.lanes(), n = nx_ + nf_;
  for (std::uint32_t i = 0; i < n; ++i) {
    double* const row = i < nx_ ? &state_[std::size_t{i} * lanes] : rollout_.params() + (np_ + i - nx_) * lanes;
    std::fill_n(row, lanes, z(i));
    row[1 + 2 * i] += step_of(i, z(i));
    row[2 + 2 * i] -= step_of(i, z(i));
  }
  RolloutJob<double> job = rollout_.job(grid, point, 1);
  job.state = {state_.data(), lanes};
  job.effect_state = {effect_.data(), lanes};
  job.final_state = next_.data();
  job.final_effect_state = effect_next_.data();
  select_rollout(model_).rollout_f64(model_, job);
  next.resize(nx_);
  slope.resize(nx_, n);
  for (std::uint32_t r = 0; r < nx_; ++r) {
    const double* const row = &next_[std::size_t{r} * lanes];
    next(r) = row[0];
    for (std::uint32_t c = 0; c < n; ++c)
      slope(r, c) = state_difference(model_, r, row[1 + 2 * c], row[2 + 2 * c]) / (2.0 * step_of(c, z(c)));
  }
  for (std::size_t s = 0; s < rollout_.setup().effect_state_count; ++s)
    std::fill_n(&effect_[s * lanes], lanes, effect_next_[s * lanes]);
  return next.allFinite() && slope.allFinite();
}

double ForcedStep::step_of(std::uint32_t i, double value) const {
  return i < nx_ ? 1e-5 * (1.0 + std::fabs(value)) : force_step_(i - nx_);
}

}  // namespace tiller::tools
