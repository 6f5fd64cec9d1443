#include <algorithm>
#include <cmath>

#include "fakes.hpp"

namespace fakes {
Posterior posterior;
void reset() {
  planner = Planner();
  posterior = Posterior();
  std::fill(posterior.param, posterior.param + TILLER_MAX_PARAMS, 0.5);
}
}  // namespace fakes

namespace tiller {

using fakes::posterior;

Posterior* Posterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable&,
                              const tiller_hooks_t*) {
  Posterior* self = arena.take<Posterior>(1);
  if (arena.measuring()) return nullptr;
  self->config_ = &config;
  self->setup_ = setup;
  return self;
}

void Posterior::reset() {}

tiller_status_t Posterior::start(const double* measured) {
  ++posterior.starts;
  for (std::uint32_t i = 0; i < config_->measurement_count; ++i)
    posterior.state[config_->measured_state[i]] = measured[i];
  return posterior.start_status;
}

tiller_status_t Posterior::update(const Transition& transition) {
  posterior.transitions.push_back(transition);
  for (std::uint32_t i = 0; i < config_->measurement_count; ++i)
    posterior.state[config_->measured_state[i]] = transition.measured[i];
  return posterior.update_status;
}

void Posterior::moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const {
  const std::uint32_t np = config_->param_count, nx = config_->model->state_count;
  if (param_mean) std::copy(posterior.param, posterior.param + np, param_mean);
  if (param_sd) std::fill(param_sd, param_sd + np, 0.0);
  if (state_mean) std::copy(posterior.state, posterior.state + nx, state_mean);
  if (state_sd) std::fill(state_sd, state_sd + nx, posterior.state_sd);
}
void Posterior::covariance(double*) const {}
double Posterior::quantile(std::uint32_t, double) const { return 0.0; }
void Posterior::particle(std::uint32_t, double*, double*, double*) const {}

void Posterior::draw(std::uint32_t count, std::uint64_t, float* params, float* state, float* effect_state,
                     float*) const {
  for (std::uint32_t p = 0; params && p < config_->param_count; ++p)
    for (std::uint32_t i = 0; i < count; ++i)
      params[p * count + i] = static_cast<float>(posterior.param[p]) + posterior.param_step * static_cast<float>(i);
  for (std::uint32_t x = 0; state && x < config_->model->state_count; ++x)
    for (std::uint32_t i = 0; i < count; ++i) state[x * count + i] = static_cast<float>(posterior.state[x]);
  if (effect_state) std::fill(effect_state, effect_state + std::size_t{setup_.effect_state_count} * count, 0.0f);
}

}  // namespace tiller
