#include "safety/sensor_guard.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <initializer_list>
#include <limits>

namespace tiller {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr std::int64_t kPeriod_us = 20000;

/// A cart's position (not an angle, at most 5 m/s) and a pole's angle (at most 20 rad/s).
SensorLimits cart_and_pole() {
  SensorLimits limits;
  limits.count = 2;
  limits.angle_mask = 2u;
  limits.low[0] = -2.0, limits.high[0] = 2.0, limits.rate_per_s[0] = 5.0;
  limits.low[1] = -kInf, limits.high[1] = kInf, limits.rate_per_s[1] = 20.0;
  limits.timeout_us = 100000;
  limits.ahead_us = kPeriod_us;
  limits.frozen_ticks = 3;
  limits.bad_ticks_to_safe = 3;
  return limits;
}

tiller_measurement_t reading(std::int64_t stamp_us, double position, double angle) {
  tiller_measurement_t m = {};
  m.stamp_us = stamp_us;
  m.value[0] = position;
  m.value[1] = angle;
  return m;
}

struct Bench {
  SensorGuard guard{cart_and_pole()};
  SensorVerdict at(std::int64_t now_us, const tiller_measurement_t& m) { return guard.check(now_us, &m); }
  SensorVerdict at(std::int64_t stamp_us, double position, double angle) {
    return at(stamp_us, reading(stamp_us, position, angle));
  }
  SensorVerdict nothing(std::int64_t now_us) { return guard.check(now_us, nullptr); }
};

TEST(SensorGuard, TakesGoodReadings) {
  Bench b;
  for (int k = 0; k < 10; ++k) {
    const SensorVerdict v = b.at(k * kPeriod_us, 0.01 * k, 3.0 + 0.1 * k);
    EXPECT_EQ(v.status, tiller_status_ok);
    EXPECT_TRUE(v.usable);
    EXPECT_FALSE(v.lost);
  }
  EXPECT_EQ(b.guard.rejected(), 0u);
}

TEST(SensorGuard, AReadingThatNobodyCanCalculateWithIsOutOfRangeWhateverTheLimitsSay) {
  for (const double value : {1e300, -1e300, 1.7e308, 1e39, 1.0000001 * TILLER_LARGEST_VALUE}) {
    Bench b;  // the angle has no limits of its own
    const SensorVerdict v = b.at(0, 0.0, value);
    EXPECT_EQ(v.status, tiller_status_sensor_out_of_range) << value;
    EXPECT_FALSE(v.usable);
  }
  Bench b;
  EXPECT_EQ(b.at(0, 0.0, TILLER_LARGEST_VALUE).status, tiller_status_ok);
  EXPECT_EQ(b.at(kPeriod_us, 0.0, kInf).status, tiller_status_sensor_not_finite);
}

// The caller's clock may hang while the loop goes on: five periods without news are 0.1 s whatever it says.
TEST(SensorGuard, AClockThatStandsStillAgesByTicks) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  for (int k = 0; k < 5; ++k) EXPECT_FALSE(b.nothing(0).lost) << k;
  const SensorVerdict v = b.nothing(0);
  EXPECT_EQ(v.status, tiller_status_sensor_stale);
  EXPECT_TRUE(v.lost);
}

// Requirement: SR-7
TEST(SensorGuard, NothingNewIsFineUntilTheTimeout) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  const SensorVerdict fresh = b.nothing(100000);
  EXPECT_EQ(fresh.status, tiller_status_no_new_measurement);
  EXPECT_FALSE(fresh.usable);
  EXPECT_FALSE(fresh.lost);
  const SensorVerdict stale = b.nothing(100001);
  EXPECT_EQ(stale.status, tiller_status_sensor_stale);
  EXPECT_TRUE(stale.lost);
}

TEST(SensorGuard, AChangeAsFastAsIsAllowedIsNoJump) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  EXPECT_EQ(b.at(kPeriod_us, 5.0 * 0.02, 20.0 * 0.02).status, tiller_status_ok);
  EXPECT_EQ(b.at(2 * kPeriod_us, 0.0 - 1e-9, 0.0).status, tiller_status_sensor_jump);
}

TEST(SensorGuard, WhatStandsBehindTheLastReadingIsNoSensor) {
  Bench b;
  tiller_measurement_t m = reading(0, 0.1, 0.2);
  for (int i = 2; i < TILLER_MAX_STATES; ++i) m.value[i] = kNan;
  EXPECT_EQ(b.at(0, m).status, tiller_status_ok);
  EXPECT_EQ(b.guard.missing(), 0u);
}

TEST(SensorGuard, AClockThatWentBackIsToldOnce) {
  Bench b;
  EXPECT_FALSE(b.at(kPeriod_us, 0.0, 0.0).clock_set);
  EXPECT_TRUE(b.nothing(0).clock_set);
  EXPECT_FALSE(b.nothing(kPeriod_us).clock_set);
}

TEST(SensorGuard, RepeatsOfBeforeARestartDoNotCount) {
  Bench b;
  for (int k = 0; k <= 3; ++k) (void)b.at(k * kPeriod_us, 0.1, 0.2);
  EXPECT_TRUE(b.guard.frozen(true));
  b.guard.restart();
  EXPECT_FALSE(b.guard.frozen(true));
}

TEST(SensorGuard, OneThatIsMissingForTooLongIsStaleHoweverOftenTheOthersCome) {
  for (const bool first : {true, false}) {
    Bench b;
    (void)b.at(0, 0.0, 0.0);
    for (int k = 1; k <= 5; ++k) {
      const SensorVerdict v = b.at(k * kPeriod_us, first ? kNan : 0.01 * k, first ? 0.01 * k : kNan);
      EXPECT_EQ(v.status, tiller_status_ok) << k;
    }
    const SensorVerdict v = b.at(6 * kPeriod_us, first ? kNan : 0.06, first ? 0.06 : kNan);
    EXPECT_EQ(v.status, tiller_status_sensor_stale);
    EXPECT_TRUE(v.lost);
  }
}

TEST(SensorGuard, SilenceThatNobodyTickedThroughIsToldWithTheReadingThatEndsIt) {
  Bench b;
  EXPECT_FALSE(b.at(0, 0.0, 0.0).expired) << "nothing had been heard yet";
  EXPECT_FALSE(b.at(100000, 0.1, 0.0).expired) << "just in time";
  const SensorVerdict v = b.at(200001, 0.1, 0.0);
  EXPECT_TRUE(v.expired);
  EXPECT_TRUE(v.usable) << "the reading is as good as any";
  EXPECT_FALSE(v.lost);
  EXPECT_FALSE(b.at(220001, 0.1, 0.0).expired) << "and over";
}

TEST(SensorGuard, GoodReadingForgetsTheTicksOfAStandingClock) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(b.nothing(0).lost);
  EXPECT_TRUE(b.at(1000, 0.0, 0.001).usable);
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(b.nothing(1000).lost) << i;
}

TEST(SensorGuard, BeforeTheFirstReadingNothingIsLost) {
  Bench b;
  const SensorVerdict v = b.nothing(1000000000);
  EXPECT_EQ(v.status, tiller_status_no_new_measurement);
  EXPECT_FALSE(v.lost);
}

TEST(SensorGuard, TheSameReadingAgainIsNothingNew) {
  Bench b;
  const tiller_measurement_t m = reading(0, 0.5, 0.5);
  (void)b.at(0, m);
  const SensorVerdict v = b.at(kPeriod_us, m);
  EXPECT_EQ(v.status, tiller_status_no_new_measurement);
  EXPECT_EQ(b.guard.rejected(), 0u);
  EXPECT_EQ(b.at(100001, m).status, tiller_status_sensor_stale) << "a driver that repeats its last frame is stale";
}

// Requirement: SR-8
TEST(SensorGuard, RefusesOldAndFutureStamps) {
  Bench b;
  EXPECT_EQ(b.at(500000, reading(399999, 0.0, 0.0)).status, tiller_status_sensor_stale);
  EXPECT_EQ(b.at(500000, reading(520001, 0.0, 0.0)).status, tiller_status_sensor_stale);
  EXPECT_EQ(b.at(500000, reading(519999, 0.0, 0.0)).status, tiller_status_ok) << "clock skew below a period";
}

// Requirement: SR-8
TEST(SensorGuard, RefusesStampsOutOfOrder) {
  Bench b;
  (void)b.at(kPeriod_us, 0.0, 0.0);
  EXPECT_EQ(b.at(2 * kPeriod_us, reading(kPeriod_us, 0.1, 0.0)).status, tiller_status_time_backwards);
  EXPECT_EQ(b.at(2 * kPeriod_us, reading(kPeriod_us - 1, 0.0, 0.0)).status, tiller_status_time_backwards);
  EXPECT_EQ(b.guard.rejected(), 2u);
  EXPECT_EQ(b.at(2 * kPeriod_us, 0.0, 0.0).status, tiller_status_ok);
}

TEST(SensorGuard, CallersClockGoingBackIsSeenEvenWithoutAReading) {
  Bench b;
  (void)b.at(10 * kPeriod_us, 0.0, 0.0);
  EXPECT_EQ(b.nothing(9 * kPeriod_us).status, tiller_status_time_backwards);
  EXPECT_EQ(b.nothing(8 * kPeriod_us).status, tiller_status_time_backwards);
  EXPECT_TRUE(b.nothing(7 * kPeriod_us).lost);
}

// Requirement: SR-7, SR-12
TEST(SensorGuard, AClockSetBackByMoreThanAPeriodIsLostAtOnceHoweverOldTheReadings) {
  for (const std::int64_t age_us : {std::int64_t{0}, 2 * kPeriod_us, -kPeriod_us}) {  // of the last reading
    Bench within, beyond;
    (void)within.at(10 * kPeriod_us, reading(10 * kPeriod_us - age_us, 0.0, 0.0));
    (void)beyond.at(10 * kPeriod_us, reading(10 * kPeriod_us - age_us, 0.0, 0.0));
    EXPECT_FALSE(within.nothing(9 * kPeriod_us).lost) << age_us;
    const SensorVerdict v = beyond.nothing(9 * kPeriod_us - 1);
    EXPECT_EQ(v.status, tiller_status_time_backwards) << age_us;
    EXPECT_TRUE(v.lost) << age_us;
  }
}

// Requirement: SR-7
TEST(SensorGuard, SmallStepsBackDoNotHideSilence) {
  Bench b;
  std::int64_t now_us = 10 * kPeriod_us, silent_us = 0;
  (void)b.at(now_us, 0.0, 0.0);
  bool lost = false;
  for (int k = 0; !lost && k < 100; ++k) {  // ahead by a period, and back by most of it, a quarter of a period later
    now_us += k % 2 == 0 ? kPeriod_us : -3 * kPeriod_us / 4;
    silent_us += k % 2 == 0 ? kPeriod_us : kPeriod_us / 4;
    lost = b.nothing(now_us).lost;
  }
  EXPECT_TRUE(lost);
  EXPECT_LE(silent_us, 100000 + 2 * kPeriod_us);
}

TEST(SensorGuard, ExtremeStampsDoNotOverflow) {
  Bench b;
  const std::int64_t low = std::numeric_limits<std::int64_t>::min();
  const std::int64_t high = std::numeric_limits<std::int64_t>::max();
  EXPECT_EQ(b.at(high, reading(low, 0.0, 0.0)).status, tiller_status_sensor_stale);
  EXPECT_EQ(elapsed_us(high, low), high);
  EXPECT_EQ(elapsed_us(low, high), low);
  EXPECT_EQ(elapsed_us(5, 3), 2);
  Bench c;
  EXPECT_EQ(c.at(low, reading(high, 0.0, 0.0)).status, tiller_status_sensor_stale);
}

// Requirement: SR-8
TEST(SensorGuard, RefusesInfinityAndSkipsMissingValues) {
  Bench b;
  EXPECT_EQ(b.at(0, kNan, 0.0).status, tiller_status_sensor_not_finite) << "the first reading must be complete";
  (void)b.at(kPeriod_us, 0.0, 0.0);
  EXPECT_EQ(b.at(2 * kPeriod_us, kInf, 0.0).status, tiller_status_sensor_not_finite);
  EXPECT_EQ(b.at(3 * kPeriod_us, -kInf, 0.0).status, tiller_status_sensor_not_finite);
  const SensorVerdict partial = b.at(4 * kPeriod_us, kNan, 0.1);
  EXPECT_EQ(partial.status, tiller_status_ok);
  EXPECT_TRUE(partial.usable);
  EXPECT_EQ(b.guard.missing(), 1u);
  EXPECT_EQ(b.at(5 * kPeriod_us, kNan, kNan).status, tiller_status_sensor_not_finite) << "all missing";
  EXPECT_EQ(b.guard.missing(), 1u) << "a rejected reading is counted as rejected, not as missing";
}

// Requirement: SR-7
TEST(SensorGuard, OneDeadSensorIsStaleByItself) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  SensorVerdict v;
  std::int64_t t = 0;
  while (!v.lost && t < 1000000) {
    t += kPeriod_us;
    v = b.at(t, kNan, 1e-6 * static_cast<double>(t));
  }
  EXPECT_EQ(t, 120000) << "the first tick past 0.1 s without a position";
  EXPECT_EQ(v.status, tiller_status_sensor_stale);
  EXPECT_FALSE(v.usable);
}

TEST(SensorGuard, OldReadingAmongFreshOnesIsRefusedAndLosesNothing) {
  Bench b;
  (void)b.at(500000, reading(420000, 0.0, 0.0));
  const SensorVerdict v = b.at(515000, reading(414000, 0.0, 0.0));
  EXPECT_EQ(v.status, tiller_status_sensor_stale) << "too old by itself, whatever the order";
  EXPECT_FALSE(v.lost);
  EXPECT_EQ(b.guard.rejected(), 1u);
}

// Requirement: SR-8
TEST(SensorGuard, RefusesOutOfRangeAndJumps) {
  Bench b;
  (void)b.at(0, 0.0, 3.1);
  EXPECT_EQ(b.at(kPeriod_us / 2, -2.5, 3.1).status, tiller_status_sensor_out_of_range);
  EXPECT_EQ(b.at(kPeriod_us, 2.5, 3.1).status, tiller_status_sensor_out_of_range);
  EXPECT_EQ(b.at(2 * kPeriod_us, 0.3, 3.1).status, tiller_status_sensor_jump) << "7.5 m/s over 40 ms";
  EXPECT_EQ(b.at(5 * kPeriod_us / 2, -0.3, 3.1).status, tiller_status_sensor_jump) << "either way";
  EXPECT_EQ(b.at(3 * kPeriod_us, 0.29, 3.1).status, tiller_status_ok) << "4.8 m/s over the 60 ms since the last";
}

TEST(SensorGuard, AngleJumpsAreWrapped) {
  Bench b;
  (void)b.at(0, 0.0, 3.1);
  EXPECT_EQ(b.at(kPeriod_us, 0.0, -3.1).status, tiller_status_ok) << "0.083 rad through pi";
  EXPECT_EQ(b.at(2 * kPeriod_us, 0.0, -2.1).status, tiller_status_sensor_jump) << "50 rad/s";
}

TEST(SensorGuard, JumpIsMeasuredFromTheLastValueThatWasSeen) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  (void)b.at(kPeriod_us, kNan, 0.0);
  EXPECT_EQ(b.at(2 * kPeriod_us, 0.19, 0.0).status, tiller_status_ok) << "0.19 m in 40 ms, not in 20";
}

// Requirement: SR-7
TEST(SensorGuard, RejectionsInARowLoseTheSensors) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  EXPECT_FALSE(b.at(kPeriod_us, 5.0, 0.0).lost);
  EXPECT_FALSE(b.at(kPeriod_us + 1, 5.0, 0.0).lost);
  EXPECT_FALSE(b.at(kPeriod_us + 2, 0.0, 0.0).lost) << "a good one between resets the count";
  EXPECT_FALSE(b.at(kPeriod_us + 3, 5.0, 0.0).lost);
  EXPECT_FALSE(b.at(kPeriod_us + 4, 5.0, 0.0).lost);
  EXPECT_FALSE(b.nothing(kPeriod_us + 5).lost) << "silence is judged by its age, not by this count";
  EXPECT_TRUE(b.at(kPeriod_us + 6, 5.0, 0.0).lost);
  EXPECT_EQ(b.guard.rejected(), 5u);
}

// Requirement: SR-9
TEST(SensorGuard, FrozenOnlyWhenTheRobotShouldMove) {
  Bench b;
  std::int64_t t = 0;
  (void)b.at(t, 0.125, 0.5);
  for (int k = 0; k < 2; ++k) (void)b.at(t += kPeriod_us, 0.125, 0.5);
  EXPECT_FALSE(b.guard.frozen(true)) << "two repeats of three";
  (void)b.at(t += kPeriod_us, 0.125, 0.5);
  EXPECT_TRUE(b.guard.frozen(true));
  EXPECT_FALSE(b.guard.frozen(false));
  (void)b.at(t += kPeriod_us, 0.125, std::nextafter(0.5, 1.0));
  EXPECT_FALSE(b.guard.frozen(true)) << "the last bit moved: alive";
  EXPECT_EQ(b.guard.repeats(), 0u);
}

TEST(SensorGuard, FrozenCheckCanBeSwitchedOff) {
  SensorLimits limits = cart_and_pole();
  limits.frozen_ticks = 0;
  SensorGuard guard(limits);
  for (int k = 0; k < 100; ++k) {
    const tiller_measurement_t m = reading(k * kPeriod_us, 0.0, 0.0);
    (void)guard.check(m.stamp_us, &m);
  }
  EXPECT_FALSE(guard.frozen(true));
}

TEST(SensorGuard, RestartForgetsReadingsButNotCounters) {
  Bench b;
  (void)b.at(0, 0.0, 0.0);
  (void)b.at(kPeriod_us, 9.0, 0.0);
  b.guard.restart();
  EXPECT_FALSE(b.nothing(10000000).lost) << "as before the first reading";
  EXPECT_EQ(b.at(10000000, 1.9, 2.0).status, tiller_status_ok) << "no jump from what was forgotten";
  EXPECT_EQ(b.guard.rejected(), 1u);
}

/// An attitude alone, at most half a unit per component and second.
SensorLimits attitude_alone() {
  SensorLimits limits;
  limits.count = 4;
  limits.quaternion_mask = 1u;
  for (int i = 0; i < 4; ++i) limits.low[i] = -kInf, limits.high[i] = kInf, limits.rate_per_s[i] = 0.5;
  limits.timeout_us = 100000;
  limits.ahead_us = kPeriod_us;
  limits.bad_ticks_to_safe = 100;
  return limits;
}

tiller_status_t verdict_on(SensorGuard& guard, std::int64_t stamp_us, double w, double x, double y, double z) {
  tiller_measurement_t m = {};
  m.stamp_us = stamp_us;
  m.value[0] = w, m.value[1] = x, m.value[2] = y, m.value[3] = z;
  return guard.check(stamp_us, &m).status;
}

TEST(SensorGuard, AnAttitudeHasTwoSignsAndOneLength) {
  SensorGuard guard(attitude_alone());
  EXPECT_EQ(verdict_on(guard, 0, 0.6, 0.8, 0, 0), tiller_status_ok);
  EXPECT_EQ(verdict_on(guard, 1 * kPeriod_us, -0.6, -0.8, 0, 0), tiller_status_ok) << "the same attitude";
  EXPECT_EQ(verdict_on(guard, 2 * kPeriod_us, 0.6, 0.8, 0, 0.001), tiller_status_ok);
  EXPECT_EQ(verdict_on(guard, 3 * kPeriod_us, 0.8, 0.6, 0, 0), tiller_status_sensor_jump);
  EXPECT_EQ(verdict_on(guard, 4 * kPeriod_us, 0, 0, 0, 0), tiller_status_sensor_out_of_range) << "a lost tracker";
  EXPECT_EQ(verdict_on(guard, 5 * kPeriod_us, 1.2, 1.6, 0, 0), tiller_status_sensor_out_of_range) << "length 2";
  EXPECT_EQ(verdict_on(guard, 6 * kPeriod_us, kNan, kNan, kNan, kNan), tiller_status_sensor_not_finite);
  EXPECT_EQ(verdict_on(guard, 7 * kPeriod_us, 0.6, kNan, 0, 0), tiller_status_ok) << "a part is missing";
}

/// Values before and behind an attitude have no second sign.
TEST(SensorGuard, OnlyAnAttitudesValuesHaveTwoSigns) {
  SensorLimits limits = attitude_alone();
  limits.count = 6;
  limits.quaternion_mask = 2u;  // values 1 to 4
  limits.low[4] = limits.low[5] = -kInf, limits.high[4] = limits.high[5] = kInf;
  limits.rate_per_s[4] = limits.rate_per_s[5] = 0.5;
  for (int single : {0, 5}) {
    SensorGuard guard(limits);
    tiller_measurement_t m = {};
    m.value[0] = m.value[5] = 1.0;
    m.value[1] = 0.6, m.value[2] = 0.8;
    EXPECT_EQ(guard.check(0, &m).status, tiller_status_ok);
    m.stamp_us = kPeriod_us;
    for (int i = 1; i < 5; ++i) m.value[i] = -m.value[i];
    EXPECT_EQ(guard.check(kPeriod_us, &m).status, tiller_status_ok);
    m.stamp_us = 2 * kPeriod_us;
    m.value[single] = -1.0;
    EXPECT_EQ(guard.check(2 * kPeriod_us, &m).status, tiller_status_sensor_jump) << single;
  }
}

}  // namespace
}  // namespace tiller
