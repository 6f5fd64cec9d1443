// Gradient planners leave the valley in which they begin: a pendulum whose motor cannot lift it, from hanging, with the
// task of robots/pendulum.toml. Without a scout `ilqr` and `sqp` hold the torque at its limit for ever.

#include <gtest/gtest.h>

#include <algorithm>

#include "core/rng.hpp"
#include "problem.hpp"

namespace tiller_test {
namespace {

constexpr double kUpright = 3.141592653589793, kLength_m = 0.5, kPeriod_s = 0.02;

struct Pendulum {
  double mass_kg, damping_Nms;
};

/// Half a kilogram or more: 1.5 Nm balance it at 38 degrees from hanging or less.
Pendulum draw_pendulum(std::uint64_t seed) {
  tiller::Rng rng(seed, tiller::kRngPrior, 0);
  return {0.5 + 0.25 * rng.uniform(), 0.1 * rng.uniform()};
}

tiller::Config pendulum_config(std::uint32_t planner, const Pendulum& pendulum, std::uint64_t seed) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("pendulum")), tiller_status_ok);
  c.seed = seed;
  c.period_s = kPeriod_s;
  c.param_count = 3;
  const double params[3] = {pendulum.mass_kg, kLength_m, pendulum.damping_Nms};
  for (int i = 0; i < 3; ++i) c.priors[i] = {tiller_prior_fixed, 0, params[i], 0.0, -HUGE_VAL, HUGE_VAL};
  c.planner.kind = planner;
  c.planner.horizon = 100;
  c.planner.particles = 2;
  c.cost.target[0] = kUpright;
  c.cost.state_weight[0] = 4.0;
  c.cost.state_weight[1] = 0.05;
  c.cost.terminal_weight[0] = 50.0;
  c.cost.terminal_weight[1] = 2.0;
  c.cost.input_weight[0] = c.cost.input_rate_weight[0] = 0.01;
  c.safety.input_low[0] = -1.5;
  c.safety.input_high[0] = 1.5;
  return c;
}

/// The pendulum's equation, 20 steps of semi-implicit Euler a period.
void step(const Pendulum& p, double* x, double torque_Nm) {
  constexpr int kParts = 20;
  for (int i = 0; i < kParts; ++i) {
    const double torque = torque_Nm - p.damping_Nms * x[1] - 9.81 * p.mass_kg * kLength_m * std::sin(x[0]);
    x[1] += kPeriod_s / kParts * torque / (p.mass_kg * kLength_m * kLength_m);
    x[0] += kPeriod_s / kParts * x[1];
  }
}

struct Outcome {
  double sway_rad = 0.0;           // largest angle from upright in the last of ten seconds
  std::uint32_t resting_work = 0;  // most iterations of a plan in it
};

Outcome run_pendulum(const tiller_config_t& c, const Pendulum& pendulum) {
  Bench bench(c, nullptr, tiller::select_rollout(*c.model));
  const std::uint32_t count = c.planner.particles;
  for (std::uint32_t i = 0; i < 3; ++i)
    for (std::uint32_t m = 0; m < count; ++m) bench.params[i * count + m] = static_cast<float>(c.priors[i].a);
  tiller::Rng rng(c.seed, tiller::kRngMotion, 0);
  double x[2] = {0.01 * rng.normal(), 0.01 * rng.normal()};
  Outcome result;
  for (int t = 0; t < 500; ++t) {
    bench.set_state({x[0] + 0.002 * rng.normal(), x[1]});
    const tiller::PlanResult plan = bench.plan();
    EXPECT_NE(plan.status, tiller_status_plan_not_finite);
    step(pendulum, x, bench.command[0]);
    if (t < 450) continue;
    result.sway_rad = std::fmax(result.sway_rad, std::fabs(std::remainder(x[0] - kUpright, 2.0 * kUpright)));
    result.resting_work = std::max(result.resting_work, plan.iterations);
  }
  return result;
}

class Escape : public testing::TestWithParam<std::uint32_t> {};
INSTANTIATE_TEST_SUITE_P(Gradient, Escape,
                         testing::Values(tiller_planner_ilqr, tiller_planner_sqp, tiller_planner_hybrid),
                         [](const auto& tested) { return std::string(tiller::find_planner(tested.param)->name); });

TEST_P(Escape, SwingsUpWhatItCannotLift) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const Pendulum pendulum = draw_pendulum(seed);
    const Outcome result = run_pendulum(pendulum_config(GetParam(), pendulum, seed), pendulum);
    std::printf("seed %u, %.3f kg: within %.3f rad\n", static_cast<unsigned>(seed), pendulum.mass_kg, result.sway_rad);
    EXPECT_LT(result.sway_rad, 0.02) << seed;  // ten times what the noise of the sensor does
  }
}

/// At its goal a robot has nothing to search for: the scout rests.
TEST(EscapeAtRest, RestsAtTheGoal) {
  for (const std::uint32_t planner : {tiller_planner_ilqr, tiller_planner_sqp}) {
    const Pendulum pendulum = draw_pendulum(1);
    const tiller::Config c = pendulum_config(planner, pendulum, 1);
    EXPECT_LE(run_pendulum(c, pendulum).resting_work, c.planner.iterations);
  }
}

}  // namespace
}  // namespace tiller_test
