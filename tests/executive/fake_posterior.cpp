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
namespace {

using fakes::posterior;

class Obedient final : public Posterior {
 public:
  Obedient() = default;
  void bind(const tiller_config_t& config, const StepSetup& setup, AdequacyTest* adequacy) {
    config_ = &config;
    adequacy_ = adequacy;
    adequacy_->reset();
    setup_ = setup;
  }
  void reset() override {}
  const AdequacyTest* adequacy() const override { return posterior.tested ? adequacy_ : nullptr; }
  void clear_adequacy() override { adequacy_->reset(); }
  tiller_status_t start(const double* measured) override {
    ++posterior.starts;
    take(measured);
    return posterior.start_status;
  }
  tiller_status_t update(const Transition& transition) override {
    posterior.transitions.push_back(transition);
    take(transition.measured);
    Innovation innovation;
    for (double& value : innovation.normalised) value = 4.0;
    if (posterior.tested) adequacy_->take(innovation);
    return posterior.update_status;
  }
  tiller_status_t skip(const Transition& transition) override {
    posterior.skipped.push_back(transition);
    return posterior.skip_status;
  }
  bool started() const override { return posterior.starts > 0; }
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const override {
    const std::uint32_t np = config_->param_count, nx = config_->model->state_count;
    if (param_mean) std::copy(posterior.param, posterior.param + np, param_mean);
    if (param_sd) std::fill(param_sd, param_sd + np, posterior.param_sd);
    if (state_mean) std::copy(posterior.state, posterior.state + nx, state_mean);
    if (state_sd) std::fill(state_sd, state_sd + nx, posterior.state_sd);
  }
  void covariance(double*) const override {}
  double quantile(std::uint32_t, double) const override { return 0.0; }
  double effective_samples() const override { return 0.0; }
  double exponent() const override { return 0.0; }
  double noise_scale() const override { return 1.0; }
  double acceptance() const override { return 0.0; }
  std::uint64_t resamplings() const override { return 0; }
  std::uint64_t gated() const override { return 0; }
  std::uint32_t size() const override { return 0; }
  void particle(std::uint32_t, double*, double*, double*) const override {}
  void draw(std::uint32_t count, std::uint64_t, float* params, float* state, float* effect_state,
            float*) const override {
    for (std::uint32_t p = 0; params && p < config_->param_count; ++p)
      for (std::uint32_t i = 0; i < count; ++i)
        params[p * count + i] = static_cast<float>(posterior.param[p]) + posterior.param_step * static_cast<float>(i);
    for (std::uint32_t x = 0; state && x < config_->model->state_count; ++x)
      for (std::uint32_t i = 0; i < count; ++i)
        state[x * count + i] = static_cast<float>(posterior.state[x] - origin()[x]);
    if (effect_state) std::fill(effect_state, effect_state + std::size_t{setup_.effect_state_count} * count, 0.0f);
  }
  Friction friction() const override {
    Friction sure;
    std::fill(sure.viscous, sure.viscous + config_->model->joint_count, posterior.viscous);
    std::fill(sure.dry, sure.dry + config_->model->joint_count, posterior.dry);
    return sure;
  }
  Fading forces(double, double* mean, double* sd, double* imaginary) const override {
    const bool slips = slip_states(*config_) != 0;
    const std::uint32_t count = slips ? config_->model->state_count : config_->model->joint_count;
    if (mean) std::copy(posterior.force, posterior.force + count, mean);
    if (sd) std::fill(sd, sd + count, posterior.force_sd);
    if (imaginary) std::fill(imaginary, imaginary + count, slips ? 0.0 : posterior.force_imaginary);
    return {0.5, slips ? 0.0 : 1.5};
  }
  double drawn_delay(std::uint32_t column) const override {
    return column < posterior.delay.size() ? posterior.delay[column] : 0.0;
  }

 private:
  void take(const double* measured) {
    for (std::uint32_t i = 0; i < config_->measurement_count; ++i)
      posterior.state[config_->measured_state[i]] = measured[i];
  }
  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  AdequacyTest* adequacy_ = nullptr;
};

}  // namespace

Posterior* Posterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable&,
                              const tiller_hooks_t*) {
  Obedient* self = arena.take<Obedient>(1);
  AdequacyTest* adequacy = AdequacyTest::lay_out(arena, config, false);
  if (arena.measuring()) return nullptr;
  self->bind(config, setup, adequacy);
  return self;
}

std::uint32_t Posterior::force_joints(const tiller_config_t& config) {
  return config.posterior.disturbance ? config.model->joint_count : 0;
}

/// All states slip where there are no joints.
std::uint32_t Posterior::slip_states(const tiller_config_t& config) {
  return config.posterior.disturbance && config.model->joint_count == 0 ? (1u << config.model->state_count) - 1u : 0;
}

tiller_status_t Posterior::check(const tiller_config_t&, const StepSetup&, const RolloutTable&, const char**) {
  return tiller_status_ok;
}

}  // namespace tiller
