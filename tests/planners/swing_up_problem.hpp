#pragma once

#include <algorithm>
#include <array>

#include "problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {

constexpr double kHanging = 3.141592653589793;

/// The cart-pole of the comparisons, |u| <= 20 N, N = 50, one hypothesis, multiple shooting.
inline tiller::Config swing_up_config(std::uint32_t planner) {
  tiller::Config c = line_config(planner);
  c.model = tiller_find_model("cart_pole");
  c.param_count = 3;
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.body.gravity_z_m_s2 = -9.81;
  c.planner.shooting = tiller_shooting_multiple;
  c.planner.iterations = 50;
  c.planner.regularisation = 1e-9;
  c.planner.noise_sd[0] = 8.0;
  c.planner.temperature = 0.02;
  const double q[4] = {0.1, 1.0, 0.01, 0.01}, qf[4] = {100.0, 100.0, 10.0, 10.0};
  for (int i = 0; i < 4; ++i) {
    c.cost.state_weight[i] = q[i];
    c.cost.terminal_weight[i] = qf[i];
  }
  c.cost.input_weight[0] = 0.001;
  c.safety.input_low[0] = -20.0;
  c.safety.input_high[0] = 20.0;
  for (int i = 0; i < TILLER_MAX_STATES; ++i) {
    c.state_low[i] = -INFINITY;
    c.state_high[i] = INFINITY;
  }
  return c;
}

struct CartPoleBench : Bench {
  explicit CartPoleBench(const tiller_config_t& c, const tiller_hooks_t* hooks = nullptr)
      : Bench(c, hooks, tiller::select_rollout(*c.model)) {
    const float nominal[3] = {1.0f, 0.1f, 0.5f};
    for (std::uint32_t m = 0; m < belief.count; ++m)
      for (std::uint32_t i = 0; i < 3; ++i) params[i * belief.count + m] = nominal[i];
    set_state({0.0, kHanging, 0.0, 0.0});
  }
};

/// The cart-pole's equations, one period of semi-implicit Euler.
inline void step_cart_pole(double* x, double u) {
  const double total = 1.1, moment = 0.05, inertia = 4.0 / 3.0 * 0.025, s = std::sin(x[1]), c = std::cos(x[1]);
  const double push = u + moment * s * x[3] * x[3], turn = moment * 9.81 * s;
  const double inverse = 1.0 / (total * inertia - moment * moment * c * c);
  x[2] += 0.02 * (inertia * push - moment * c * turn) * inverse;
  x[3] += 0.02 * (total * turn - moment * c * push) * inverse;
  x[0] += 0.02 * x[2];
  x[1] += 0.02 * x[3];
}

/// Half of x'Qx + u'Ru of one period, and the angle from upright.
inline double stage_cost(const double* x, double u) {
  const double d = std::remainder(x[1], 2.0 * kHanging);
  return 0.5 * (0.1 * x[0] * x[0] + d * d + 0.01 * x[2] * x[2] + 0.01 * x[3] * x[3] + 0.001 * u * u);
}

/// The planner's cost of its sequence from input `first` on, the last input repeated, by the equations above.
inline double sequence_cost(const Bench& bench, std::array<double, 4> x, std::uint32_t first = 0) {
  const std::uint32_t n = bench.config().planner.horizon;
  double sum = 0.0;
  for (std::uint32_t k = 0; k < n; ++k) {
    const auto u = static_cast<double>(bench.sequence()[std::min(k + first, n - 1)]);
    sum += 2.0 * stage_cost(x.data(), u);
    step_cart_pole(x.data(), u);
  }
  const double d = std::remainder(x[1], 2.0 * kHanging);
  return sum + 100.0 * (x[0] * x[0] + d * d) + 10.0 * (x[2] * x[2] + x[3] * x[3]);
}

}  // namespace tiller_test
