// The default planner with nothing set but the task: a pendulum whose torque cannot lift it comes up, whatever its
// size.

#include <gtest/gtest.h>

#include "problem.hpp"

namespace tiller_test {
namespace {

constexpr double kUpright = 3.141592653589793, kLength_m = 0.5, kDamping = 0.05, kPeriod_s = 0.03;

/// A bob of `mass_kg` on 0.5 m, whose weight takes 4.9 Nm per kg; the torque goes up to 2 Nm per kg. Costs are those of
/// the torque per kg.
tiller::Config pendulum_config(double mass_kg) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("pendulum")), tiller_status_ok);
  const double params[3] = {mass_kg, kLength_m, kDamping * mass_kg};
  c.param_count = 3;
  for (int i = 0; i < 3; ++i) c.priors[i] = {tiller_prior_fixed, 0, params[i], 0.0, -HUGE_VAL, HUGE_VAL};
  c.period_s = kPeriod_s;
  c.cost.target[0] = kUpright;
  c.cost.state_weight[0] = 1.0;
  c.cost.state_weight[1] = 0.02;
  c.cost.terminal_weight[0] = 50.0;
  c.cost.terminal_weight[1] = 5.0;
  c.cost.input_weight[0] = 0.02 / (mass_kg * mass_kg);
  c.safety.input_low[0] = -2.0 * mass_kg;
  c.safety.input_high[0] = 2.0 * mass_kg;
  return c;
}

/// The pendulum's equation, 20 steps of semi-implicit Euler a period.
void step(double* x, double torque_per_kg) {
  constexpr int kParts = 20;
  for (int i = 0; i < kParts; ++i) {
    const double torque = torque_per_kg - kDamping * x[1] - 9.81 * kLength_m * std::sin(x[0]);
    x[1] += kPeriod_s / kParts * torque / (kLength_m * kLength_m);
    x[0] += kPeriod_s / kParts * x[1];
  }
}

/// Largest angle from upright in the last of twelve seconds.
double sways(const tiller_config_t& c) {
  Bench bench(c, nullptr, tiller::select_rollout(*c.model));
  const std::uint32_t count = c.planner.particles;
  for (std::uint32_t i = 0; i < 3; ++i)
    for (std::uint32_t m = 0; m < count; ++m) bench.params[i * count + m] = static_cast<float>(c.priors[i].a);
  double x[2] = {0.0, 0.0}, most = 0.0;
  for (int t = 0; t < 400; ++t) {
    bench.set_state({x[0], x[1]});
    EXPECT_EQ(bench.plan().status, tiller_status_ok);
    step(x, bench.command[0] / c.priors[0].a);
    if (t >= 367) most = std::fmax(most, std::fabs(std::remainder(x[0] - kUpright, 2.0 * kUpright)));
  }
  return most;
}

TEST(DefaultPlanner, swings_up_pendulums_that_it_cannot_lift) {
  for (const double mass_kg : {0.01, 1.0, 100.0})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      tiller::Config c = pendulum_config(mass_kg);
      c.seed = seed;
      const double sway = sways(c);
      std::printf("%g kg, seed %d: within %.3f rad\n", mass_kg, static_cast<int>(seed), sway);
      EXPECT_LT(sway, 0.3);
    }
}

/// So that the test above can fail: samples that do not go by the limits leave the heavy one hanging.
TEST(DefaultPlanner, samples_of_one_newton_metre_do_not_lift_100_kg) {
  tiller::Config c = pendulum_config(100.0);
  c.planner.noise_sd[0] = 1.0;
  EXPECT_GT(sways(c), 2.0);
}

}  // namespace
}  // namespace tiller_test
