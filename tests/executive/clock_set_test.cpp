// A clock that is set, or a pause, hurts nobody at rest and is a fault in motion.
#include <gtest/gtest.h>

#include <functional>

#include "bench.hpp"

namespace {

using bench::Bench;

constexpr std::int64_t kYear_us = 31557600000000;

/// Ticks at another time of day, then at the one that is right.
void tick_at(Bench& b, std::int64_t ahead_us, const std::function<void()>& tick) {
  b.now_us += ahead_us;
  tick();
  b.now_us -= ahead_us;
}

/// ACTIVE within three ticks, and each transition has the commands that were in force: half a period the one before.
void expect_good_start(Bench& b) {
  ASSERT_EQ(b.executive->arm(), tiller_status_ok);
  for (int k = 1; k <= 6; ++k) {
    fakes::planner.command[0] = k;
    tiller_measurement_t m = b.reading(0.1);
    m.command_latency_us = 10000;
    (void)b.tick(&m);
    if (k < 5) continue;
    ASSERT_EQ(b.state(), tiller_state_active) << k;
    ASSERT_FALSE(fakes::posterior.transitions.empty());
    EXPECT_NEAR(fakes::posterior.transitions.back().input[0], k - 1.5, 1e-12) << k;
  }
}

TEST(ClockSet, TickOfTheFutureBeforeTheFirstReadingIsForgotten) {
  Bench b;
  tick_at(b, kYear_us, [&] { (void)b.tick(nullptr); });
  EXPECT_EQ(b.state(), tiller_state_init);
  expect_good_start(b);
}

TEST(ClockSet, StampOfTheFutureBeforeTheFirstReadingIsRefused) {
  Bench b;
  tiller_measurement_t m = b.reading(0.1);
  m.stamp_us += kYear_us;
  EXPECT_EQ(b.tick(&m), tiller_status_sensor_stale);
  EXPECT_EQ(b.state(), tiller_state_init);
  expect_good_start(b);
}

TEST(ClockSet, ReadingsOfTheFutureAreForgottenInStandby) {
  Bench b;
  tick_at(b, kYear_us, [&] {
    (void)b.tick();
    (void)b.tick();
    b.now_us -= 2 * b.period_us;
  });
  ASSERT_EQ(b.state(), tiller_state_standby);
  EXPECT_EQ(b.tick(), tiller_status_time_backwards);
  EXPECT_EQ(b.state(), tiller_state_init) << "nothing has been measured in this time";
  EXPECT_EQ(b.executive->info().rejected_measurements, 1u);
  const int starts = fakes::posterior.starts;
  expect_good_start(b);
  EXPECT_EQ(fakes::posterior.starts, starts + 1);
}

TEST(ClockSet, ArmingOutlastsIt) {
  Bench b;
  (void)b.tick();
  ASSERT_EQ(b.executive->arm(), tiller_status_ok);
  b.now_us -= 3600000000;
  EXPECT_EQ(b.tick(), tiller_status_time_backwards);
  (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_active);
}

TEST(ClockSet, ReadingsThatStopAfterItArmNobody) {
  Bench b;
  (void)b.tick();
  b.now_us -= 3600000000;
  (void)b.tick();
  ASSERT_EQ(b.executive->arm(), tiller_status_ok);
  for (int i = 0; i < 50; ++i) {
    (void)b.tick(nullptr);
    ASSERT_EQ(b.state(), tiller_state_init);
  }
}

// Requirement: SR-12
TEST(ClockSet, InMotionItIsAFault) {
  Bench b;
  b.activate();
  (void)b.tick();
  b.now_us -= 3600000000;
  for (int i = 0; i < 20; ++i) EXPECT_EQ(b.tick(), tiller_status_time_backwards);
  EXPECT_EQ(b.state(), tiller_state_safe);
}

// Requirement: SR-7, SR-12
TEST(ClockSet, InMotionWithoutReadingsItIsAFaultAtOnce) {
  Bench b;
  b.activate();
  (void)b.tick();
  b.now_us -= 3600000000;
  EXPECT_EQ(b.tick(nullptr), tiller_status_time_backwards) << "an age below zero is none that could expire";
  EXPECT_EQ(b.state(), tiller_state_safe);
}

// Requirement: SR-12
TEST(ClockSet, InMotionByLessThanAPeriodItCostsATick) {
  Bench b;
  b.activate();
  (void)b.tick();
  b.now_us -= b.period_us + b.period_us / 2;
  EXPECT_EQ(b.tick(nullptr), tiller_status_time_backwards);
  EXPECT_EQ(b.state(), tiller_state_active);
  EXPECT_EQ(b.tick(), tiller_status_ok);
  EXPECT_EQ(b.state(), tiller_state_active);
  for (int i = 0; i < 10 && b.state() != tiller_state_safe; ++i) (void)b.tick(nullptr);
  EXPECT_EQ(b.state(), tiller_state_safe) << "silence still counts";
}

// Requirement: SR-7
TEST(Pause, LongerThanTheSensorsTimeoutInMotionIsSafe) {
  Bench b;
  b.activate();
  b.now_us += 100000 - b.period_us;
  (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_active) << "just in time";
  b.now_us += 100001 - b.period_us;
  EXPECT_EQ(b.tick(), tiller_status_sensor_stale) << "a process that was stopped, with a fresh reading";
  EXPECT_EQ(b.state(), tiller_state_safe);
  EXPECT_EQ(b.command.value[0], 0.0);
}

TEST(Pause, AtRestHurtsNobody) {
  Bench b;
  (void)b.tick();
  b.now_us += 10000000;
  EXPECT_EQ(b.tick(), tiller_status_ok);
  EXPECT_EQ(b.state(), tiller_state_standby);
}

}  // namespace
