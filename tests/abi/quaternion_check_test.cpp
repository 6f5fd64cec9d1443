#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>

#include "tiller/config.hpp"

// What tiller_config_check says of quaternions: every rule of docs/reference/rotations.md, broken one at a time.

namespace {

using C = tiller::Config;

C good() {
  C c{};
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("quadrotor")), tiller_status_ok);
  const double params[] = {0.8, 0.17, 0.005, 0.005, 0.009, 0.016, 0.1};
  for (int i = 0; i < 7; ++i) c.priors[i] = {tiller_prior_fixed, 0, params[i], 0, -INFINITY, INFINITY};
  c.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.5, 1.1};
  for (int i = 0; i < 4; ++i) {
    c.safety.input_high[i] = 5;
    c.planner.noise_sd[i] = 0.5;
  }
  return c;
}

std::string refused(const std::function<void(C&)>& spoil) {
  C c = good();
  spoil(c);
  const char* field = nullptr;
  return tiller_config_check(&c, &field) == tiller_status_ok ? "" : field;
}

TEST(QuaternionCheck, DefaultsAreNoRotationAndMeasureTheAttitude) {
  const C c = good();
  EXPECT_EQ(refused([](C&) {}), "");
  EXPECT_EQ(c.initial_state[3], 1.0);
  EXPECT_EQ(c.cost.target[3], 1.0);
  ASSERT_EQ(c.measurement_count, 7u);
  for (std::uint8_t i = 0; i < 7; ++i) EXPECT_EQ(c.measured_state[i], i);
}

TEST(QuaternionCheck, PredictedSpreadsAreOfModelsWithoutAttitudes) {
  EXPECT_EQ(refused([](C& c) { c.planner.predict_spread = 1; }), "planner.predict_spread");
  EXPECT_EQ(refused([](C& c) { c.cost.demonstration_divergence = tiller_divergence_kl; }),
            "cost.demonstration_divergence");
  EXPECT_EQ(refused([](C& c) { c.cost.bound_risk = 0.05; }), "cost.bound_risk");
  EXPECT_EQ(refused([](C& c) { c.planner.noisy_rollouts = 1; }), "");
}

TEST(QuaternionCheck, StartTargetAndReferenceAreOfUnitLength) {
  EXPECT_EQ(refused([](C& c) { c.initial_state[3] = 0; }), "initial_state[3]");
  EXPECT_EQ(refused([](C& c) { c.initial_state[4] = 0.1; }), "initial_state[3]");
  EXPECT_EQ(refused([](C& c) { c.initial_state[4] = 0.01; }), "") << "5e-5 too long: divided out";
  EXPECT_EQ(refused([](C& c) { c.cost.target[3] = 0; }), "cost.target[3]");
  EXPECT_EQ(refused([](C& c) { c.cost.target[3] = NAN; }), "cost.target[3]");
  static double rows[26];
  for (double& v : rows) v = 0;
  rows[3] = 1;
  const auto follow = [](C& c) {
    c.cost.reference = rows;
    c.cost.reference_steps = 2;
  };
  EXPECT_EQ(refused(follow), "cost.reference") << "zeros in the second row";
  rows[13 + 4] = -1;
  EXPECT_EQ(refused(follow), "");
}

TEST(QuaternionCheck, TheFirstPartBearsNoWeight) {
  EXPECT_EQ(refused([](C& c) { c.cost.state_weight[3] = 1; }), "cost.state_weight[3]");
  EXPECT_EQ(refused([](C& c) { c.cost.terminal_weight[3] = 1; }), "cost.terminal_weight[3]");
  EXPECT_EQ(refused([](C& c) { c.cost.state_weight[4] = 1; }), "");
}

TEST(QuaternionCheck, IsMeasuredWholeAndInOrderOrNotAtAll) {
  EXPECT_EQ(refused([](C& c) { c.measurement_count = 6; }), "measured_state[3]");
  EXPECT_EQ(refused([](C& c) { c.measured_state[4] = 5, c.measured_state[5] = 4; }), "measured_state[3]");
  EXPECT_EQ(refused([](C& c) { c.measurement_count = 3; }), "");
  EXPECT_EQ(refused([](C& c) {
              for (std::uint8_t i = 3; i < 7; ++i) c.measured_state[i] = static_cast<std::uint8_t>(i == 6 ? 3 : i + 1);
            }),
            "measured_state[3]")
      << "it begins with w";
}

TEST(QuaternionCheck, WhatDoesNotKnowThemIsRefusedByName) {
  EXPECT_EQ(refused([](C& c) { c.planner.kind = tiller_planner_sqp; }), "") << "linearises as ilqr does";
  EXPECT_EQ(refused([](C& c) { c.cost.demonstration_weight = 1.0; }), "cost.demonstration_weight");
  EXPECT_EQ(refused([](C& c) { c.posterior.kind = tiller_posterior_transition; }), "posterior.kind");
  EXPECT_EQ(refused([](C& c) { c.posterior.kind = tiller_posterior_conjugate; }), "posterior.kind");
  EXPECT_EQ(refused([](C& c) { c.effect_count = 1, c.effects[0] = {tiller_effect_sensor_bias, 4}; }), "effects[0]");
}

TEST(QuaternionCheck, AModelsMaskLiesWithinItsStatesApartFromAnglesAndJoints) {
  for (const std::uint32_t mask : {1u << 10, 1u << 3 | 1u << 5, 1u << 0, 1u << 7}) {
    tiller_model_t model = *tiller_find_model("quadrotor");
    model.quaternion_mask = mask;
    C c = good();
    c.model = &model;
    const char* field = "";
    EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_model) << mask;
    EXPECT_STREQ(field, "model.quaternion_mask");
  }
}

}  // namespace
