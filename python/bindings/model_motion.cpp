#include "model_motion.hpp"

#include <algorithm>

namespace tiller::python {

ModelMotion::ModelMotion(const tiller_config_t& config, const StepSetup& setup, std::vector<double> params)
    : config_(config), setup_(setup), table_(select_rollout(*config.model)), params_(std::move(params)) {
  state_.resize(config.model->state_count);
  effect_state_.resize(std::max(1u, setup.effect_state_count));
  next_.resize(state_.size() * kLanePadding);
  next_effects_.resize(effect_state_.size() * kLanePadding);
}

void ModelMotion::start(const double* state) {
  std::copy(state, state + state_.size(), state_.begin());
  std::fill(effect_state_.begin(), effect_state_.end(), 0.0);
}

void ModelMotion::move(const double* off) { add_differences(*config_.model, state_.data(), off, state_.data()); }

void ModelMotion::step(const double* command) {
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = kLanePadding;
  job.horizon = 1;
  job.state.data = state_.data();
  job.params.data = params_.data();
  job.effect_state.data = effect_state_.data();
  job.controls.data = command;
  job.final_state = next_.data();
  job.final_effect_state = setup_.effect_state_count > 0 ? next_effects_.data() : nullptr;
  table_.rollout_f64(*config_.model, job);
  for (std::size_t i = 0; i < state_.size(); ++i) state_[i] = next_[i * kLanePadding];
  for (std::uint32_t i = 0; i < setup_.effect_state_count; ++i) effect_state_[i] = next_effects_[i * kLanePadding];
}

}  // namespace tiller::python
