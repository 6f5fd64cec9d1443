// The steady state nearest to the target, and its input, against statics worked out by hand.
#include "executive/steady_target.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

constexpr double kGravity_m_s2 = 9.81;

tiller::Config steady(const char* model) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model(model)), tiller_status_ok);
  c.cost.input_reference = tiller_input_reference_steady;
  c.posterior.disturbance = 1;
  for (std::uint32_t i = 0; i < c.model->input_count; ++i) {
    c.safety.input_low[i] = -100.0;
    c.safety.input_high[i] = 100.0;
    c.cost.input_weight[i] = 0.1;
  }
  return c;
}

/// Twenty updates with these parameters, the robot at `here`.
struct Rig {
  Rig(const tiller::Config& c, const std::vector<double>& means, const std::vector<double>& state)
      : config(c), params(means), here(state), storage(1 << 18), source_storage(1 << 18) {
    fakes::reset();
    EXPECT_EQ(make_step_setup(config, setup), tiller_status_ok);
    const tiller::RolloutTable& table = tiller::select_rollout(*config.model);
    tiller::Arena source_arena = source_storage.arena();
    source = tiller::Posterior::lay_out(source_arena, config, setup, table, nullptr);
    setup.slip_states = tiller::Posterior::slip_states(config);
    setup.fading = setup.slip_states != 0 ? config.model->state_count : config.model->joint_count;
    setup.fading_param = config.param_count;
    for (std::uint32_t j = 0; j < config.model->joint_count; ++j)
      setup.effects[setup.effect_count++] = {tiller_effect_constant_offset, static_cast<std::uint16_t>(j),
                                             static_cast<std::uint16_t>(config.param_count + j), 0};
    tiller::Arena arena = storage.arena();
    target.lay_out(arena, config, setup, table);
  }
  void update() {
    for (int k = 0; k < 20; ++k) target.update(*source, params.data(), here.data());
  }
  tiller::Config config;
  std::vector<double> params, here;
  bench::Storage storage, source_storage;
  tiller::StepSetup setup;
  tiller::SteadyTarget target;
  tiller::Posterior* source = nullptr;
};

TEST(SteadyTarget, APendulumIsHeldAgainstGravityAndAForce) {
  tiller::Config c = steady("pendulum");
  c.cost.target[0] = 0.8;
  c.cost.state_weight[0] = 10.0;
  Rig rig(c, {0.7, 0.5, 0.1}, {0.0, 0.0});
  fakes::posterior.force[0] = 0.3;
  rig.update();
  ASSERT_TRUE(rig.target.stands());
  EXPECT_NEAR(rig.target.state()[0], 0.8, 1e-9);
  EXPECT_NEAR(rig.target.state()[1], 0.0, 1e-9);
  EXPECT_NEAR(rig.target.input()[0], 0.7 * kGravity_m_s2 * 0.5 * std::sin(0.8) - 0.3, 1e-6);
}

TEST(SteadyTarget, WhatTheMotorCannotHoldIsCutToItsLimits) {
  tiller::Config c = steady("pendulum");
  c.cost.target[0] = 0.8;
  c.cost.state_weight[0] = 10.0;
  c.safety.input_low[0] = -1.0;
  c.safety.input_high[0] = 1.0;
  Rig rig(c, {0.7, 0.5, 0.1}, {0.0, 0.0});
  rig.update();
  ASSERT_TRUE(rig.target.stands());
  EXPECT_EQ(rig.target.input()[0], 1.0);
}

TEST(SteadyTarget, ADroneTiltsIntoTheWindAndStaysWhereItIsWanted) {
  tiller::Config c = steady("planar_quadrotor");
  const double weights[] = {10.0, 10.0, 5.0, 1.0, 1.0, 1.0};
  for (int i = 0; i < 6; ++i) c.cost.state_weight[i] = weights[i];
  c.cost.target[0] = 2.0;
  c.cost.target[1] = 1.0;
  const double mass = 0.8, arm = 0.2;
  Rig rig(c, {mass, arm, 0.01, 0.0}, {0.0, 0.0, 0.0, 0.0, 0.0, 0.0});
  fakes::posterior.force[0] = 1.5;
  fakes::posterior.force[2] = 0.02;
  rig.update();
  ASSERT_TRUE(rig.target.stands());
  EXPECT_NEAR(rig.target.state()[0], 2.0, 1e-5);
  EXPECT_NEAR(rig.target.state()[1], 1.0, 1e-5);
  EXPECT_NEAR(rig.target.state()[2], std::atan2(1.5, mass * kGravity_m_s2), 1e-5);
  const double left = rig.target.input()[0], right = rig.target.input()[1];
  EXPECT_NEAR(left + right, std::hypot(1.5, mass * kGravity_m_s2), 1e-4);
  EXPECT_NEAR(arm * (left - right), 0.02, 1e-6);
}

TEST(SteadyTarget, SoDoesOneInSpaceWhereverItLooks) {
  for (const double yaw : {0.0, 2.1}) {
    tiller::Config c = steady("quadrotor");
    for (std::uint32_t i = 0; i < c.model->state_count; ++i) c.cost.state_weight[i] = 1.0;
    c.cost.target[3] = std::cos(0.5 * yaw);
    c.cost.target[6] = std::sin(0.5 * yaw);
    c.cost.target[2] = 1.5;
    const std::vector<double> params = {0.6, 0.17, 0.003, 0.004, 0.006, 0.02, 0.0};
    std::vector<double> here(13, 0.0);
    here[3] = c.cost.target[3];
    here[6] = c.cost.target[6];
    Rig rig(c, params, here);
    fakes::posterior.force[0] = 0.9;
    fakes::posterior.force[1] = -0.6;
    rig.update();
    ASSERT_TRUE(rig.target.stands());
    const double* x = rig.target.state();
    EXPECT_NEAR(x[0], 0.0, 1e-5);
    EXPECT_NEAR(x[1], 0.0, 1e-5);
    EXPECT_NEAR(x[2], 1.5, 1e-5);
    // the body's z axis, against the wind
    const double weight = 0.6 * kGravity_m_s2, whole = std::sqrt(0.9 * 0.9 + 0.6 * 0.6 + weight * weight);
    EXPECT_NEAR(2.0 * (x[4] * x[6] + x[3] * x[5]), -0.9 / whole, 1e-5);
    EXPECT_NEAR(2.0 * (x[5] * x[6] - x[3] * x[4]), 0.6 / whole, 1e-5);
    double thrust = 0.0;
    for (int i = 0; i < 4; ++i) thrust += rig.target.input()[i];
    EXPECT_NEAR(thrust, whole, 1e-4);
  }
}

TEST(SteadyTarget, ABaseStandsOnASlopeByItsWheels) {
  tiller::Config c = steady("skid_steer");
  for (int i = 0; i < 3; ++i) c.cost.state_weight[i] = 1.0;
  c.cost.target[0] = 0.5;
  Rig rig(c, {0.1, 0.6, 0.0}, {0.0, 0.0, 0.0});
  fakes::posterior.force[0] = -0.2;
  rig.update();
  ASSERT_TRUE(rig.target.stands());
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(rig.target.state()[i], c.cost.target[i], 1e-5);
  for (int i = 0; i < 2; ++i) EXPECT_NEAR(rig.target.input()[i], 2.0, 1e-5);
}

TEST(SteadyTarget, IsWhatThePlannerIsGiven) {
  tiller::Config c = bench::known_pendulum();
  c.cost.input_reference = tiller_input_reference_steady;
  c.cost.target[0] = 0.8;
  c.cost.state_weight[0] = 10.0;
  c.posterior.disturbance = 1;
  bench::Bench b(c);
  fakes::posterior.force[0] = 0.3;
  b.activate();
  ASSERT_TRUE(fakes::planner.steady);
  EXPECT_NEAR(fakes::planner.steady_input[0], 0.5 * kGravity_m_s2 * 0.5 * std::sin(0.8) - 0.3, 1e-6);
  const double rows[] = {0.1, 0.0, 0.2, 0.0};
  b.executive->set_reference(rows, nullptr, 2);
  (void)b.tick();
  EXPECT_FALSE(fakes::planner.steady) << "a reference is followed: no input is steady";
  const double target[] = {0.2, 0.0};
  b.executive->set_target(target);
  (void)b.tick();
  ASSERT_TRUE(fakes::planner.steady);
  EXPECT_NEAR(fakes::planner.steady_state[0], 0.2, 1e-9);
  EXPECT_NEAR(fakes::planner.steady_input[0], 0.5 * kGravity_m_s2 * 0.5 * std::sin(0.2) - 0.3, 1e-6);
}

TEST(SteadyTarget, TakesNoRoomWhereNobodyAsksForIt) {
  tiller::Config c = steady("pendulum");
  c.cost.input_reference = tiller_input_reference_zero;
  Rig rig(c, {0.7, 0.5, 0.1}, {0.0, 0.0});
  rig.update();
  EXPECT_FALSE(rig.target.asked());
  EXPECT_EQ(rig.target.state(), nullptr);
}

}  // namespace
