// Goals: costs of a model's outputs, and targets and references that change while the robot runs.

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

using rig::Loop;

constexpr double kLength_m[2] = {0.5, 0.4};

/// Two rods in a vertical plane, motors in both hinges, with equations of its own: the rods' centres by their
/// Jacobians, M = sum m J'J + I, and what the centres' accelerations leave at rest.
class ArmPlant : public rig::Plant {
 public:
  double mass_kg[2] = {1.0, 0.8};
  double x[4] = {0.3, 0.5, 0.0, 0.0};

  void step(const double* command, double time_s) override {
    const int steps = static_cast<int>(std::lround(time_s / 5e-4));
    const double h = time_s / steps;
    for (int s = 0; s < steps; ++s) {  // midpoint
      double a[2], middle[4];
      accelerate(x, command, a);
      for (int i = 0; i < 2; ++i) {
        middle[i] = x[i] + 0.5 * h * x[2 + i];
        middle[2 + i] = x[2 + i] + 0.5 * h * a[i];
      }
      accelerate(middle, command, a);
      for (int i = 0; i < 2; ++i) {
        x[i] += h * middle[2 + i];
        x[2 + i] += h * a[i];
      }
    }
  }
  void measure(double* value) const override {
    value[0] = x[0];
    value[1] = x[1];
  }
  double tip_x() const { return kLength_m[0] * std::sin(x[0]) + kLength_m[1] * std::sin(x[0] + x[1]); }
  double tip_z() const { return -kLength_m[0] * std::cos(x[0]) - kLength_m[1] * std::cos(x[0] + x[1]); }

 private:
  void accelerate(const double* s, const double* command, double* a) const {
    double m[2][2] = {}, r[2] = {command[0], command[1]};
    for (int body = 0; body < 2; ++body) {
      // links up to this one, the last by half; angles from the vertical
      double jx[2] = {}, jz[2] = {}, bias_x = 0.0, bias_z = 0.0, angle = 0.0, rate = 0.0;
      for (int link = 0; link <= body; ++link) {
        angle += s[link];
        rate += s[2 + link];
        const double l = link == body ? 0.5 * kLength_m[link] : kLength_m[link];
        for (int k = 0; k <= link; ++k) {
          jx[k] += l * std::cos(angle);
          jz[k] += l * std::sin(angle);
        }
        bias_x -= l * std::sin(angle) * rate * rate;
        bias_z += l * std::cos(angle) * rate * rate;
      }
      const double mass = mass_kg[body], inertia = mass * kLength_m[body] * kLength_m[body] / 12.0;
      for (int i = 0; i <= body; ++i) {
        for (int k = 0; k <= body; ++k) m[i][k] += mass * (jx[i] * jx[k] + jz[i] * jz[k]) + inertia;
        r[i] -= mass * (jx[i] * bias_x + jz[i] * (bias_z + 9.81));
      }
    }
    const double determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    a[0] = (m[1][1] * r[0] - m[0][1] * r[1]) / determinant;
    a[1] = (m[0][0] * r[1] - m[1][0] * r[0]) / determinant;
  }
};

tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0.0, value, value}; }

/// The arm with an unknown lower mass; the tip's position is all that it is asked for.
tiller::Config arm_config(std::uint32_t planner, const tiller_output_cost_t* outputs) {
  tiller::Config c;
  if (tiller_config_default(&c, tiller_find_model("two_link_arm")) != tiller_status_ok) return tiller::Config{};
  const double rod = kLength_m[0], lower = kLength_m[1];
  c.priors[0] = fixed(1.0);
  c.priors[1] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.5, 1.2};
  c.priors[2] = fixed(rod);
  c.priors[3] = fixed(lower);
  c.priors[4] = fixed(0.5 * rod);
  c.priors[5] = fixed(0.5 * lower);
  c.priors[6] = fixed(rod * rod / 12.0);
  c.priors[7] = fixed(0.8 * lower * lower / 12.0);
  c.initial_state[0] = 0.3;
  c.initial_state[1] = 0.5;
  c.period_s = 0.01;
  c.integrator = tiller_integrator_midpoint;
  c.record_ticks = 64;
  c.posterior.particles = 64;
  c.posterior.window = 16;
  c.posterior.moves_per_tick = 8;
  c.planner.kind = planner;
  c.planner.horizon = 30;
  c.planner.knots = 6;
  c.planner.rollouts = 256;
  c.planner.particles = planner == tiller_planner_ilqr || planner == tiller_planner_sqp ? 1 : 2;
  c.planner.iterations = 2;
  for (int i = 0; i < 2; ++i) {
    c.planner.noise_sd[i] = 3.0;
    c.cost.state_weight[2 + i] = 0.05;
    c.cost.terminal_weight[2 + i] = 1.0;
    c.cost.input_rate_weight[i] = 1e-3;
    c.cost.input_weight[i] = 1e-5;
    c.safety.input_low[i] = -20.0;
    c.safety.input_high[i] = 20.0;
    c.safety.input_rate_per_s[i] = 1000.0;
    c.hold_gain[i * static_cast<int>(c.model->state_count) + 2 + i] = 0.5;
  }
  c.cost.outputs = outputs;
  c.cost.output_count = outputs != nullptr ? 2 : 0;
  return c;
}

struct TipCost {
  tiller_output_cost_t rows[2];
  TipCost(double x_m, double z_m)
      : rows{{x_m, 300.0, 1000.0, -INFINITY, INFINITY, 0.0}, {z_m, 300.0, 1000.0, -INFINITY, INFINITY, 0.0}} {}
};

class EveryPlannersGoal : public ::testing::TestWithParam<std::uint32_t> {};
INSTANTIATE_TEST_SUITE_P(Planners, EveryPlannersGoal,
                         ::testing::Values(tiller_planner_mppi, tiller_planner_cem, tiller_planner_ilqr,
                                           tiller_planner_sqp, tiller_planner_hybrid));

TEST_P(EveryPlannersGoal, TipGoesFromGoalToGoal) {
  const TipCost first(0.5, -0.5);
  ArmPlant plant;
  Loop loop(arm_config(GetParam(), first.rows), plant);
  ASSERT_TRUE(loop.ready());
  loop.activate(1);
  const double goals[][2] = {{0.5, -0.5}, {0.6, 0.1}, {-0.2, -0.7}, {0.3, -0.75}};
  for (const auto& goal : goals) {
    ASSERT_EQ(tiller_set_output_target(loop.controller(), goal), tiller_status_ok);
    for (int k = 0; k < 200; ++k) {
      (void)loop.tick();
      if (k % 3 == 0) (void)tiller_prepare(loop.controller());  // made void where a goal comes between
    }
    const double error = std::hypot(plant.tip_x() - goal[0], plant.tip_z() - goal[1]);
    std::printf("planner %u: goal (%.2f, %.2f), error %.1f mm after 2 s\n", GetParam(), goal[0], goal[1], 1e3 * error);
    // sampling leaves the tip a centimetre of the noise of its own; gradients come closer
    EXPECT_LT(error, GetParam() == tiller_planner_mppi || GetParam() == tiller_planner_cem ? 0.04 : 0.01);
  }
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_TRUE(loop.commands_allowed());
  double y[2];
  ASSERT_EQ(tiller_get_outputs(loop.controller(), y), tiller_status_ok);
  EXPECT_NEAR(y[0], plant.tip_x(), 2e-3);
  EXPECT_NEAR(y[1], plant.tip_z(), 2e-3);
}

// A goal that is set before the first tick is the goal of the configuration, to the last bit.
TEST_P(EveryPlannersGoal, IsTheSameWhereverItComesFrom) {
  const TipCost here(0.6, 0.1), elsewhere(-0.2, -0.7);
  tiller::Config config = arm_config(GetParam(), here.rows);
  config.cost.state_weight[0] = config.cost.terminal_weight[0] = 1.0;
  config.cost.target[0] = 0.7;
  tiller::Config other = config;
  other.cost.outputs = elsewhere.rows;
  other.cost.target[0] = -2.0;
  ArmPlant plants[2];
  Loop given(config, plants[0]), told(other, plants[1]);
  const double tip[2] = {0.6, 0.1}, state[4] = {0.7, 0.0, 0.0, 0.0};
  ASSERT_EQ(tiller_set_output_target(told.controller(), tip), tiller_status_ok);
  ASSERT_EQ(tiller_set_target(told.controller(), state), tiller_status_ok);
  given.activate(1);
  told.activate(1);
  for (int k = 0; k < 50; ++k) {
    (void)given.tick();
    (void)told.tick();
    for (int i = 0; i < 2; ++i) ASSERT_EQ(given.command().value[i], told.command().value[i]) << "tick " << k;
  }
}

TEST_P(EveryPlannersGoal, FollowsRowsThatAreHandedInLater) {
  const TipCost start(0.5, -0.5);
  ArmPlant plant;
  Loop loop(arm_config(GetParam(), start.rows), plant);
  ASSERT_TRUE(loop.ready());
  loop.activate(1);
  loop.run(150);
  std::vector<double> circle;  // 8 cm around the first goal in 2 s
  for (int k = 0; k <= 200; ++k) {
    const double angle = 2.0 * M_PI * k / 200.0;
    circle.push_back(0.5 + 0.08 * std::sin(angle));
    circle.push_back(-0.5 + 0.08 * (1.0 - std::cos(angle)));
  }
  ASSERT_EQ(tiller_set_reference(loop.controller(), nullptr, circle.data(), 201), tiller_status_ok);
  double worst = 0.0;
  for (int k = 0; k < 200; ++k) {
    (void)loop.tick();
    if (k >= 20)
      worst = std::fmax(worst, std::hypot(plant.tip_x() - circle[2 * k + 2], plant.tip_z() - circle[2 * k + 3]));
  }
  std::printf("planner %u: at most %.1f mm off the circle\n", GetParam(), 1e3 * worst);
  EXPECT_LT(worst, 0.03) << "where standing still would be 160 mm off";
  // and a target ends the reference
  const double back[2] = {0.55, -0.45};
  ASSERT_EQ(tiller_set_output_target(loop.controller(), back), tiller_status_ok);
  loop.run(100);
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_NEAR(plant.tip_x(), back[0], 0.03) << "the circle ends 71 mm from there";
  EXPECT_NEAR(plant.tip_z(), back[1], 0.03);
}

TEST(Goals, OutputBoundsHoldTheTip) {
  TipCost cost(0.6, -0.5);
  cost.rows[0].high = 0.45;  // a wall in front of the goal
  cost.rows[0].bound_weight = 1e5;
  for (const std::uint32_t planner : {tiller_planner_ilqr, tiller_planner_mppi}) {
    ArmPlant plant;
    plant.x[0] = -0.4;
    plant.x[1] = 0.8;
    tiller::Config config = arm_config(planner, cost.rows);
    config.initial_state[0] = plant.x[0];
    config.initial_state[1] = plant.x[1];
    Loop loop(config, plant);
    ASSERT_TRUE(loop.ready());
    loop.activate(1);
    double most = -1.0;
    for (int k = 0; k < 300; ++k) {
      (void)loop.tick();
      most = std::fmax(most, plant.tip_x());
    }
    std::printf("planner %u: tip at most %.4f m of 0.45 m, at the end (%.3f, %.3f)\n", planner, most, plant.tip_x(),
                plant.tip_z());
    EXPECT_LT(most, 0.47);
    EXPECT_GT(plant.tip_x(), 0.40);
  }
}

TEST(Goals, WhatIsNoGoalIsRefusedAndChangesNothing) {
  const TipCost cost(0.5, -0.5);
  ArmPlant plants[2];
  Loop plain(arm_config(tiller_planner_ilqr, cost.rows), plants[0]),
      asked(arm_config(tiller_planner_ilqr, cost.rows), plants[1]);
  tiller_t* t = asked.controller();
  const double bad[4] = {NAN, 0.0, 0.0, 0.0}, huge[4] = {0.0, 1e300, 0.0, 0.0}, good[4] = {};
  plain.activate(1);
  asked.activate(1);
  for (int k = 0; k < 20; ++k) {
    EXPECT_EQ(tiller_set_target(t, bad), tiller_status_bad_cost);
    EXPECT_EQ(tiller_set_target(t, nullptr), tiller_status_null_argument);
    EXPECT_EQ(tiller_set_target(nullptr, good), tiller_status_null_argument);
    EXPECT_EQ(tiller_set_output_target(t, huge), tiller_status_bad_cost);
    EXPECT_EQ(tiller_set_reference(t, nullptr, nullptr, 3), tiller_status_null_argument);
    EXPECT_EQ(tiller_set_reference(t, good, nullptr, 0), tiller_status_bad_cost);
    EXPECT_EQ(tiller_set_reference(t, nullptr, huge, 2), tiller_status_bad_cost);
    (void)plain.tick();
    (void)asked.tick();
    ASSERT_EQ(plain.command().value[0], asked.command().value[0]);
    ASSERT_EQ(plain.command().value[1], asked.command().value[1]);
  }
  // a configuration that weighs no outputs has no goal for them
  Loop without(arm_config(tiller_planner_ilqr, nullptr), plants[0]);
  EXPECT_EQ(tiller_set_output_target(without.controller(), good), tiller_status_bad_cost);
  EXPECT_EQ(tiller_set_reference(without.controller(), nullptr, good, 1), tiller_status_bad_cost);
  double y[2];
  EXPECT_EQ(tiller_get_outputs(without.controller(), nullptr), tiller_status_null_argument);
  EXPECT_EQ(tiller_get_outputs(without.controller(), y), tiller_status_ok);
}

TEST(Goals, OutputsOfTheConfigurationAreChecked) {
  const char* field = nullptr;
  const auto check = [&](const tiller_config_t& c) {
    field = "";
    return tiller_config_check(&c, &field);
  };
  TipCost cost(0.5, -0.5);
  tiller::Config c = arm_config(tiller_planner_ilqr, cost.rows);
  EXPECT_EQ(check(c), tiller_status_ok) << field;
  c.cost.output_count = 1;
  EXPECT_EQ(check(c), tiller_status_bad_cost);
  EXPECT_STREQ(field, "cost.output_count");
  c.cost.output_count = 2;
  cost.rows[1].weight = -1.0;
  EXPECT_EQ(check(c), tiller_status_bad_cost);
  EXPECT_STREQ(field, "cost.outputs[1]");
  cost.rows[1].weight = 1.0;
  cost.rows[0].low = 2.0;
  cost.rows[0].high = 1.0;
  EXPECT_EQ(check(c), tiller_status_bad_cost);
  EXPECT_STREQ(field, "cost.outputs[0]");
  // a model without outputs
  tiller::Config pendulum = rig::pendulum_config();
  const TipCost none(0.0, 0.0);
  pendulum.cost.outputs = none.rows;
  pendulum.cost.output_count = 2;
  EXPECT_EQ(check(pendulum), tiller_status_bad_cost);
  EXPECT_STREQ(field, "cost.output_count");
}

// A record of the run, with the goals put back where they came, gives the same commands.
TEST(Goals, CallsAreOnRecord) {
  const TipCost cost(0.5, -0.5);
  ArmPlant plant;
  Loop loop(arm_config(tiller_planner_ilqr, cost.rows), plant);
  loop.activate(1);
  loop.run(5);
  const double goal[2] = {0.6, 0.1};
  ASSERT_EQ(tiller_set_output_target(loop.controller(), goal), tiller_status_ok);
  (void)loop.tick();
  tiller_record_t record;
  ASSERT_EQ(tiller_get_record(loop.controller(), loop.info().ticks - 1, &record), tiller_status_ok);
  EXPECT_EQ(record.calls & 15u, static_cast<std::uint32_t>(tiller_call_goal));
}

}  // namespace
