#pragma once

#include <cmath>
#include <iterator>
#include <memory>
#include <random>
#include <vector>

#include "linear_rig.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace rig {

/// The library's cart-pole with viscous friction at the cart; pole mass, half length and friction unknown, each
/// uniform within 50 % of its nominal value; encoders on position and angle, no rates.
inline tiller::Config cart_pole_config() {
  tiller::Config c{};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = tiller_find_model("cart_pole");
  c.seed = 1;
  c.period_s = 0.02;
  c.substeps = 1;
  c.integrator = tiller_integrator_rk4;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.effect_count = 1;
  c.effects[0] = {tiller_effect_viscous_friction, 0};
  c.param_count = 4;
  c.priors[0] = fixed(1.0);           // cart_mass_kg
  c.priors[1] = uniform(0.1, 0.3);    // pole_mass_kg
  c.priors[2] = uniform(0.15, 0.45);  // half_length_m
  c.priors[3] = uniform(0.25, 0.75);  // cart.damping_SI
  c.measurement_count = 2;
  c.measured_state[0] = 0;
  c.measured_state[1] = 1;
  c.measurement_sd[0] = 0.0005;
  c.measurement_sd[1] = 0.002;
  c.process_sd[0] = 1e-4;
  c.process_sd[1] = 1e-4;
  c.process_sd[2] = 0.01;
  c.process_sd[3] = 0.03;
  c.initial_state[1] = 3.141592653589793;
  c.initial_state_sd[0] = 0.02;
  c.initial_state_sd[1] = 0.05;
  c.initial_state_sd[2] = 0.02;
  c.initial_state_sd[3] = 0.05;
  c.posterior.enabled = 1;
  c.posterior.particles = 256;
  c.posterior.window = 256;
  c.posterior.moves_per_tick = 16;
  c.posterior.ess_fraction = 0.5;
  c.posterior.noise_scale_shape = 5.0;
  return c;
}

struct CartPoleLog {
  double params[TILLER_MAX_PARAMS];
  double first[2];
  std::vector<tiller::Transition> transitions;
  std::vector<double> last_state;
};

/// Ten fine steps a period by the kernel's double rollout, process noise between periods, random piecewise
/// constant forces strong enough to swing the pole, a soft return of the cart to the middle.
inline CartPoleLog simulate_cart_pole(const tiller_config_t& c, int steps, unsigned seed, double force_N = 12.0,
                                      std::uint32_t substeps = 1) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  std::uniform_real_distribution<double> u01;
  CartPoleLog log;
  log.params[0] = c.priors[0].a;
  for (std::uint32_t i = 1; i < c.param_count; ++i)
    log.params[i] = c.priors[i].low + u01(random) * (c.priors[i].high - c.priors[i].low);
  tiller::StepSetup setup;
  (void)tiller::make_step_setup(c, setup);
  setup.substeps = substeps;
  const tiller::RolloutTable& table = tiller::select_rollout(*c.model);
  const std::uint32_t lanes = tiller::kLanePadding;
  double x[4];
  for (int i = 0; i < 4; ++i) x[i] = c.initial_state[i] + c.initial_state_sd[i] * n(random);
  for (int k = 0; k < 2; ++k) log.first[k] = x[k] + c.measurement_sd[k] * n(random);
  double push = 0.0;
  std::vector<double> out(4 * lanes), effects(TILLER_MAX_EFFECT_STATES), effects_out(TILLER_MAX_EFFECT_STATES * lanes);
  double history[TILLER_MAX_DELAY_STEPS + 2] = {};
  for (int t = 0; t < steps; ++t) {
    if (t % 8 == 0) push = force_N * (2.0 * u01(random) - 1.0) - 4.0 * x[0];
    tiller::RolloutJob<double> job;
    job.setup = &setup;
    job.lanes = lanes;
    job.horizon = 1;
    job.period_s = c.period_s;
    job.state = {x, 0};
    job.params = {log.params, 0};
    job.effect_state = {effects.data(), 0};
    job.final_effect_state = effects_out.data();
    job.history = history;
    job.controls = {&push, 0};
    job.final_state = out.data();
    table.rollout_f64(*c.model, job);
    for (int i = 0; i < 4; ++i) x[i] = out[i * lanes] + std::sqrt(c.period_s) * c.process_sd[i] * n(random);
    for (std::uint32_t i = 0; i < setup.effect_state_count; ++i) effects[i] = effects_out[i * lanes];
    for (std::size_t i = std::size(history) - 1; i > 0; --i) history[i] = history[i - 1];
    history[0] = push;
    tiller::Transition transition;
    transition.period_s = c.period_s;
    transition.input[0] = push;
    for (int k = 0; k < 2; ++k) transition.measured[k] = x[k] + c.measurement_sd[k] * n(random);
    log.transitions.push_back(transition);
  }
  log.last_state.assign(x, x + 4);
  return log;
}

/// A posterior on the kernel's own table.
struct CartPole {
  explicit CartPole(const tiller_config_t& config, const tiller_hooks_t* hooks = nullptr) : c(config) {
    (void)tiller::make_step_setup(c, setup);
    instance = std::make_unique<Instance>(c, hooks, tiller::select_rollout(*c.model), &setup);
  }
  tiller::Posterior* operator->() { return &**instance; }
  tiller::Config c;
  tiller::StepSetup setup;
  std::unique_ptr<Instance> instance;
};

}  // namespace rig
