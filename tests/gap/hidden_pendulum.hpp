#pragma once

// A pendulum with physics that no entry of the catalogue is, and its logs as the tools read them. An integrator of its
// own at a tenth of a millisecond; nothing of the runtime has a part in it.

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "tiller/config.hpp"
#include "tools/logs/identify_data.hpp"

namespace hidden {

using Torque = std::function<double(double angle, double rate)>;

inline double spring_q2(double angle, double) { return -1.2 * angle * std::fabs(angle); }
/// Dry friction that goes with the position: a rough and a smooth half of the surface.
inline double position_friction(double angle, double rate) {
  return -(0.25 + 0.2 * std::tanh(3.0 * angle)) * std::tanh(rate / 0.02);
}
inline double nothing(double, double) { return 0.0; }

struct Setup {
  double mass_kg = 0.5, length_m = 0.5, damping_Nms = 0.02;
  double sensor_sd = 3e-4, period_s = 0.01, seconds = 8.0, torque_Nm = 1.0;
  double first_angle = 0.0, first_rate = 0.0;
};

/// Point mass on a rod under a multisine torque held over each period.
inline tiller::tools::Grid log(const Setup& s, const Torque& extra, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 6.283185307179586);
  double phase[4];
  for (double& p : phase) p = uniform(random);
  const double rate_Hz[4] = {0.23, 0.61, 0.97, 1.7}, share[4] = {0.6, 0.5, 0.35, 0.3};
  const double inertia = s.mass_kg * s.length_m * s.length_m;
  tiller::tools::Grid grid;
  grid.path = "hidden";
  grid.period_s = s.period_s;
  const auto points = static_cast<std::size_t>(std::lround(s.seconds / s.period_s));
  grid.state.assign(2, std::vector<double>(points, NAN));
  grid.input.assign(1, std::vector<double>(points, 0.0));
  double q = s.first_angle, v = s.first_rate;
  constexpr int kParts = 100;
  const double h = s.period_s / kParts;
  for (std::size_t k = 0; k < points; ++k) {
    grid.state[0][k] = q + s.sensor_sd * normal(random);
    double u = 0.0;
    for (int i = 0; i < 4; ++i)
      u += s.torque_Nm * share[i] *
           std::sin(6.283185307179586 * rate_Hz[i] * s.period_s * static_cast<double>(k) + phase[i]);
    grid.input[0][k] = u;
    for (int part = 0; part < kParts; ++part) {  // symplectic Euler
      v += h * (u - s.mass_kg * 9.81 * s.length_m * std::sin(q) - s.damping_Nms * v + extra(q, v)) / inertia;
      q += h * v;
    }
  }
  return grid;
}

inline std::vector<tiller::tools::Grid> logs(const Setup& s, const Torque& extra, unsigned count, unsigned seed) {
  std::vector<tiller::tools::Grid> all;
  for (unsigned i = 0; i < count; ++i) all.push_back(log(s, extra, seed * 1000 + i));
  return all;
}

/// The nominal model of it: mass within 5 %, length and damping known, an encoder alone.
inline tiller::Config nominal(const Setup& s) {
  tiller::Config c;
  tiller_config_default(&c, tiller_find_model("pendulum"));
  c.period_s = s.period_s;
  c.substeps = 1;
  c.integrator = tiller_integrator_rk4;
  c.priors[0] = {tiller_prior_normal, 0, s.mass_kg, 0.05 * s.mass_kg, 0.0, HUGE_VAL};
  c.priors[1] = {tiller_prior_fixed, 0, s.length_m, 0.0, 0.0, 0.0};
  c.priors[2] = {tiller_prior_fixed, 0, s.damping_Nms, 0.0, 0.0, 0.0};
  c.measurement_count = 1;
  c.measured_state[0] = 0;
  c.measurement_sd[0] = s.sensor_sd;
  c.process_sd[0] = c.process_sd[1] = 0.0;
  c.initial_state_sd[0] = c.initial_state_sd[1] = 0.01;
  c.safety.input_low[0] = -5.0;
  c.safety.input_high[0] = 5.0;
  return c;
}

}  // namespace hidden
