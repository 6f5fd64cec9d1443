// A transition has the commands that were in force and the time that was measured, over gaps and latencies too.
#include <gtest/gtest.h>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

using bench::Bench;
using bench::known_pendulum;

TEST(Transition, CarriesTheCommandThatWasInForce) {
  Bench b;
  b.activate();  // answers zero
  for (int k = 1; k <= 5; ++k) {
    fakes::planner.command[0] = k;
    (void)b.tick();
    const tiller::Transition& t = fakes::posterior.transitions.back();
    EXPECT_DOUBLE_EQ(t.period_s, 0.02);
    EXPECT_EQ(t.input[0], k - 1.0) << "exact: one command held for the whole period";
    EXPECT_EQ(t.measured[0], 0.1);
  }
}

TEST(Transition, LatencySplitsThePeriodBetweenTwoCommands) {
  Bench b;
  b.activate();
  for (int k = 1; k <= 6; ++k) {
    fakes::planner.command[0] = k;
    tiller_measurement_t m = b.reading(0.1);
    m.command_latency_us = 5000;
    (void)b.tick(&m);
    // a quarter of the period the command before the last, three quarters the last; the first ones had no latency
    if (k >= 3) {
      EXPECT_NEAR(fakes::posterior.transitions.back().input[0], 0.25 * (k - 2) + 0.75 * (k - 1), 1e-12);
    }
  }
}

TEST(Transition, LatencyThatHasRunOutDoesNotReachIntoThePast) {
  Bench b;
  b.activate();
  for (int k = 1; k <= 4; ++k) {
    fakes::planner.command[0] = k;
    tiller_measurement_t m = b.reading(0.1);
    m.stamp_us -= 10000;          // read half a period ago,
    m.command_latency_us = 3000;  // which is more than the latency claimed
    (void)b.tick(&m);
    if (k >= 3) {
      EXPECT_NEAR(fakes::posterior.transitions.back().input[0], 0.5 * (k - 2) + 0.5 * (k - 1), 1e-12);
    }
  }
}

TEST(Transition, AbsurdLatencyToldOnceHoldsBackNoLaterCommand) {
  Bench b;
  b.activate();
  for (int k = 1; k <= 8; ++k) {
    fakes::planner.command[0] = k;
    tiller_measurement_t m = b.reading(0.1);
    if (k == 2) m.command_latency_us = 0xffffffffu;
    (void)b.tick(&m);
  }
  EXPECT_NEAR(fakes::posterior.transitions.back().input[0], 7.0, 1e-12);
}

TEST(Transition, ClockThatJumpsAheadForOneTickIsForgottenByAReset) {
  Bench b;
  b.activate();
  fakes::planner.command[0] = 5.0;
  (void)b.tick();
  b.now_us += 3600000000;
  (void)b.tick(nullptr);
  ASSERT_EQ(b.state(), tiller_state_safe);
  b.now_us -= 3600000000;
  ASSERT_EQ(b.executive->reset(), tiller_status_ok);
  ASSERT_EQ(b.executive->arm(), tiller_status_ok);
  for (int k = 1; k <= 4; ++k) {
    fakes::planner.command[0] = k;
    tiller_measurement_t m = b.reading(0.1);
    (void)b.tick(&m);
  }
  EXPECT_NEAR(fakes::posterior.transitions.back().input[0], 3.0, 1e-12);
}

TEST(Transition, MissedMeasurementIsAPeriodOfItsOwnUnderItsOwnCommand) {
  Bench b;
  b.activate();
  fakes::planner.command[0] = 2.0;
  fakes::planner.sequence = {0.0f, 6.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  (void)b.tick();
  (void)b.tick(nullptr);  // the plan's second step: 6
  EXPECT_EQ(b.command.value[0], 6.0);
  (void)b.tick();
  ASSERT_EQ(fakes::posterior.skipped.size(), 1u);
  const tiller::Transition& skipped = fakes::posterior.skipped.back();
  EXPECT_NEAR(skipped.period_s, 0.02, 1e-12);
  EXPECT_NEAR(skipped.input[0], 2.0, 1e-12);
  const tiller::Transition& t = fakes::posterior.transitions.back();
  EXPECT_NEAR(t.period_s, 0.02, 1e-12);
  EXPECT_NEAR(t.input[0], 6.0, 1e-12);
}

TEST(Transition, PredictionThroughAGapThatFailsIsAFault) {
  Bench b;
  b.activate();
  (void)b.tick(nullptr);
  fakes::posterior.skip_status = tiller_status_posterior_degenerate;
  const std::size_t before = fakes::posterior.transitions.size();
  const int plans = fakes::planner.plans;
  EXPECT_EQ(b.tick(), tiller_status_posterior_degenerate);
  EXPECT_EQ(fakes::posterior.transitions.size(), before) << "nothing to take the measurement in with";
  EXPECT_EQ(fakes::planner.plans, plans);
}

TEST(Transition, MeasuredStampsCountAndNotThePeriod) {
  Bench b;
  b.activate();
  b.now_us += 3500;
  (void)b.tick();
  EXPECT_NEAR(fakes::posterior.transitions.back().period_s, 0.0235, 1e-12);
}

TEST(Transition, GapIsPredictedThroughAndBeyondSixteenPeriodsTheFiltersBeginAnew) {
  tiller::Config config = known_pendulum();
  config.safety.sensor_timeout_s = 10.0;
  Bench b(config);
  b.activate();
  EXPECT_EQ(fakes::posterior.starts, 1);
  b.now_us += 15 * b.period_us;
  (void)b.tick();
  EXPECT_EQ(fakes::posterior.starts, 1);
  EXPECT_EQ(fakes::posterior.skipped.size(), 15u);
  EXPECT_NEAR(fakes::posterior.transitions.back().period_s, 0.02, 1e-12);
  b.now_us += 15 * b.period_us + 1;
  (void)b.tick();
  EXPECT_EQ(fakes::posterior.starts, 2);
  EXPECT_EQ(fakes::posterior.skipped.size(), 15u);
  EXPECT_EQ(fakes::posterior.transitions.size(), 1u);
  EXPECT_EQ(b.executive->info().posterior_failures, 1u);
  EXPECT_EQ(b.state(), tiller_state_active) << "planned from the new start";
}

// A hand may move a robot that stands by, its drive is off: the estimate follows the sensors, and nothing is learnt.
TEST(Standby, FollowsTheSensorsAndLearnsNothing) {
  Bench b;
  for (int i = 0; i < 50; ++i) {
    (void)b.tick(0.05 * i);
    EXPECT_EQ(b.state(), tiller_state_standby);
    EXPECT_EQ(b.executive->info().state_mean[0], 0.05 * i);
  }
  EXPECT_TRUE(fakes::posterior.transitions.empty());
  EXPECT_EQ(fakes::posterior.starts, 50);
  EXPECT_EQ(b.executive->info().posterior_failures, 0u);
  b.activate();
  EXPECT_TRUE(fakes::posterior.transitions.empty()) << "the period before the first command was nobody's";
  (void)b.tick();
  EXPECT_EQ(fakes::posterior.transitions.size(), 1u);
  (void)b.executive->disarm();
  (void)b.tick();
  EXPECT_EQ(fakes::posterior.transitions.size(), 2u) << "this period was still the last command's";
  (void)b.tick();
  EXPECT_EQ(fakes::posterior.transitions.size(), 2u);
}

}  // namespace
