// Plans that find out, and calibrations, behind the C interface: what they promise and what they refuse.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

using rig::Loop;
using rig::PendulumPlant;

/// The pendulum at rest below, which it is to hold: nothing needs to be known for that.
tiller::Config resting_config() {
  tiller::Config c = rig::pendulum_config();
  c.initial_state[0] = c.initial_state[1] = 0.0;
  std::fill(c.cost.target, c.cost.target + 2, 0.0);
  c.probe.weight = 1.0;
  return c;
}

tiller_box_t box_of(const double* state_low, const double* state_high, const double* input_low = nullptr,
                    const double* input_high = nullptr) {
  return {sizeof(tiller_box_t), TILLER_CONFIG_VERSION, state_low, state_high, input_low, input_high};
}

constexpr double kLow[] = {-0.8, -6.0}, kHigh[] = {0.8, 6.0};

/// Deviations of the parameters that are learnt, over those of the prior.
double width(const tiller_info_t& info, const std::vector<double>& prior_sd) {
  double product = 1.0;
  for (std::size_t i = 0; i < prior_sd.size(); ++i)
    if (prior_sd[i] > 0.0) product *= info.param_sd[i] / prior_sd[i];
  return product;
}

std::vector<double> deviations(const tiller_info_t& info) { return {info.param_sd, info.param_sd + 3}; }

TEST(Probe, WhereNothingIsUnknownThePlanStandsToTheLastBit) {
  tiller::Config on = resting_config();
  for (std::uint32_t i = 0; i < on.param_count; ++i)
    if (on.priors[i].kind == tiller_prior_uniform)
      on.priors[i] = {tiller_prior_fixed, 0, 0.5 * (on.priors[i].low + on.priors[i].high), 0.0, -HUGE_VAL, HUGE_VAL};
  tiller::Config off = on;
  off.probe.weight = 0.0;
  PendulumPlant a, b;
  a.angle_rad = b.angle_rad = 0.05;
  Loop with(on, a), without(off, b);
  with.activate();
  without.activate();
  for (int k = 0; k < 100; ++k) {
    (void)with.tick();
    (void)without.tick();
    ASSERT_EQ(std::memcmp(with.command().value, without.command().value, sizeof(double)), 0) << "tick " << k;
  }
  EXPECT_EQ(with.info().probed_ticks, 0u);
  EXPECT_EQ(with.info().probe_spent, 0.0);
}

TEST(Probe, ASwingUpIsRepeatedToTheLastBit) {
  tiller::Config c = rig::pendulum_config();
  c.probe.weight = 1.0;
  PendulumPlant a, b;
  Loop first(c, a), second(c, b);
  first.activate();
  second.activate();
  for (int k = 0; k < 150; ++k) {
    (void)first.tick();
    (void)second.tick();
    ASSERT_EQ(std::memcmp(first.command().value, second.command().value, sizeof(double)), 0) << "tick " << k;
  }
  const tiller_info_t info = first.info();
  EXPECT_LE(info.probe_spent, info.probe_allowed + c.probe.budget * std::fmax(info.plan_cost, 0.0) + 1e-9);
  EXPECT_TRUE(first.commands_allowed());
}

TEST(Probe, ACalibrationLearnsInItsBoxAndEndsByItself) {
  PendulumPlant plant;
  Loop loop(resting_config(), plant);
  const std::vector<double> prior = deviations(loop.info());
  const double torque_low[] = {-1.5}, torque_high[] = {1.5};
  const tiller_box_t box = box_of(kLow, kHigh, torque_low, torque_high);
  constexpr std::uint32_t kPeriods = 150;
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, kPeriods), tiller_status_ok);
  EXPECT_EQ(loop.info().calibration_left, kPeriods);
  loop.activate(1);
  double farthest = 0.0, fastest = 0.0, strongest = 0.0;
  int ticks = 0;
  while (loop.info().calibration_left > 0 && ++ticks < 400) {
    (void)loop.tick();
    farthest = std::fmax(farthest, std::fabs(plant.angle_rad));
    fastest = std::fmax(fastest, std::fabs(plant.rate_rad_s));
    strongest = std::fmax(strongest, std::fabs(loop.command().value[0]));
  }
  EXPECT_LT(ticks, static_cast<int>(kPeriods) + 5);
  EXPECT_LE(farthest, kHigh[0] * 1.02);
  EXPECT_LE(fastest, kHigh[1] * 1.02);
  EXPECT_LE(strongest, 1.5 + 1e-9);
  EXPECT_GT(farthest, 0.2);  // it moved
  EXPECT_LT(width(loop.info(), prior), 0.1);
  (void)loop.tick();
  EXPECT_NE(loop.info().probing, static_cast<std::uint32_t>(tiller_probing_calibrate));
}

TEST(Probe, ACalibrationTellsMoreThanHoldingStill) {
  PendulumPlant still_plant, moved_plant;
  tiller::Config off = resting_config();
  off.probe.weight = 0.0;
  Loop still(off, still_plant), moved(resting_config(), moved_plant);
  const std::vector<double> prior = deviations(moved.info());
  const tiller_box_t box = box_of(kLow, kHigh);
  ASSERT_EQ(tiller_calibrate(moved.controller(), &box, 100), tiller_status_ok);
  still.activate(1);
  moved.activate(1);
  still.run(100);
  moved.run(100);
  EXPECT_LT(10.0 * width(moved.info(), prior), width(still.info(), prior));
}

TEST(Probe, ACalibrationEndsOnceEnoughIsKnown) {
  PendulumPlant plant;
  tiller::Config c = resting_config();
  c.until_sd[0] = 0.2;
  Loop loop(c, plant);
  ASSERT_GT(loop.info().param_sd[0], 0.2);
  const tiller_box_t box = box_of(kLow, kHigh);
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, 1000), tiller_status_ok);
  loop.activate(1);
  int ticks = 0;
  while (loop.info().calibration_left > 0 && ++ticks < 1000) (void)loop.tick();
  EXPECT_LT(ticks, 900);
  EXPECT_LE(loop.info().param_sd[0], 0.2);
  EXPECT_EQ(loop.info().probing, static_cast<std::uint32_t>(tiller_probing_none));
}

TEST(Probe, TheTaskBeginsBehindTheCalibration) {
  PendulumPlant plant;
  tiller::Config c = resting_config();
  // a reference that leaves rest at row 100: without a calibration that would be over by then
  std::vector<double> reference(2 * 200, 0.0);
  for (int k = 100; k < 200; ++k) reference[2 * k] = 0.5;
  c.cost.reference = reference.data();
  c.cost.reference_steps = 200;
  Loop loop(c, plant);
  const tiller_box_t box = box_of(kLow, kHigh);
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, 60), tiller_status_ok);
  loop.activate(1);
  loop.run(110);
  EXPECT_LT(std::fabs(plant.angle_rad), 0.25);
  loop.run(150);
  EXPECT_NEAR(plant.angle_rad, 0.5, 0.15);
}

TEST(Probe, SafeEndsACalibrationAndRefusesOne) {
  PendulumPlant plant;
  Loop loop(resting_config(), plant);
  const tiller_box_t box = box_of(kLow, kHigh);
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, 1000), tiller_status_ok);
  loop.activate(1);
  loop.run(20);
  ASSERT_EQ(tiller_stop(loop.controller(), tiller_status_stopped), tiller_status_ok);
  (void)loop.tick();
  EXPECT_EQ(loop.state(), tiller_state_safe);
  EXPECT_EQ(loop.command().value[0], 0.0);
  EXPECT_EQ(loop.info().probing, static_cast<std::uint32_t>(tiller_probing_none));
  EXPECT_EQ(loop.info().calibration_left, 0u);
  EXPECT_EQ(tiller_calibrate(loop.controller(), &box, 10), tiller_status_wrong_state);
}

TEST(Probe, FromOutsideOfTheBoxTheWayBackComesFirst) {
  PendulumPlant plant;
  plant.angle_rad = 1.1;
  tiller::Config c = rig::pendulum_config();  // whose task leads further away
  c.probe.weight = 1.0;
  c.initial_state[0] = 1.1;
  Loop loop(c, plant);
  const tiller_box_t box = box_of(kLow, kHigh);
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, 200), tiller_status_ok);
  loop.activate(1);
  loop.run(50);
  double farthest = 0.0;
  for (int k = 0; k < 100; ++k) {
    (void)loop.tick();
    farthest = std::fmax(farthest, std::fabs(plant.angle_rad));
  }
  EXPECT_LE(farthest, kHigh[0] * 1.02);
}

TEST(Probe, ACalibrationThatWasAskedForDoesNotOutliveAStop) {
  PendulumPlant plant;
  Loop loop(resting_config(), plant);
  const tiller_box_t box = box_of(kLow, kHigh);
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, 100), tiller_status_ok);
  ASSERT_EQ(tiller_stop(loop.controller(), tiller_status_stopped), tiller_status_ok);
  (void)loop.tick();
  ASSERT_EQ(tiller_reset(loop.controller()), tiller_status_ok);
  loop.activate(1);
  loop.run(5);
  EXPECT_EQ(loop.info().calibration_left, 0u);
  EXPECT_NE(loop.info().probing, static_cast<std::uint32_t>(tiller_probing_calibrate));
}

TEST(Probe, BadBoxesAreRefused) {
  PendulumPlant plant;
  Loop loop(resting_config(), plant);
  tiller_t* const t = loop.controller();
  const double empty_low[] = {0.5, -1.0}, empty_high[] = {-0.5, 1.0}, nan[] = {NAN, -1.0};
  const double beyond[] = {1e3}, below[] = {-1e3};
  tiller_box_t box = box_of(empty_low, empty_high);
  EXPECT_EQ(tiller_calibrate(t, &box, 10), tiller_status_bad_limit);
  box = box_of(nan, kHigh);
  EXPECT_EQ(tiller_calibrate(t, &box, 10), tiller_status_bad_limit);
  box = box_of(kLow, kHigh, below, beyond);
  EXPECT_EQ(tiller_calibrate(t, &box, 10), tiller_status_bad_limit);
  box = box_of(kLow, kHigh);
  box.version = 1;
  EXPECT_EQ(tiller_calibrate(t, &box, 10), tiller_status_version_mismatch);
  EXPECT_EQ(tiller_calibrate(t, nullptr, 10), tiller_status_null_argument);
  EXPECT_EQ(tiller_calibrate(nullptr, &box, 10), tiller_status_null_argument);
  EXPECT_EQ(tiller_calibrate(t, nullptr, 0), tiller_status_ok);
  EXPECT_EQ(loop.info().calibration_left, 0u);

  tiller::Config off = resting_config();
  off.probe.weight = 0.0;
  Loop without(off, plant);
  box = box_of(kLow, kHigh);
  EXPECT_EQ(tiller_calibrate(without.controller(), &box, 10), tiller_status_bad_planner);
}

/// Measurements that are missing, not numbers or wild while it calibrates: commands stay allowed, and SAFE answers.
TEST(Probe, BrokenSensorsStopACalibration) {
  PendulumPlant plant;
  Loop loop(resting_config(), plant);
  const tiller_box_t box = box_of(kLow, kHigh);
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, 1000), tiller_status_ok);
  loop.activate(1);
  loop.run(30);
  for (int k = 0; k < 60; ++k) {
    tiller_measurement_t m = loop.measure();
    m.value[0] = k % 2 == 0 ? NAN : INFINITY;
    (void)loop.tick(&m);
  }
  EXPECT_EQ(loop.state(), tiller_state_safe);
  EXPECT_TRUE(loop.commands_allowed());
}

/// A joint may have a velocity alone, and an attitude four states.
TEST(Probe, AQuadrotorIsCalibratedWithinItsTilt) {
  class Still : public rig::Plant {
   public:
    void step(const double*, double) override {}
    void measure(double* value) const override { value[3] = 1.0; }
  };
  tiller::Config c;
  ASSERT_EQ(tiller_config_default(&c, tiller_find_model("quadrotor")), tiller_status_ok);
  const double nominal[] = {0.8, 0.17, 0.005, 0.005, 0.009, 0.016, 0.1};
  for (int i = 0; i < 7; ++i) c.priors[i] = {tiller_prior_fixed, 0, nominal[i], 0.0, -HUGE_VAL, HUGE_VAL};
  c.priors[0] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.5, 1.1};
  c.measurement_count = 7;
  for (std::uint8_t i = 0; i < 7; ++i) c.measured_state[i] = i;
  std::fill(c.measurement_sd, c.measurement_sd + 7, 0.002);
  std::fill(c.cost.state_weight, c.cost.state_weight + 3, 10.0);
  std::fill(c.cost.input_weight, c.cost.input_weight + 4, 0.01);
  std::fill(c.safety.input_high, c.safety.input_high + 4, 5.0);
  c.planner.kind = tiller_planner_mppi;
  c.planner.horizon = 20;
  c.planner.rollouts = 64;
  c.safety.frozen_ticks = 0;
  c.posterior.adequacy = 0;
  c.probe.weight = 1.0;
  Still plant;
  Loop loop(c, plant);
  ASSERT_TRUE(loop.ready());
  double low[13], high[13];
  std::fill(low, low + 13, -1.0);
  std::fill(high, high + 13, 1.0);
  const tiller_box_t box = box_of(low, high);
  ASSERT_EQ(tiller_calibrate(loop.controller(), &box, 20), tiller_status_ok);
  loop.activate(1);
  int calibrating = 0;
  for (int k = 0; k < 10 && loop.state() == tiller_state_active; ++k) {
    (void)loop.tick();
    calibrating += loop.info().probing == static_cast<std::uint32_t>(tiller_probing_calibrate);
    EXPECT_TRUE(std::isfinite(loop.info().probe_information));
  }
  EXPECT_GT(calibrating, 0);
  EXPECT_TRUE(loop.commands_allowed());
}

TEST(Probe, EveryPlannerCanBeProbedBesideButAPolicy) {
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    tiller::Config c = rig::pendulum_config();
    c.probe.weight = 1.0;
    c.planner.kind = kind;
    const char* field = "";
    const tiller_status_t status = tiller_config_check(&c, &field);
    if (kind == tiller_planner_policy) {
      EXPECT_EQ(status, tiller_status_bad_planner);
      EXPECT_STREQ(field, "probe.weight");
      continue;
    }
    ASSERT_EQ(status, tiller_status_ok) << kind << " " << field;
    PendulumPlant plant;
    Loop loop(c, plant);
    ASSERT_TRUE(loop.ready()) << kind;
    loop.activate();
    loop.run(40);
    EXPECT_EQ(loop.state(), tiller_state_active) << kind;
    EXPECT_TRUE(loop.commands_allowed()) << kind;
    EXPECT_TRUE(loop.block().canaries_alive()) << kind;
    EXPECT_TRUE(std::isfinite(loop.info().probe_value) && std::isfinite(loop.info().probe_spent)) << kind;
  }
}

}  // namespace
