#include "tools/links/trial_plant.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {

double centre_of(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : prior.a;
}

TrialPlant::TrialPlant(const tiller_config_t& config, std::uint32_t substeps) : config_(config) {
  good_ = make_step_setup(config, setup_) == tiller_status_ok;
  setup_.substeps = substeps;
  for (std::uint32_t i = 0; i < config.param_count; ++i) params_.push_back(centre_of(config.priors[i]));
  state_.assign(config.initial_state, config.initial_state + config.model->state_count);
  path_.begin(config, state_.data());
  effect_state_.resize(std::max(1u, setup_.effect_state_count));
  history_.resize(std::size_t{setup_.delay_steps + 1} * config.model->input_count);
}

void TrialPlant::step(const double* command) {
  constexpr std::uint32_t lanes = kLanePadding;
  std::vector<double> next(state_.size() * lanes), next_effects(effect_state_.size() * lanes);
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = lanes;
  job.horizon = 1;
  job.state = {state_.data(), 0};
  job.params = {params_.data(), 0};
  job.effect_state = {effect_state_.data(), 0};
  job.controls = {command, 0};
  job.history = history_.data();
  job.final_state = next.data();
  job.final_effect_state = next_effects.data();
  select_rollout(*config_.model).rollout_f64(*config_.model, job);
  for (std::size_t i = 0; i < state_.size(); ++i) state_[i] = next[i * lanes];
  path_.push(state_.data());
  for (std::uint32_t i = 0; i < setup_.effect_state_count; ++i) effect_state_[i] = next_effects[i * lanes];
  const std::uint32_t nu = config_.model->input_count;
  std::rotate(history_.begin(), history_.end() - nu, history_.end());
  std::copy(command, command + nu, history_.begin());
}

tiller_measurement_t TrialPlant::measure(std::uint32_t tick) const {
  tiller_measurement_t m = {};
  m.stamp_us = 1000000 + std::llround(tick * config_.period_s * 1e6);
  m.sequence = tick + 1;
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k) m.value[k] = path_.reading(config_, params_.data(), k);
  return m;
}

}  // namespace tiller::tools
