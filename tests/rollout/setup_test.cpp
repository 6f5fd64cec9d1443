// What a step is made of: ports of effects, what is refused, and the noise of a period.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "batch.hpp"
#include "rollout/state_spread.hpp"

namespace tiller {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

const tiller_model_t& model(const char* name) { return *tiller_find_model(name); }

tiller_status_t status_of(const tiller_config_t& config) {
  StepSetup setup;
  return make_step_setup(config, setup);
}

/// The pendulum with an effect whose parameters all have this prior.
tiller::Config pendulum_with(std::uint32_t kind, const tiller_prior_t& prior, std::uint32_t port = 0) {
  tiller::Config c = plain_config(&model("pendulum"));
  const std::uint32_t first = c.param_count;
  add_effect(c, kind, port);
  for (std::uint32_t i = first; i < c.param_count; ++i) c.priors[i] = prior;
  return c;
}

TEST(Ports, AreCountedAndNamedByKind) {
  const tiller_model_t& cart = model("cart_pole");
  EXPECT_EQ(port_count(PortKind::joint, cart), cart.joint_count);
  EXPECT_EQ(port_count(PortKind::input, cart), 1u);
  EXPECT_EQ(port_count(PortKind::sensor, cart), 4u);
  EXPECT_EQ(port_count(PortKind::body, cart), 1u);
  EXPECT_STREQ(port_name(PortKind::joint, cart, 1), cart.joints[1].name);
  EXPECT_STREQ(port_name(PortKind::input, cart, 0), cart.input_names[0]);
  EXPECT_STREQ(port_name(PortKind::sensor, cart, 3), cart.state_names[3]);
  EXPECT_STREQ(port_name(PortKind::body, cart, 0), "body");
  for (const PortKind kind : {PortKind::joint, PortKind::input, PortKind::sensor, PortKind::body})
    EXPECT_STREQ(port_name(kind, cart, TILLER_EVERY_PORT), "all");
}

TEST(Ports, FitWhereTheJointHasWhatTheEffectNeeds) {
  const tiller_model_t &cart = model("cart_pole"), &quadrotor = model("quadrotor");
  const EffectInfo& friction = effect_info(tiller_effect_viscous_friction);
  const EffectInfo& spring = effect_info(tiller_effect_linear_spring);
  const EffectInfo& servo = effect_info(tiller_effect_position_servo);
  const EffectInfo& bias = effect_info(tiller_effect_sensor_bias);
  EXPECT_TRUE(port_fits(friction, 1, cart));
  EXPECT_FALSE(port_fits(friction, cart.joint_count, cart)) << "no such joint";
  for (std::uint32_t j = 0; j < quadrotor.joint_count; ++j)
    EXPECT_EQ(port_fits(spring, j, quadrotor), quadrotor.joints[j].position != TILLER_NO_POSITION) << j;
  EXPECT_TRUE(port_fits(servo, 0, cart)) << "the cart's joint has a drive and a position";
  EXPECT_FALSE(port_fits(servo, 1, cart));
  // four states are one reading
  for (std::uint32_t i = 0; i < quadrotor.state_count; ++i) {
    bool of_quaternion = false;
    for (std::uint32_t first = 0; first < quadrotor.state_count; ++first)
      of_quaternion |= ((quadrotor.quaternion_mask >> first) & 1u) != 0 && i >= first && i < first + 4;
    EXPECT_EQ(port_fits(bias, i, quadrotor), !of_quaternion) << quadrotor.state_names[i];
  }
}

TEST(Ports, AllIsAtLeastTwo) {
  const tiller_model_t &pendulum = model("pendulum"), &cart = model("cart_pole");
  const EffectInfo& friction = effect_info(tiller_effect_viscous_friction);
  EXPECT_FALSE(port_fits(friction, TILLER_EVERY_PORT, pendulum)) << "it has one joint";
  EXPECT_TRUE(port_fits(friction, TILLER_EVERY_PORT, cart));
  EXPECT_EQ(ports_of(friction, TILLER_EVERY_PORT, cart), 2u);
  EXPECT_EQ(first_port(friction, TILLER_EVERY_PORT, cart), 0u);
  EXPECT_EQ(first_port(friction, 1, cart), 1u);
  EXPECT_EQ(ports_of(friction, 1, cart), 1u);
}

TEST(Ports, AKindThatThereIsNotHasNoHook) {
  EXPECT_EQ(find_effect("perpetuum_mobile"), -1);
  EXPECT_EQ(hook_of(effect_kind_count()), Hook::sensor);
  EXPECT_NE(hook_of(tiller_effect_viscous_friction), Hook::sensor);
}

TEST(StepSetup, RefusesEffectsThatDoNotFit) {
  tiller::Config c = plain_config(&model("pendulum"));
  EXPECT_EQ(status_of(c), tiller_status_ok);
  c.effect_count = TILLER_MAX_EFFECTS + 1;
  EXPECT_EQ(status_of(c), tiller_status_bad_effect);
  c.effect_count = 0;
  add_effect(c, tiller_effect_viscous_friction, 0);
  EXPECT_EQ(status_of(c), tiller_status_ok);
  c.effects[0].port = 1;
  EXPECT_EQ(status_of(c), tiller_status_bad_effect) << "no such joint";
  c.effects[0] = {effect_kind_count(), 0};
  EXPECT_EQ(status_of(c), tiller_status_bad_effect) << "no such kind";
}

TEST(StepSetup, CountsParametersAsTheConfigurationDoes) {
  tiller::Config c = plain_config(&model("pendulum"));
  add_effect(c, tiller_effect_viscous_friction, 0);
  ++c.param_count;
  EXPECT_EQ(status_of(c), tiller_status_bad_dimension);
  c.param_count -= 2;
  EXPECT_EQ(status_of(c), tiller_status_bad_dimension);
}

/// Effects of one kind until something has no more room: parameters, states of effects, or lags.
std::uint32_t most_of(std::uint32_t kind) {
  tiller::Config c = plain_config(&model("pendulum"));
  std::uint32_t count = 0;
  while (count < TILLER_MAX_EFFECTS) {
    add_effect(c, kind, 0);
    if (status_of(c) != tiller_status_ok) break;
    ++count;
  }
  return count;
}

TEST(StepSetup, HasRoomForSoManyOfEach) {
  const auto room = [](std::uint32_t kind) {
    const EffectInfo& info = effect_info(kind);
    const auto params = static_cast<std::uint32_t>(info.param_count),
               states = static_cast<std::uint32_t>(info.state_count);
    const std::uint32_t by_params = (TILLER_MAX_PARAMS - model("pendulum").param_count) / params;
    const std::uint32_t by_states = states > 0 ? TILLER_MAX_EFFECT_STATES / states : TILLER_MAX_EFFECTS;
    return std::min(std::min(by_params, by_states), std::uint32_t{TILLER_MAX_EFFECTS});
  };
  for (const std::uint32_t kind : {tiller_effect_viscous_friction, tiller_effect_stribeck_friction,
                                   tiller_effect_lugre_friction, tiller_effect_backlash})
    EXPECT_EQ(most_of(kind), room(kind)) << effect_info(kind).name;
  EXPECT_EQ(most_of(tiller_effect_actuator_lag), std::min(room(tiller_effect_actuator_lag), std::uint32_t{8}));
}

TEST(StepSetup, ADelayHasABoundOfSoManyPeriods) {
  const auto rows = [](const tiller_prior_t& prior) {
    StepSetup setup;
    const tiller::Config c = pendulum_with(tiller_effect_input_delay, prior);
    const tiller_status_t status = make_step_setup(c, setup);
    return status == tiller_status_ok ? static_cast<int>(setup.delay_steps) : -1;
  };
  constexpr double kPeriod = 0.02;
  EXPECT_EQ(rows({tiller_prior_fixed, 0, 0.0, 0, 0, 0}), 0);
  EXPECT_EQ(rows({tiller_prior_fixed, 0, 2.5 * kPeriod, 0, 0, 0}), 3);
  EXPECT_EQ(rows({tiller_prior_fixed, 0, -kPeriod, 0, 0, 0}), -1);
  EXPECT_EQ(rows({tiller_prior_fixed, 0, std::nan(""), 0, 0, 0}), -1);
  EXPECT_EQ(rows({tiller_prior_uniform, 0, 0, 0, 0.0, 2.0 * kPeriod}), 2);
  EXPECT_EQ(rows({tiller_prior_uniform, 0, 0, 0, 0.0, TILLER_MAX_DELAY_STEPS * kPeriod}), TILLER_MAX_DELAY_STEPS);
  EXPECT_EQ(rows({tiller_prior_uniform, 0, 0, 0, 0.0, (TILLER_MAX_DELAY_STEPS + 0.5) * kPeriod}), -1);
  EXPECT_EQ(rows({tiller_prior_normal, 0, 0.02, 0.01, 0.0, kInf}), -1) << "no bound to lay memory out by";
}

TEST(StepSetup, RefusesLearntForcesWithoutTheirNetwork) {
  tiller::Config c = plain_config(&model("pendulum"));
  add_effect(c, tiller_effect_network, 0);
  EXPECT_EQ(status_of(c), tiller_status_bad_effect) << "no network";
  tiller_network_t network = {};
  c.network = &network;
  EXPECT_EQ(status_of(c), tiller_status_bad_effect) << "not one that network_check passes";
}

/// White noise of the velocity's force over a period: an integrated Wiener process, joint by joint; what is no velocity
/// of a joint with a position grows by itself, and quaternions by their angular velocities alone.
TEST(StateSpread, IsTheIntegratedWienerProcess) {
  for (const char* name : {"cart_pole", "quadrotor", "skid_steer"}) {
    const tiller_model_t& m = model(name);
    const std::uint32_t n = m.state_count;
    std::vector<double> sd(n), covariance(n * n, -1.0);
    for (std::uint32_t i = 0; i < n; ++i) sd[i] = 0.1 * (i + 1);
    constexpr double h = 0.02;
    fill_process_covariance(m, sd.data(), h, covariance.data());
    std::vector<double> wanted(n * n, 0.0);
    for (std::uint32_t i = 0; i < n; ++i)
      wanted[i * n + i] = ((m.quaternion_mask >> i) & 1u) != 0 ? 0.0 : sd[i] * sd[i] * h;
    for (std::uint32_t j = 0; j < m.joint_count; ++j) {
      const std::uint32_t x = m.joints[j].position, v = m.joints[j].velocity;
      if (x == TILLER_NO_POSITION) continue;
      wanted[x * n + x] += sd[v] * sd[v] * h * h * h / 3.0;
      wanted[x * n + v] = wanted[v * n + x] = sd[v] * sd[v] * h * h / 2.0;
    }
    for (std::uint32_t i = 0; i < n * n; ++i) EXPECT_NEAR(covariance[i], wanted[i], 1e-18) << name << ' ' << i;
  }
}

}  // namespace
}  // namespace tiller
