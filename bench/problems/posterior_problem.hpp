#pragma once

// The posterior by itself, on a cart-pole with encoders only: RK4, viscous friction, three parameters.

#include <cmath>
#include <cstdlib>
#include <memory>
#include <vector>

#include "core/rng.hpp"
#include "posterior/posterior.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

constexpr int kPosteriorTicks = 3000;

inline tiller::Config cart_pole_posterior() {
  tiller::Config c{};
  c.model = tiller_find_model("cart_pole");
  c.seed = 1;
  c.period_s = 0.02;
  c.substeps = 1;
  c.integrator = tiller_integrator_rk4;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.effect_count = 1;
  c.effects[0] = {tiller_effect_viscous_friction, 0};
  c.param_count = 4;
  c.priors[0] = {tiller_prior_fixed, 0, 1.0, 0.0, 0.0, 0.0};
  c.priors[1] = {tiller_prior_uniform, 0, 0, 0, 0.05, 0.15};
  c.priors[2] = {tiller_prior_uniform, 0, 0, 0, 0.25, 0.75};
  c.priors[3] = {tiller_prior_uniform, 0, 0, 0, 0.1, 0.3};
  c.measurement_count = 2;
  c.measured_state[1] = 1;
  c.measurement_sd[0] = 0.0005;
  c.measurement_sd[1] = 0.002;
  c.process_sd[2] = 0.03;
  c.process_sd[3] = 0.06;
  c.initial_state[1] = 3.14159265;
  for (double& sd : c.initial_state_sd) sd = 0.01;
  c.posterior.enabled = 1;
  c.posterior.ess_fraction = 0.5;
  c.posterior.noise_scale_shape = 5.0;
  return c;
}

/// Encoder readings of a cart-pole under random forces, from the kernel's double rollout.
inline std::vector<Transition> simulate(const tiller_config_t& c) {
  StepSetup setup;
  if (make_step_setup(c, setup) != tiller_status_ok) std::abort();
  const double params[4] = {1.0, 0.1, 0.5, 0.2};
  double x[4] = {0.0, 3.14159265, 0.0, 0.0}, push = 0.0;
  std::vector<double> out(4 * kLanePadding);
  std::vector<Transition> log(kPosteriorTicks);
  Rng rng(1, kRngSelect, 0);
  for (int k = 0; k < kPosteriorTicks; ++k) {
    if (k % 8 == 0) push = 24.0 * rng.uniform() - 12.0 - 4.0 * x[0];
    RolloutJob<double> job;
    job.setup = &setup;
    job.lanes = kLanePadding;
    job.horizon = 1;
    job.state = {x, 0};
    job.params = {params, 0};
    job.controls = {&push, 0};
    job.final_state = out.data();
    select_rollout(*c.model).rollout_f64(*c.model, job);
    for (int i = 0; i < 4; ++i) x[i] = out[i * kLanePadding] + 0.14 * c.process_sd[i] * rng.normal();
    log[k].period_s = c.period_s;
    log[k].input[0] = push;
    for (int i = 0; i < 2; ++i) log[k].measured[i] = x[i] + c.measurement_sd[i] * rng.normal();
  }
  return log;
}

/// A posterior in a block of its own, warmed up until its window is full.
class PosteriorSubject {
 public:
  PosteriorSubject(std::uint32_t particles, std::uint32_t window, std::uint32_t moves,
                   const tiller_hooks_t* hooks = nullptr)
      : config_(cart_pole_posterior()) {
    config_.posterior.particles = particles;
    config_.posterior.window = window;
    config_.posterior.moves_per_tick = moves;
    if (make_step_setup(config_, setup_) != tiller_status_ok) std::abort();
    const RolloutTable& table = select_rollout(*config_.model);
    Arena measure;
    Posterior::lay_out(measure, config_, setup_, table, hooks);
    bytes_ = measure.used();
    memory_.reset(std::aligned_alloc(TILLER_ALIGNMENT, bytes_));
    Arena arena(memory_.get(), bytes_);
    posterior_ = Posterior::lay_out(arena, config_, setup_, table, hooks);
    log_ = simulate(config_);
  }
  void warm_up() {
    posterior_->reset();
    if (posterior_->start(log_[0].measured) != tiller_status_ok) std::abort();
    for (next_ = 1; next_ < config_.posterior.window + 300; ++next_) (void)posterior_->update(log_[next_]);
  }
  bool at_end() const { return next_ >= log_.size(); }
  void update() { (void)posterior_->update(log_[next_++]); }
  std::size_t bytes() const { return bytes_; }
  double filtered() const {
    const tiller_posterior_config_t& c = config_.posterior;
    return c.particles + 2.0 * c.moves_per_tick * (c.window + 1);
  }

 private:
  struct Free {
    void operator()(void* p) const { std::free(p); }
  };
  tiller::Config config_;
  StepSetup setup_;
  std::vector<Transition> log_;
  std::unique_ptr<void, Free> memory_;
  Posterior* posterior_ = nullptr;
  std::size_t bytes_ = 0, next_ = 0;
};

}  // namespace tiller::bench
