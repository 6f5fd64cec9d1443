#pragma once

// Data with a known gap: a built-in model integrated by RK4 at half a millisecond (not the runtime's stepper), with a
// force of its own at one joint and commands that are changed on their way.

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "core/rng.hpp"
#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

struct Synthetic {
  const tiller_model_t* model = tiller_find_model("pendulum");
  std::vector<double> params = {0.5, 0.4, 0.0};
  double period_s = 0.01;
  double seconds = 8, noise_sd = 2e-3;
  double process_sd = 0;    // of the rate, per square root of a second
  double encoder_step = 0;  // of positions
  bool rates = false;       // rates are measured as well, with 20 times the noise
  double amplitude = 1.5;   // of the input
  double mean = 0;          // of the input
  std::uint32_t joint = 0;
  std::function<double(double q, double v, double u, double t)> force;  // at `joint`; empty: none
  std::function<double(double u)> actuator;                             // empty: as commanded
  double lag_s = 0, rate_limit = 0;  // of the drive, in the place of `actuator` and `delay_s`; 0: none
  double delay_s = 0;
  std::uint32_t delayed = ~0u;                           // the inputs that are, bit by bit
  double rotor_inertia = 0, stiffness = 0, damping = 0;  // of a rotor that turns input 0's joint by a spring; 0: none
  double payload_kg = 0;
  std::uint32_t late_state = ~0u;  // whose reading is `late_s` old; none
  double late_s = 0;
  double accelerometer_sd = 0;  // of one at the first joint, from period to period; 0: none
  bool continuous = false;      // the input moves within a period: what a log has is its value at the row
};

/// Joints' positions measured (rates too if asked for), of every built-in model.
inline tiller::Config synthetic_config(const Synthetic& s) {
  tiller::Config config;
  tiller_config_default(&config, s.model);
  config.period_s = s.period_s;
  config.measurement_count = 0;
  const auto measure = [&](std::uint8_t state, double sd) {
    config.measured_state[config.measurement_count] = state;
    config.measurement_sd[config.measurement_count++] = sd;
  };
  for (std::uint32_t j = 0; j < s.model->joint_count; ++j) measure(s.model->joints[j].position, s.noise_sd);
  for (std::uint32_t j = 0; s.rates && j < s.model->joint_count; ++j)
    measure(s.model->joints[j].velocity, 20 * s.noise_sd);
  for (std::uint32_t i = 0; i < s.model->input_count; ++i) {
    config.safety.input_low[i] = -4 * s.amplitude;
    config.safety.input_high[i] = 4 * s.amplitude;
  }
  config.param_count = s.model->param_count;
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    config.priors[i] = {tiller_prior_fixed, 0, s.params[i], 0, s.params[i], s.params[i]};
  return config;
}

/// A multisine, held over each period.
inline double multisine(double t, std::uint64_t seed) {
  Rng rng(seed, 100, 7);
  double u = 0;
  for (int i = 0; i < 6; ++i) {
    const double hertz = 0.2 + 2.3 * rng.uniform(), phase = 6.283185307179586 * rng.uniform();
    u += std::sin(6.283185307179586 * hertz * t + phase);
  }
  return u / 2.5;
}

inline Grid simulate(const Synthetic& s, std::uint64_t seed) {
  const tiller_model_t& model = *s.model;
  Rng rng(seed, 101, 3);
  Grid grid;
  grid.path = "run" + std::to_string(seed) + ".csv";
  grid.period_s = s.period_s;
  grid.state.resize(model.state_count);
  grid.input.resize(model.input_count);
  const auto points = static_cast<std::size_t>(s.seconds / s.period_s);
  const tiller_body_t body = {0, -9.81, s.payload_kg, 0};
  // behind the model's states the spring's twist and the rotor's velocity
  const std::size_t twist = model.state_count, rotor = twist + 1;
  std::vector<double> x(s.rotor_inertia > 0 ? rotor + 1 : twist, 0.0);
  if (std::string(model.name) == "cart_pole") x[1] = 3.14159;  // hangs
  const int fine = static_cast<int>(std::lround(s.period_s / 0.0005));
  const double h = s.period_s / fine;
  const auto command = [&](std::uint32_t input, double t) {
    const double at = s.continuous ? t : std::floor(t / s.period_s + 1e-9) * s.period_s;
    return s.mean + s.amplitude * multisine(at, seed + 7919 * std::uint64_t{input});
  };
  double acting[TILLER_MAX_INPUTS] = {};  // of drives that follow; at rest at first
  const auto follow = [&](double t) {     // over half a step: a step has the force of its middle
    for (std::uint32_t i = 0; i < model.input_count; ++i) {
      const double ahead = command(i, t) - acting[i], most = 0.5 * h * s.rate_limit;
      if (s.lag_s > 0) acting[i] -= std::expm1(-0.5 * h / s.lag_s) * ahead;
      if (s.rate_limit > 0) acting[i] += std::clamp(ahead, -most, most);
    }
  };
  const tiller_joint_t& joint = model.joints[s.joint];
  const auto slope = [&](const std::vector<double>& at, double t, std::vector<double>& dx) {
    double u[TILLER_MAX_INPUTS] = {}, f[TILLER_MAX_JOINTS] = {};
    for (std::uint32_t i = 0; i < model.input_count; ++i) {
      const double late = s.delayed >> i & 1u ? s.delay_s : 0.0;
      const double commanded = t < late ? 0.0 : command(i, t - late);
      u[i] = s.lag_s > 0 || s.rate_limit > 0 ? acting[i] : s.actuator ? s.actuator(commanded) : commanded;
    }
    if (s.rotor_inertia > 0) {
      dx[twist] = at[rotor] - at[joint.velocity];
      const double spring = s.stiffness * at[twist] + s.damping * dx[twist];
      dx[rotor] = (u[0] - spring) / s.rotor_inertia;
      u[0] = spring;
    }
    if (s.force) f[joint.force] = s.force(at[joint.position], at[joint.velocity], u[0], t);
    model.dynamics(at.data(), u, f, &body, s.params.data(), dx.data());
  };
  std::vector<double> k1(x.size()), k2(x.size()), k3(x.size()), k4(x.size()), at(x.size());
  std::vector<double> past;  // of the late state, every step
  const std::uint32_t measured_rate = model.joints[0].velocity;
  double rate_before = NAN;
  if (s.accelerometer_sd > 0)
    grid.sensor.push_back({{"accelerometer", model.state_names[measured_rate], 1, s.accelerometer_sd}, {}});
  for (std::size_t p = 0; p < points; ++p) {
    for (std::uint32_t i = 0; i < model.state_count; ++i) {
      bool rate = false;
      for (std::uint32_t j = 0; j < model.joint_count; ++j) rate = rate || model.joints[j].velocity == i;
      double value = x[i] + (rate ? 20 : 1) * s.noise_sd * rng.normal();
      if (i == s.late_state && !past.empty()) {
        const auto back = static_cast<std::size_t>(std::lround(s.late_s / h));
        value += past[past.size() - std::min(back, past.size())] - x[i];
      }
      if (!rate && s.encoder_step > 0) value = std::round(x[i] / s.encoder_step) * s.encoder_step;
      grid.state[i].push_back(rate && !s.rates ? NAN : value);
    }
    if (s.accelerometer_sd > 0) {
      grid.sensor[0].value.push_back((x[measured_rate] - rate_before) / s.period_s + s.accelerometer_sd * rng.normal());
      rate_before = x[measured_rate];
    }
    const double start = static_cast<double>(p) * s.period_s;
    for (std::uint32_t i = 0; i < model.input_count; ++i) grid.input[i].push_back(command(i, start));
    for (int n = 0; n < fine; ++n) {
      if (s.late_state < model.state_count) past.push_back(x[s.late_state]);
      const double t = start + n * h + 1e-7;  // the command of this period, not of the one before
      follow(t);
      slope(x, t, k1);
      for (std::size_t i = 0; i < x.size(); ++i) at[i] = x[i] + 0.5 * h * k1[i];
      slope(at, t + 0.5 * h, k2);
      for (std::size_t i = 0; i < x.size(); ++i) at[i] = x[i] + 0.5 * h * k2[i];
      slope(at, t + 0.5 * h, k3);
      for (std::size_t i = 0; i < x.size(); ++i) at[i] = x[i] + h * k3[i];
      slope(at, t + 0.99 * h, k4);
      for (std::size_t i = 0; i < x.size(); ++i) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
      follow(t);
    }
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      x[model.joints[j].velocity] += s.process_sd * std::sqrt(s.period_s) * rng.normal();
  }
  return grid;
}

inline std::vector<Grid> simulate_logs(const Synthetic& s, int logs, std::uint64_t seed) {
  std::vector<Grid> grids;
  for (int i = 0; i < logs; ++i) grids.push_back(simulate(s, 100 * seed + static_cast<std::uint64_t>(i)));
  return grids;
}

}  // namespace tiller::tools::gap
