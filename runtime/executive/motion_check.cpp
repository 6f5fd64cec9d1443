#include "executive/motion_check.hpp"

#include <algorithm>
#include <cmath>

namespace tiller {

void MotionCheck::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table) {
  const tiller_model_t& model = *config.model;
  config_ = &config;
  setup_ = &setup;
  table_ = &table;
  base_ = arena.take<double>(model.state_count);
  state_ = arena.take<double>(model.state_count);
  params_ = arena.take<double>(config.param_count);
  effect_state_ = arena.take<double>(setup.effect_state_count);
  final_state_ = arena.take<double>(std::size_t{model.state_count} * kLanePadding);
  final_effect_ = arena.take<double>(std::size_t{setup.effect_state_count} * kLanePadding);
}

void MotionCheck::begin(const double* state, const double* params, const float* effect_state) {
  const std::uint32_t nx = config_->model->state_count;
  std::copy(state, state + nx, base_);
  std::copy(state, state + nx, state_);
  std::copy(params, params + config_->param_count, params_);
  std::copy(effect_state, effect_state + setup_->effect_state_count, effect_state_);
  steps_ = 0;
  begun_ = true;
}

void MotionCheck::step(double period_s, const double* input, const double* history) {
  const tiller_model_t& model = *config_->model;
  RolloutJob<double> job;
  job.setup = setup_;
  job.lanes = kLanePadding;
  job.horizon = 1;
  job.period_s = period_s;
  job.state = {state_, 0};
  job.params = {params_, 0};
  job.effect_state = {effect_state_, 0};
  job.controls = {input, 0};
  job.history = history;
  job.final_state = final_state_;
  job.final_effect_state = setup_->effect_state_count > 0 ? final_effect_ : nullptr;
  table_->rollout_f64(model, job);
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    state_[i] = final_state_[std::size_t{i} * kLanePadding];
  for (std::uint32_t i = 0; i < setup_->effect_state_count; ++i)
    effect_state_[i] = final_effect_[std::size_t{i} * kLanePadding];
  ++steps_;
}

bool MotionCheck::should_move(std::uint32_t steps) const {
  if (!begun_ || steps_ < steps) return false;
  for (std::uint32_t i = 0; i < config_->measurement_count; ++i) {
    const std::uint32_t x = config_->measured_state[i];
    const double change = state_difference(*config_->model, x, state_[x], base_[x]);
    if (std::abs(change) > kDeviations * config_->measurement_sd[i]) return true;
  }
  return false;
}

}  // namespace tiller
