#include "rollout/turns.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "batch.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

tiller::Config config_of(const tiller_model_t* model) {
  tiller::Config c = plain_config(model);
  for (tiller_prior_t& prior : c.priors) prior = {tiller_prior_uniform, 0, 0.0, 0.0, 0.4, 0.8};
  for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i) {
    c.safety.input_low[i] = -1.0;
    c.safety.input_high[i] = 1.0;
  }
  return c;
}
tiller::Config pendulum() { return config_of(tiller_find_model("pendulum")); }

std::uint32_t periodic(const tiller_config_t& config) {
  StepSetup setup;
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_ok);
  return periodic_angles(config, setup, select_rollout(*config.model));
}

/// The pendulum with an effect at its joint, parameters uniform in [low, high].
tiller::Config pendulum_with(std::uint32_t kind, double low, double high) {
  tiller::Config c = pendulum();
  const std::uint32_t first = c.param_count;
  add_effect(c, kind, 0);
  for (std::uint32_t i = first; i < c.param_count; ++i) c.priors[i] = {tiller_prior_uniform, 0, 0, 0, low, high};
  return c;
}

TEST(FarTurns, AreNoneForOrdinaryAngles) {
  for (const double angle : {0.0, 3.1, -99.0, 100.5, -100.5}) EXPECT_EQ(far_turns(angle), 0.0) << angle;
  EXPECT_NEAR(101.0 - far_turns(101.0), std::remainder(101.0, kTurn_rad), 1e-12);
  EXPECT_NEAR(-1e7 - far_turns(-1e7), std::remainder(-1e7, kTurn_rad), 1e-8);
}

TEST(PeriodicAngles, AreThoseOfEveryModelWithoutEffects) {
  for (std::uint32_t k = 0; tiller_builtin_model(k) != nullptr; ++k) {
    const tiller_model_t& model = *tiller_builtin_model(k);
    tiller::Config c = config_of(&model);
    c.period_s = 0.002;  // a stable step on the hopper's stiff ground, which else makes more of rounding
    EXPECT_EQ(periodic(c), model.angle_mask) << model.name;
  }
}

TEST(PeriodicAngles, FixedParametersNeedNoBounds) {
  tiller::Config c = pendulum();
  for (tiller_prior_t& prior : c.priors) prior = {tiller_prior_fixed, 0, 0.5, 0.0, 0.0, 0.0};
  EXPECT_EQ(periodic(c), 1u);
}

TEST(PeriodicAngles, AreTriedAtWhateverThePriorsSay) {
  for (const tiller_prior_kind_t kind : {tiller_prior_normal, tiller_prior_log_normal}) {
    tiller::Config c = pendulum();
    for (tiller_prior_t& prior : c.priors) prior = {static_cast<std::uint32_t>(kind), 0, 0.5, 0.1, 0.2, 1.0};
    EXPECT_EQ(periodic(c), 1u);
    const std::uint32_t first = c.param_count;
    add_effect(c, tiller_effect_linear_spring, 0);
    for (std::uint32_t i = first; i < c.param_count; ++i)
      c.priors[i] = {static_cast<std::uint32_t>(kind), 0, 0.5, 0.1, 0.2, 1.0};
    EXPECT_EQ(periodic(c), 0u) << "a spring knows how often it was wound";
  }
}

/// Where no trajectory stays finite nothing is known of its turns: none are taken out.
TEST(PeriodicAngles, AreNoneWhereNothingIsFinite) {
  tiller::Config c = pendulum();
  for (tiller_prior_t& prior : c.priors) prior = {tiller_prior_fixed, 0, NAN, 0.0, 0.0, 0.0};
  EXPECT_EQ(periodic(c), 0u);
}

TEST(PeriodicAngles, FrictionAndDelayLeaveThem) {
  EXPECT_EQ(periodic(pendulum_with(tiller_effect_viscous_friction, 0.1, 0.2)), 1u);
  EXPECT_EQ(periodic(pendulum_with(tiller_effect_coulomb_friction, 0.1, 0.2)), 1u);
  EXPECT_EQ(periodic(pendulum_with(tiller_effect_input_delay, 0.0, 0.06)), 1u);
}

TEST(PeriodicAngles, SpringAndCoggingOfAnyPitchDoNot) {
  EXPECT_EQ(periodic(pendulum_with(tiller_effect_linear_spring, 0.0, 0.2)), 0u);
  EXPECT_EQ(periodic(pendulum_with(tiller_effect_cogging, 0.1, 0.7)), 0u);
}

double wound(const double* x, const double*, const double*, double, void*) { return x[0] * x[0]; }
double upright(const double* x, const double*, const double*, double, void*) { return 1.0 + std::cos(x[0]); }

TEST(PeriodicAngles, OwnCostHasItsSay) {
  tiller_own_cost_t own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, wound, nullptr, nullptr};
  tiller::Config config = pendulum();
  config.cost.own = &own;
  config.cost.own_weight = 1.0;
  EXPECT_EQ(periodic(config), 0u);
  own.stage = upright;
  EXPECT_EQ(periodic(config), 1u);
  // bounds and obstacles go with the turns, so they are in nobody's way
  config.bound_weight[0] = 1e3;
  config.state_high[0] = 0.5;
  EXPECT_EQ(periodic(config), 1u);
}

}  // namespace
}  // namespace tiller
