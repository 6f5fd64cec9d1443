#pragma once

#include <cmath>
#include <cstring>

#include "fuzz.hpp"
#include "tiller/config.hpp"

namespace fuzz {

/// Mostly ordinary numbers, sometimes those that break arithmetic, sometimes any bits.
inline double number(Bytes& input) {
  static constexpr double kOdd[] = {0.0, -0.0, 1e-320, 1e-30, 1e30,     -1e30,     1.7e308, -1.7e308,
                                    1e9, -1e9, 1e12,   1e-12, INFINITY, -INFINITY, NAN,     3.141592653589793};
  const std::uint8_t kind = input.byte();
  if (kind < 224) return (kind - 112) / 32.0;
  if (kind < 250) return kOdd[input.byte() % 16];
  const std::uint64_t bits = input.long_word();
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

/// A controller of the pendulum that is as small as config.def allows.
inline tiller::Config small_pendulum() {
  tiller::Config c;
  (void)tiller_config_default(&c, tiller_find_model("pendulum"));
  c.priors[0] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.8, 1.6};
  c.priors[1] = {tiller_prior_fixed, 0, 0.5, 0.0, 0.5, 0.5};
  c.priors[2] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 0.2};
  c.measurement_sd[0] = 0.05;  // inputs step by hundredths of a radian
  c.record_ticks = 4;
  c.posterior.particles = 16;
  c.posterior.window = 16;
  c.posterior.moves_per_tick = 8;
  c.planner.horizon = 4;
  c.planner.knots = 2;
  c.planner.rollouts = 16;
  c.planner.particles = 2;
  c.planner.iterations = 1;
  c.planner.qp_iterations = 5;
  c.planner.nodes = 16;
  c.planner.levels = 3;
  c.planner.noise_sd[0] = 2.0;
  c.cost.target[0] = 3.0;
  c.cost.state_weight[0] = c.cost.terminal_weight[0] = 10.0;
  c.cost.input_weight[0] = 0.01;
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;
  c.safety.input_rate_per_s[0] = 100.0;
  c.hold_gain[1] = 0.3;
  return c;
}

}  // namespace fuzz
