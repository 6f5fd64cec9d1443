// A robot that has turned a million times is steered as one that has not.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

using rig::Block;
using rig::Loop;
using rig::PendulumPlant;

constexpr double kTurn_rad = 6.283185307179586;

/// Every parameter known: what the posterior learns is no part of the comparison.
tiller::Config known_pendulum(std::uint32_t planner) {
  tiller::Config c = rig::pendulum_config();
  const double truth[] = {1.2, 0.5, 0.08};
  for (int i = 0; i < 3; ++i) c.priors[i] = {tiller_prior_fixed, 0, truth[i], 0.0, truth[i], truth[i]};
  c.planner.kind = planner;
  c.initial_state[0] = 0.3;
  c.measurement_low[0] = -INFINITY;
  c.measurement_high[0] = INFINITY;
  c.measurement_rate_per_s[0] = INFINITY;
  return c;
}

/// A controller without a plant: it is shown another one's readings.
class Shown {
 public:
  explicit Shown(const tiller_config_t& config) : block_(tiller_size(&config)) {
    EXPECT_EQ(tiller_init(&t_, &config, nullptr, block_.memory(), block_.size()), tiller_status_ok);
    (void)tiller_arm(t_);
  }
  double tick(std::int64_t now_us, const tiller_measurement_t& m) {
    (void)tiller_tick(t_, now_us, &m, &command_);
    return command_.value[0];
  }
  tiller_t* controller() { return t_; }
  tiller_state_t state() const { return static_cast<tiller_state_t>(command_.state); }

 private:
  Block block_;
  tiller_t* t_ = nullptr;
  tiller_command_t command_ = {};
};

/// Moves all that a configuration says of the angle by so much.
tiller::Config turned(tiller::Config c, double angle_rad) {
  c.initial_state[0] += angle_rad;
  c.cost.target[0] += angle_rad;
  c.state_low[0] += angle_rad;
  c.state_high[0] += angle_rad;
  return c;
}

/// Largest difference of the commands over a swing up, in Nm.
double worst_difference(const tiller_config_t& config, double angle_rad, int ticks) {
  PendulumPlant plant;
  plant.angle_rad = config.initial_state[0];
  Loop near(config, plant);
  Shown far(turned(config, angle_rad));
  (void)tiller_arm(near.controller());
  double worst = 0.0;
  for (int k = 0; k < ticks; ++k) {
    tiller_measurement_t m = near.measure();
    const std::int64_t now_us = near.now_us();
    (void)near.tick(&m);
    m.value[0] += angle_rad;
    const double command_Nm = far.tick(now_us, m);
    EXPECT_EQ(far.state(), near.state()) << k;
    worst = std::max(worst, std::fabs(command_Nm - near.command().value[0]));
  }
  return worst;
}

TEST(Turns, MillionOfThemChangeNoCommand) {
  for (const std::uint32_t planner : {tiller_planner_random_shooting, tiller_planner_cem, tiller_planner_mppi,
                                      tiller_planner_mcts, tiller_planner_ilqr, tiller_planner_sqp}) {
    const double worst = worst_difference(known_pendulum(planner), 1e6 * kTurn_rad, 10);
    std::printf("planner %u: %.1e Nm\n", planner, worst);
    // an encoder's number ends at 1e-9 rad there, 5e-8 rad/s in the rate: the last bit of single precision, which
    // planners make up to 1e-3 Nm of; half a radian, all that single precision knows there, makes newtons
    EXPECT_LT(worst, 0.01) << "planner " << planner;
  }
}

TEST(Turns, BoundsAndTargetsGoWithThem) {
  for (const std::uint32_t planner : {tiller_planner_mppi, tiller_planner_ilqr, tiller_planner_sqp}) {
    tiller::Config config = known_pendulum(planner);
    config.state_low[0] = -0.2;
    config.state_high[0] = 0.5;
    config.bound_weight[0] = 500.0;
    config.cost.hard_bounds = planner == tiller_planner_sqp ? 1u : 0u;
    const double worst = worst_difference(config, 3e4 * kTurn_rad, 10);
    std::printf("planner %u: %.1e Nm\n", planner, worst);
    EXPECT_LT(worst, 0.01) << "planner " << planner;
  }
}

TEST(Turns, RotationWithoutEndKeepsItsCommands) {
  for (const std::uint32_t planner : {tiller_planner_mppi, tiller_planner_ilqr}) {
    tiller::Config config = known_pendulum(planner);
    config.initial_state[1] = 25.0;
    for (double* weight : {config.cost.state_weight, config.cost.terminal_weight}) {
      weight[0] = 0.0;
      weight[1] = 1.0;
    }
    config.cost.target[1] = 25.0;
    PendulumPlant plant;
    plant.angle_rad = 0.3;
    plant.rate_rad_s = 25.0;
    Loop loop(config, plant);
    loop.activate(50);
    double least = 1e9, most = 0.0;
    for (int k = 0; k < 2000; ++k) {  // 40 s, 160 turns: the origin moves nine times
      (void)loop.tick();
      ASSERT_EQ(loop.state(), tiller_state_active) << k;
      least = std::min(least, plant.rate_rad_s);
      most = std::max(most, plant.rate_rad_s);
    }
    std::printf("planner %u: %.0f turns at %.2f to %.2f rad/s\n", planner, plant.angle_rad / kTurn_rad, least, most);
    EXPECT_GT(plant.angle_rad, 150.0 * kTurn_rad);
    EXPECT_NEAR(loop.info().state_mean[0], plant.angle_rad, 0.1 + 25.0 * 0.02) << "the turns are counted on";
    // the torque is half of gravity's: the speed ripples by 6 Nm / (0.3 kg m2) over half a turn whatever it does
    EXPECT_GT(least, 22.0);
    EXPECT_LT(most, 28.0);
  }
}

TEST(Turns, FeedbackIsToldInTheCallersAngles) {
  const double far_rad = 1e4 * kTurn_rad;
  const tiller::Config config = turned(known_pendulum(tiller_planner_ilqr), far_rad);
  PendulumPlant plant;
  plant.angle_rad = config.initial_state[0];
  Loop loop(config, plant);
  loop.activate(3);
  double state[TILLER_MAX_STATES] = {};
  ASSERT_EQ(tiller_get_feedback(loop.controller(), 0, nullptr, state, nullptr), tiller_status_ok);
  EXPECT_NEAR(state[0], loop.info().state_mean[0], 0.2);
}

TEST(Turns, FrozenSensorIsNoticedAfterThem) {
  tiller::Config config = turned(known_pendulum(tiller_planner_mppi), 1e6 * kTurn_rad);
  PendulumPlant plant;
  plant.angle_rad = config.initial_state[0];
  Loop loop(config, plant);
  loop.activate(20);
  ASSERT_EQ(loop.state(), tiller_state_active);
  const double frozen_rad = plant.angle_rad;
  for (int k = 0; k < 40 && loop.state() != tiller_state_safe; ++k) {
    tiller_measurement_t m = loop.measure();
    m.value[0] = frozen_rad;
    (void)loop.tick(&m);
  }
  EXPECT_EQ(loop.state(), tiller_state_safe);
  EXPECT_EQ(loop.info().first_fault, tiller_status_sensor_frozen);
}

}  // namespace
