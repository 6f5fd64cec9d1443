#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rig.hpp"
#include "tiller/config.hpp"

// The built-in models steered on plants that share no code with them.

namespace {

using rig::CartPolePlant;
using rig::Loop;
using rig::PendulumPlant;

TEST(ClosedLoop, PendulumStandsUnderEveryPlanner) {
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    PendulumPlant plant;
    tiller::Config config = rig::pendulum_config();
    config.planner.kind = kind;
    // a gradient from hanging leads to where the torque just holds the pendulum; it takes samples to find that it
    // pumps. 2.8 rad is within what the torque lifts at once (sin 2.8 m g l = 2 N m of 3)
    if (kind == tiller_planner_ilqr || kind == tiller_planner_sqp) plant.angle_rad = config.initial_state[0] = 2.8;
    // random shooting refines nothing: it needs the samples
    if (kind == tiller_planner_random_shooting) config.planner.rollouts = 512;
    Loop loop(config, plant);
    ASSERT_TRUE(loop.ready());
    loop.activate(1);
    loop.run(400);
    const tiller_info_t info = loop.info();
    std::printf("planner %u: after 8 s angle %.3f rad, mass %.3f +- %.3f kg (truth 1.2), state %s\n", kind,
                plant.angle_rad, info.param_mean[0], info.param_sd[0], tiller_state_name(loop.state()));
    EXPECT_LT(std::cos(plant.angle_rad), -0.98) << "within 0.2 rad of upright";
    EXPECT_EQ(loop.state(), tiller_state_active);
    EXPECT_TRUE(loop.commands_allowed());
    // the prior is uniform over +-0.4 kg (sd 0.23); a swing-up tells the mass far better than a tenth of that
    EXPECT_NEAR(info.param_mean[0], 1.2, 0.05);
    EXPECT_LT(info.param_sd[0], 0.023);
  }
}

/// The energy that the pendulum lacks to stand, as a share of what lifting it takes; counts its calls.
double energy_cost(const double* x, const double* u, const double* p, double, void* context) {
  ++*static_cast<std::uint64_t*>(context);
  const double height = 0.5 * (1.0 - std::cos(x[0]));
  const double share = x[1] * x[1] * p[1] / (4.0 * 9.81) + height - 1.0;
  return 20.0 * share * share + 2.0 * (1.0 - height) + 0.01 * u[0] * u[0];
}
double energy_at_the_end(const double* x, const double* p, double time_s, void* context) {
  const double none = 0.0;
  return 10.0 * energy_cost(x, &none, p, time_s, context);
}

// No weight but that of the cost in C: what stands, stands by it alone.
TEST(ClosedLoop, OwnCostInCStandsThePendulum) {
  std::uint64_t calls = 0;
  const tiller_own_cost_t own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, energy_cost, energy_at_the_end,
                                 &calls};
  tiller::Config config = rig::pendulum_config();
  for (int i = 0; i < 2; ++i) config.cost.state_weight[i] = config.cost.terminal_weight[i] = 0.0;
  config.cost.own = &own;
  config.planner.knots = 10;
  config.planner.horizon = 50;
  for (const double weight : {1.0, 0.0}) {
    config.cost.own_weight = weight;
    calls = 0;
    PendulumPlant plant;
    Loop loop(config, plant);
    ASSERT_TRUE(loop.ready());
    loop.activate(1);
    loop.run(400);
    std::printf("own weight %.0f: after 8 s angle %.3f rad, %llu calls\n", weight, plant.angle_rad,
                static_cast<unsigned long long>(calls));
    if (weight > 0.0) {
      EXPECT_LT(std::cos(plant.angle_rad), -0.98) << "within 0.2 rad of upright";
      EXPECT_GT(calls, 400u * 128u * 40u);
    } else {
      EXPECT_GT(std::cos(plant.angle_rad), 0.0) << "nothing asks for it";
      EXPECT_EQ(calls, 0u);
    }
    EXPECT_EQ(loop.state(), tiller_state_active);
    EXPECT_TRUE(loop.commands_allowed());
  }
}

// A trajectory that only the reference knows: half a turn away and back.
TEST(ClosedLoop, AReferenceIsFollowedFromTheBeginningOfTheTask) {
  double rows[2 * 200];
  for (int k = 0; k < 200; ++k) {
    rows[2 * k] = 0.5 * std::sin(0.04 * k);  // rad, one period in 3.1 s
    rows[2 * k + 1] = 0.5 * 2.0 * std::cos(0.04 * k);
  }
  tiller::Config config = rig::pendulum_config();
  config.cost.reference = rows;
  config.cost.reference_steps = 200;
  config.cost.target[0] = 0.0;
  config.planner.horizon = 20;
  PendulumPlant plant;
  Loop loop(config, plant);
  ASSERT_TRUE(loop.ready());
  loop.run(50);  // the task begins with the motion, not with the controller
  (void)tiller_arm(loop.controller());
  double worst = 0.0;
  for (int k = 0; k < 200; ++k) {
    if (k >= 50) worst = std::max(worst, std::fabs(plant.angle_rad - rows[2 * k]));
    (void)loop.tick();
  }
  std::printf("largest deviation from the reference after 1 s: %.3f rad\n", worst);
  // a tenth of the amplitude, and well below the 0.5 rad s^-1 * 1 s that a task begun with the controller would show
  EXPECT_LT(worst, 0.05);
}

TEST(ClosedLoop, CartPoleStands) {
  CartPolePlant plant;
  Loop loop(rig::cart_pole_config(), plant);
  ASSERT_TRUE(loop.ready());
  loop.activate(1);
  loop.run(400);
  const tiller_info_t info = loop.info();
  std::printf(
      "cart-pole: after 8 s angle %.3f rad, position %.3f m, pole %.3f +- %.3f kg (truth 0.12), "
      "half length %.3f +- %.3f m (truth 0.45)\n",
      plant.x[1], plant.x[0], info.param_mean[1], info.param_sd[1], info.param_mean[2], info.param_sd[2]);
  EXPECT_GT(std::cos(plant.x[1]), 0.98) << "within 0.2 rad of upright";
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_TRUE(loop.commands_allowed());
  EXPECT_NEAR(info.param_mean[2], 0.45, 0.05);
}

TEST(ClosedLoop, KnownLatencyIsPlannedFor) {
  // each command takes hold 15 of 20 ms after its measurement; the controller is told
  const auto run = [](std::uint32_t told_us) {
    PendulumPlant plant;
    Loop loop(rig::pendulum_config(), plant);
    (void)tiller_arm(loop.controller());
    double before = 0.0, error = 0.0;
    for (int i = 0; i < 400; ++i) {
      tiller_measurement_t m = loop.measure();
      m.command_latency_us = told_us;
      tiller_command_t command;
      (void)tiller_tick(loop.controller(), m.stamp_us, &m, &command);
      plant.step(&before, 0.015);
      plant.step(command.value, 0.005);
      before = command.value[0];
      loop.pass(20000);
      const double off = std::remainder(plant.angle_rad - 3.141592653589793, 6.283185307179586);
      if (i >= 300) error += off * off / 100.0;
    }
    const tiller_info_t info = loop.info();
    std::printf("told %u us: mass %.4f +- %.4f kg (truth 1.2), rms angle error %.4f rad, noise scale %.2f\n", told_us,
                info.param_mean[0], info.param_sd[0], std::sqrt(error), info.noise_scale);
    return info;
  };
  const tiller_info_t told = run(15000), untold = run(0);
  EXPECT_NEAR(told.param_mean[0], 1.2, 0.02);
  EXPECT_LT(5.0 * told.param_sd[0], untold.param_sd[0]) << "commands at the wrong time look like noise of the process";
}

/// Mean of 1 + cos(angle) over the last 4 of 10 s (0: upright) with a motor that answers 110 ms late.
double fall_behind_delay(std::uint64_t seed, bool known, bool predicted) {
  PendulumPlant plant;
  tiller::Config config = rig::pendulum_config();
  config.seed = seed;
  if (known) {
    config.effect_count = 1;
    config.effects[0] = {tiller_effect_input_delay, 0};
    config.param_count = 4;
    config.priors[3] = {tiller_prior_fixed, 0, 0.11, 0.0, -INFINITY, INFINITY};
  }
  config.planner.predict_delay = predicted;
  Loop loop(config, plant);
  EXPECT_TRUE(loop.ready());
  (void)tiller_arm(loop.controller());
  double sent[6] = {}, off = 0.0;  // newest first
  for (int i = 0; i < 500; ++i) {
    const tiller_measurement_t m = loop.measure();
    tiller_command_t command;
    (void)tiller_tick(loop.controller(), m.stamp_us, &m, &command);
    plant.step(&sent[5], 0.01);
    plant.step(&sent[4], 0.01);
    std::copy_backward(sent, sent + 5, sent + 6);
    sent[0] = command.value[0];
    loop.pass(20000);
    if (i >= 300) off += (1.0 + std::cos(plant.angle_rad)) / 200.0;
  }
  return off;
}

TEST(ClosedLoop, DelayIsPlannedForInTheRolloutsOrAheadOfThem) {
  for (const std::uint64_t seed : {1001u, 1002u, 1003u}) {
    const double ignored = fall_behind_delay(seed, false, false), rolled = fall_behind_delay(seed, true, false),
                 predicted = fall_behind_delay(seed, true, true);
    std::printf("110 ms delay, 1 + cos(angle): ignored %.1e, in the rollouts %.1e, predicted %.1e\n", ignored, rolled,
                predicted);
    EXPECT_GT(ignored, 0.01) << "or the delay were no difficulty";
    EXPECT_LT(predicted, 1e-3) << "it stands within 0.05 rad";
    EXPECT_LT(rolled, 1e-3);
  }
}

}  // namespace
