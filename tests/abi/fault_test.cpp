#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "rig.hpp"
#include "tiller/config.hpp"

// Each fault of the sensors, of time and of the plan, and the state that answers it. docs/reference/safety.md tells the
// same.

namespace {

using rig::Loop;
using rig::PendulumPlant;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

class Fault : public ::testing::Test {
 protected:
  Fault() : loop_(rig::pendulum_config(), plant_) {
    loop_.activate();
    EXPECT_EQ(loop_.state(), tiller_state_active);
  }
  ~Fault() override {
    EXPECT_TRUE(loop_.commands_allowed());
    EXPECT_TRUE(loop_.block().canaries_alive());
  }
  /// Ticks with `spoil` applied to true measurements until SAFE, at most `most`; how many it took.
  template <class F>
  int ticks_to_safe(int most, const F& spoil) {
    for (int i = 1; i <= most; ++i) {
      tiller_measurement_t m = loop_.measure();
      spoil(m);
      last_ = loop_.tick(&m);
      if (loop_.state() == tiller_state_safe) return i;
    }
    return most + 1;
  }
  PendulumPlant plant_;
  Loop loop_;
  tiller_status_t last_ = tiller_status_ok;
};

TEST_F(Fault, NanOnceIsSkippedAndThePlanGoesOn) {
  tiller_measurement_t m = loop_.measure();
  m.value[0] = kNan;
  EXPECT_EQ(loop_.tick(&m), tiller_status_sensor_not_finite);
  EXPECT_EQ(loop_.state(), tiller_state_active);
  EXPECT_EQ(loop_.info().rejected_measurements, 1u);
  (void)loop_.tick();
  EXPECT_EQ(loop_.info().status, tiller_status_ok) << "one good measurement and all is well";
}

// Requirement: SR-7
TEST_F(Fault, NanForEverIsSafeAfterTheConfiguredCount) {
  EXPECT_EQ(ticks_to_safe(10, [](tiller_measurement_t& m) { m.value[0] = kNan; }), 3);
  EXPECT_EQ(last_, tiller_status_sensor_not_finite);
  EXPECT_EQ(loop_.command().value[0], 0.0);
}

TEST_F(Fault, InfinityForEverIsSafe) {
  EXPECT_EQ(ticks_to_safe(10, [](tiller_measurement_t& m) { m.value[0] = -kInf; }), 3);
  EXPECT_EQ(last_, tiller_status_sensor_not_finite);
}

TEST_F(Fault, OutOfRangeIsSafe) {
  EXPECT_EQ(ticks_to_safe(10, [](tiller_measurement_t& m) { m.value[0] = 51.0; }), 3);
  EXPECT_EQ(last_, tiller_status_sensor_out_of_range);
}

TEST_F(Fault, JumpIsRejectedAndTheReturnIsTaken) {
  tiller_measurement_t m = loop_.measure();
  m.value[0] += 2.0;  // 100 rad/s
  EXPECT_EQ(loop_.tick(&m), tiller_status_sensor_jump);
  EXPECT_EQ(loop_.tick(), tiller_status_ok);
  EXPECT_EQ(loop_.state(), tiller_state_active);
}

TEST_F(Fault, TimeBackwardsIsSafe) {
  const std::int64_t stuck = loop_.now_us() - loop_.period_us();
  int i = 0;
  EXPECT_EQ(ticks_to_safe(10, [&](tiller_measurement_t& m) { m.stamp_us = stuck - 1000 * ++i; }), 3);
  EXPECT_EQ(last_, tiller_status_time_backwards);
}

// Requirement: SR-12
TEST_F(Fault, CallersClockBackwardsIsSafe) {
  tiller_command_t command;
  for (int i = 1; i <= 3; ++i) {
    (void)tiller_tick(loop_.controller(), loop_.now_us() - 100000 * i, nullptr, &command);
    EXPECT_TRUE(std::isfinite(command.value[0]));
  }
  EXPECT_EQ(command.state, static_cast<std::uint32_t>(tiller_state_safe));
  EXPECT_EQ(loop_.info().first_fault, tiller_status_time_backwards);
}

// Requirement: SR-7
TEST_F(Fault, SilenceKeepsThePlanAndThenIsSafe) {
  // timeout 0.1 s: the ticks at 20..100 ms of age use the plan, the one at 120 ms is SAFE
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(loop_.tick(nullptr), tiller_status_no_new_measurement) << i;
    EXPECT_EQ(loop_.state(), tiller_state_active) << i;
  }
  EXPECT_EQ(loop_.tick(nullptr), tiller_status_sensor_stale);
  EXPECT_EQ(loop_.state(), tiller_state_safe);
  EXPECT_EQ(loop_.command().value[0], 0.0);
}

TEST_F(Fault, OldStampsAreStale) {
  EXPECT_LE(ticks_to_safe(10, [](tiller_measurement_t& m) { m.stamp_us -= 200000; }), 3);
  EXPECT_EQ(last_, tiller_status_sensor_stale);
}

// Requirement: SR-9
TEST_F(Fault, FrozenReadingsUnderAMovingPlanAreSafe) {
  loop_.run(20);
  const double stuck = loop_.measure().value[0];
  const int ticks = ticks_to_safe(40, [&](tiller_measurement_t& m) { m.value[0] = stuck; });
  EXPECT_LE(ticks, 2 * 10 + 1) << "two windows of frozen_ticks at most";
  EXPECT_EQ(last_, tiller_status_sensor_frozen);
}

TEST(Frozen, ARobotThatRestsIsNotASensorThatDied) {
  // no torque to speak of: the pendulum hangs still, and its encoder repeats to the last bit, rightly
  tiller::Config config = rig::pendulum_config();
  config.safety.input_low[0] = -1e-4;
  config.safety.input_high[0] = 1e-4;
  class Still : public PendulumPlant {
   public:
    void step(const double*, double) override {}
  } plant;
  Loop loop(config, plant);
  loop.activate(300);
  EXPECT_EQ(loop.state(), tiller_state_active) << tiller_status_text(static_cast<tiller_status_t>(loop.info().status));
}

TEST(Missing, OneOfTwoSensorsMayPauseButNotDie) {
  rig::CartPolePlant plant;
  Loop loop(rig::cart_pole_config(), plant);
  loop.activate(20);
  ASSERT_EQ(loop.state(), tiller_state_active);
  for (int i = 0; i < 3; ++i) {
    tiller_measurement_t m = loop.measure();
    m.value[0] = kNan;
    EXPECT_LT(loop.tick(&m), 100) << "working";
    EXPECT_EQ(loop.state(), tiller_state_active);
    EXPECT_EQ(loop.info().planner_iterations, loop.config().planner.iterations) << "planned all the same";
  }
  EXPECT_EQ(loop.info().missing_values, 3u);
  EXPECT_EQ(loop.info().rejected_measurements, 0u);
  (void)loop.tick();
  tiller_status_t last = tiller_status_ok;
  for (int i = 0; i < 6; ++i) {
    tiller_measurement_t m = loop.measure();
    m.value[0] = kNan;
    last = loop.tick(&m);
  }
  EXPECT_EQ(loop.state(), tiller_state_safe) << "0.12 s without a position";
  EXPECT_EQ(last, tiller_status_sensor_stale);
}

TEST(Gap, LongerThanSixteenPeriodsBeginsTheFiltersAnew) {
  PendulumPlant plant;
  tiller::Config config = rig::pendulum_config();
  config.safety.sensor_timeout_s = 1.0;
  Loop loop(config, plant);
  loop.activate(30);
  const std::uint64_t before = loop.info().posterior_failures;
  loop.wait(15 * loop.period_us());
  (void)loop.tick();  // sixteen periods since the last: predicted through
  EXPECT_EQ(loop.info().posterior_failures, before);
  loop.wait(17 * loop.period_us());
  (void)loop.tick();
  EXPECT_EQ(loop.info().posterior_failures, before + 1);
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_TRUE(loop.commands_allowed());
}

TEST(Plan, UsedUpIsHoldAndAMeasurementEndsIt) {
  PendulumPlant plant;
  tiller::Config config = rig::pendulum_config();
  config.planner.horizon = 4;
  config.planner.knots = 2;
  config.safety.sensor_timeout_s = 1.0;
  Loop loop(config, plant);
  loop.activate(10);
  for (int i = 1; i <= 3; ++i) {
    (void)loop.tick(nullptr);
    EXPECT_EQ(loop.state(), tiller_state_active) << "step " << i << " of the plan";
  }
  (void)loop.tick(nullptr);
  EXPECT_EQ(loop.state(), tiller_state_hold);
  EXPECT_EQ(loop.info().plan_failures, 1u);
  const tiller_status_t back = loop.tick();
  EXPECT_TRUE(back == tiller_status_ok || back == tiller_status_tempered) << back;
  EXPECT_EQ(loop.state(), tiller_state_active) << "back by itself";
  EXPECT_EQ(loop.info().first_fault, tiller_status_ok);
  EXPECT_TRUE(loop.commands_allowed());
}

// Requirement: SR-10
TEST(Plan, HoldDampsAndEndsInSafe) {
  PendulumPlant plant;
  tiller::Config config = rig::pendulum_config();
  config.planner.horizon = 2;
  config.planner.knots = 2;
  config.safety.sensor_timeout_s = 10.0;
  config.safety.hold_ticks_to_safe = 5;
  Loop loop(config, plant);
  loop.activate(30);
  int held = 0;
  for (int i = 0; i < 20 && loop.state() != tiller_state_safe; ++i) {
    (void)loop.tick(nullptr);
    if (loop.state() != tiller_state_hold) continue;
    ++held;
    const tiller_info_t info = loop.info();
    // after two ticks the rate limit (2 N m a tick) no longer binds what damping asks for
    if (held > 2) {
      EXPECT_NEAR(loop.command().value[0], -0.3 * info.state_mean[1], 1e-9);
    }
  }
  EXPECT_EQ(held, 4) << "the fifth tick in HOLD is the first in SAFE";
  EXPECT_EQ(loop.state(), tiller_state_safe);
}

// Requirement: SR-1, SR-2, SR-3
TEST(Input, NothingTheSensorsSayLetsABadCommandOut) {
  // 20,000 ticks of everything at once, from fixed seeds; judged by the loop at every tick
  for (std::uint32_t seed = 1; seed <= 4; ++seed) {
    PendulumPlant plant;
    tiller::Config config = rig::pendulum_config();
    config.planner.kind = seed % tiller_planner_kind_count;
    config.planner.rollouts = 16;
    config.planner.horizon = 6;
    config.planner.knots = 3;
    Loop loop(config, plant);
    std::uint32_t random = seed;
    const auto next = [&](std::uint32_t n) {
      random = random * 1664525u + 1013904223u;
      return (random >> 8) % n;
    };
    const double values[] = {kNan, kInf, -kInf, 1e300, -1e-310, 49.0, 0.0};
    int safe = 0;
    for (int i = 0; i < 5000; ++i) {
      tiller_measurement_t m = loop.measure();
      if (next(8) == 0) m.value[0] = values[next(7)];
      if (next(16) == 0) m.stamp_us += static_cast<std::int64_t>(next(400000)) - 200000;
      if (next(400) == 0) m.stamp_us = std::numeric_limits<std::int64_t>::min() + next(5);
      m.command_latency_us = next(10) == 0 ? next(4) * 0x3fffffffu : 0;
      (void)loop.tick(next(9) == 0 ? nullptr : &m);
      if (next(40) == 0) loop.wait(loop.period_us() * next(9));
      if (next(500) == 0) (void)tiller_stop(loop.controller(), tiller_status_stopped);
      if (loop.state() == tiller_state_safe) {
        ++safe;
        if (next(3) == 0) (void)tiller_reset(loop.controller());
      }
      if (next(4) == 0) (void)tiller_arm(loop.controller());
    }
    std::printf("seed %u: %d ticks in SAFE, %llu rejected\n", seed, safe,
                static_cast<unsigned long long>(loop.info().rejected_measurements));
    EXPECT_TRUE(loop.commands_allowed()) << "seed " << seed;
    EXPECT_TRUE(loop.block().canaries_alive());
    EXPECT_GT(safe, 50) << "the inputs were too tame";
    EXPECT_LT(safe, 4900) << "the robot hardly moved";
  }
}

}  // namespace
