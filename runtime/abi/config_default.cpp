#include <algorithm>
#include <cmath>
#include <limits>

#include "abi/checks.hpp"

namespace tiller {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// A prior that tiller_init refuses: a parameter that nobody has said anything about must not get a number
/// from us.
constexpr tiller_prior_t kMissingPrior = {tiller_prior_fixed, 0, kNan, 0.0, -kInf, kInf};

/// Encoders: the positions of the joints; for a model of velocity ports alone, every state.
void measure_positions(tiller_config_t& c) {
  const tiller_model_t& model = *c.model;
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position != TILLER_NO_POSITION)
      c.measured_state[c.measurement_count++] = model.joints[j].position;
  if (c.measurement_count > 0) return;
  for (std::uint32_t x = 0; x < model.state_count; ++x)
    c.measured_state[c.measurement_count++] = static_cast<std::uint8_t>(x);
}

/// What a model leaves out are forces, so its velocities wander and its positions follow.
void spread_noise(tiller_config_t& c) {
  const tiller_model_t& model = *c.model;
  std::fill(c.measurement_sd, c.measurement_sd + TILLER_MAX_MEASUREMENTS, 1e-3);
  std::fill(c.initial_state_sd, c.initial_state_sd + TILLER_MAX_STATES, 0.1);
  for (std::uint32_t j = 0; j < model.joint_count; ++j) c.process_sd[model.joints[j].velocity] = 0.01;
  if (model.joint_count == 0) std::fill(c.process_sd, c.process_sd + model.state_count, 0.01);
}

tiller_posterior_config_t default_posterior() {
  tiller_posterior_config_t p = {};
  p.enabled = 1;
  p.particles = 256;
  p.window = 64;
  p.moves_per_tick = 32;
  p.ess_fraction = 0.5;
  p.noise_scale_shape = 10.0;  // worth twenty measured values: soon told by the data
  p.kind = tiller_posterior_filter;
  p.robust = 1;
  p.discrepancy = 0;
  p.delay_hypotheses = 1;
  p.forgetting_count = 1;
  for (double& rate : p.forgetting) rate = 1.0;
  p.adequacy = 1;
  p.scout_share = 0.0;
  p.noise_ratio_sd = 0.75;  // a factor of two either way, and of 4.5 at the most
  p.relearn = 1;
  return p;
}

tiller_planner_config_t default_planner() {
  tiller_planner_config_t p = {};
  p.kind = tiller_planner_mppi;
  p.horizon = 50;
  p.knots = 10;
  p.rollouts = 256;
  p.particles = 8;
  p.iterations = 2;
  p.risk = tiller_risk_mean;
  p.cvar_alpha = 0.9;
  std::fill(p.noise_sd, p.noise_sd + TILLER_MAX_INPUTS, 1.0);
  p.temperature = 0.05;
  p.elite_fraction = 0.1;
  p.smoothing = 0.1;
  p.filter = 1.0;
  p.shooting = tiller_shooting_multiple;
  p.qp_solver = tiller_qp_riccati;
  p.qp_iterations = 50;
  p.refine_iterations = 2;
  p.qp_tolerance = 1e-6;
  p.regularisation = 1e-9;
  p.levels = 5;
  p.nodes = 1024;
  p.hold_steps = 5;
  p.exploration = 0.5;
  return p;
}

void set_cost(tiller_cost_config_t& c) {
  std::fill(c.saturating_width, c.saturating_width + TILLER_MAX_STATES, kInf);
  std::fill(c.state_low, c.state_low + TILLER_MAX_STATES, -kInf);
  std::fill(c.state_high, c.state_high + TILLER_MAX_STATES, kInf);
}

void set_safety(tiller_safety_config_t& s) {
  std::fill(s.input_rate_per_s, s.input_rate_per_s + TILLER_MAX_INPUTS, kInf);
  std::fill(s.measurement_low, s.measurement_low + TILLER_MAX_MEASUREMENTS, -kInf);
  std::fill(s.measurement_high, s.measurement_high + TILLER_MAX_MEASUREMENTS, kInf);
  std::fill(s.measurement_rate_per_s, s.measurement_rate_per_s + TILLER_MAX_MEASUREMENTS, kInf);
  s.sensor_timeout_s = 0.1;  // five default periods
  s.frozen_ticks = 25;       // half a second of default periods
  s.bad_ticks_to_safe = 5;
  s.hold_ticks_to_safe = 100;  // two seconds of default periods
}

}  // namespace
}  // namespace tiller

extern "C" tiller_status_t tiller_config_default(tiller_config_t* config, const tiller_model_t* model) {
  if (config == nullptr) return tiller_status_null_argument;
  if (model == nullptr) {  // so that a caller who does not look at this status is told the same later
    *config = {};
    config->size = sizeof(tiller_config_t);
    config->version = TILLER_CONFIG_VERSION;
    return tiller_status_no_model;
  }
  const tiller::Finding finding = tiller::check_model(*model);
  if (finding.status != tiller_status_ok) return finding.status;

  tiller_config_t c = {};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = model;
  c.seed = 1;
  c.period_s = 0.02;
  c.substeps = 1;
  c.integrator = tiller_integrator_rk4;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.param_count = model->param_count;
  std::fill(c.priors, c.priors + TILLER_MAX_PARAMS, tiller::kMissingPrior);
  tiller::measure_positions(c);
  tiller::spread_noise(c);
  c.posterior = tiller::default_posterior();
  c.planner = tiller::default_planner();
  tiller::set_cost(c.cost);
  tiller::set_safety(c.safety);
  *config = c;
  return tiller_status_ok;
}
