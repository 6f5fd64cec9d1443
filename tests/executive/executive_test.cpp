#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "bench.hpp"

namespace tiller {

/// Sets counters of years, which no test can wait for.
struct WrapProbe {
  static void set(Executive& e, std::uint64_t plans, std::uint32_t in_a_row) {
    e.info_.plans = plans;
    e.hold_ticks_ = e.unrenewed_plans_ = in_a_row;
  }
};

}  // namespace tiller

namespace {

using bench::Bench;
using bench::known_pendulum;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// ---- transitions ---------------------------------------------------------------------------------------

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

// ---- a clock that is set while the robot stands still -----------------------------------------------------

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
  expect_good_start(b);
  EXPECT_EQ(fakes::posterior.starts, 2);
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

TEST(ClockSet, InMotionItIsAFault) {
  Bench b;
  b.activate();
  (void)b.tick();
  b.now_us -= 3600000000;
  for (int i = 0; i < 20; ++i) EXPECT_EQ(b.tick(), tiller_status_time_backwards);
  EXPECT_EQ(b.state(), tiller_state_safe);
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
  tiller_config_t config = known_pendulum();
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

TEST(Transition, NoLearningInSafe) {
  Bench b;
  b.activate();
  (void)b.executive->stop(tiller_status_stopped);
  const std::size_t before = fakes::posterior.transitions.size();
  for (int i = 0; i < 5; ++i) EXPECT_EQ(b.tick(), tiller_status_stopped);
  EXPECT_EQ(fakes::posterior.transitions.size(), before);
  (void)b.executive->reset();
  (void)b.tick();
  EXPECT_EQ(fakes::posterior.starts, 2) << "the state estimate begins anew";
}

// ---- faults of the posterior ---------------------------------------------------------------------------

TEST(Learn, NothingIsPlannedFromAnEstimateThatDidNotTakeTheMeasurementIn) {
  Bench b;
  b.activate();
  fakes::posterior.update_status = tiller_status_posterior_degenerate;
  const int plans = fakes::planner.plans;
  EXPECT_EQ(b.tick(), tiller_status_posterior_degenerate);
  EXPECT_EQ(fakes::planner.plans, plans);
  EXPECT_EQ(b.state(), tiller_state_active) << "once; the last plan's next step goes out";
  EXPECT_EQ(b.executive->info().posterior_failures, 1u);
  fakes::posterior.update_status = tiller_status_tempered;
  EXPECT_EQ(b.tick(), tiller_status_ok) << "the filters begin anew at this measurement";
  EXPECT_EQ(fakes::posterior.starts, 2);
  EXPECT_EQ(fakes::planner.plans, plans + 1);
  EXPECT_EQ(b.tick(), tiller_status_tempered);
  EXPECT_EQ(b.executive->info().posterior_failures, 1u) << "news, not a failure";
}

TEST(Learn, ModelWithoutAFiniteStepEndsInSafe) {
  Bench b;
  b.activate();
  fakes::posterior.update_status = tiller_status_posterior_degenerate;
  // every other tick is a start, which says nothing of the model
  const int most = 2 * static_cast<int>(known_pendulum().safety.bad_ticks_to_safe);
  int ticks = 0;
  for (; ticks < most && b.state() != tiller_state_safe; ++ticks) (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_safe);
  EXPECT_LE(ticks, most);
  EXPECT_EQ(b.executive->info().first_fault, tiller_status_posterior_degenerate);
  EXPECT_EQ(b.command.value[0], 0.0);
}

TEST(Learn, OneGoodUpdateForgivesThoseBefore) {
  Bench b;
  b.activate();
  for (int i = 0; i < 20; ++i) {
    fakes::posterior.update_status = tiller_status_posterior_degenerate;
    (void)b.tick();
    fakes::posterior.update_status = tiller_status_ok;
    (void)b.tick();
    (void)b.tick();
  }
  EXPECT_EQ(b.state(), tiller_state_active);
}

TEST(Learn, DoubtedMeasurementsLeaveAPredictionForNoLongerThanTheSensorsTimeout) {
  Bench b;
  b.activate();
  fakes::posterior.update_status = tiller_status_measurement_doubted;
  const int plans = fakes::planner.plans;
  EXPECT_EQ(b.tick(), tiller_status_measurement_doubted);
  EXPECT_EQ(fakes::planner.plans, plans) << "the measurement is not in the estimate";
  EXPECT_EQ(b.executive->info().posterior_failures, 0u);
  EXPECT_EQ(fakes::posterior.starts, 1);
  for (int i = 1; i < 5; ++i) {
    EXPECT_EQ(b.state(), tiller_state_active) << i;
    (void)b.tick();
  }
  (void)b.tick();  // the estimate stands on nothing younger than 0.12 s; the timeout is 0.1 s
  EXPECT_EQ(b.state(), tiller_state_safe);
}

TEST(Learn, HoldIsNotFedBackFromAnOldEstimateEither) {
  tiller_config_t config = known_pendulum();
  config.safety.hold_gain[1] = 1.0;
  Bench b(config);
  b.activate();
  fakes::planner.result.status = tiller_status_plan_not_finite;
  (void)b.tick();
  ASSERT_EQ(b.state(), tiller_state_hold);
  fakes::posterior.update_status = tiller_status_measurement_doubted;
  for (int i = 0; i < 6; ++i) (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_safe);
}

TEST(Learn, StateThatIsNotFiniteIsNotPlannedFromAndBeginsAnew) {
  Bench b;
  b.activate();
  fakes::posterior.state[1] = kNan;
  const int plans = fakes::planner.plans;
  EXPECT_EQ(b.tick(), tiller_status_state_not_finite);
  EXPECT_EQ(fakes::planner.plans, plans);
  EXPECT_TRUE(std::isfinite(b.command.value[0]));
  fakes::posterior.state[1] = 0.0;
  EXPECT_EQ(b.tick(), tiller_status_ok);
  EXPECT_EQ(fakes::posterior.starts, 2);
  EXPECT_EQ(fakes::planner.plans, plans + 1);
}

TEST(Learn, HoldWithAStateThatIsNotFiniteSendsTheSafeCommand) {
  tiller_config_t config = known_pendulum();
  config.safety.safe_command[0] = 0.5;
  config.safety.hold_gain[1] = 1.0;
  Bench b(config);
  b.activate();
  fakes::planner.result.status = tiller_status_plan_not_finite;
  (void)b.tick();
  ASSERT_EQ(b.state(), tiller_state_hold);
  fakes::posterior.state[0] = fakes::posterior.state[1] = kNan;
  tiller_measurement_t m = b.reading(kNan);
  (void)b.tick(&m);  // rejected: the estimate is still good
  EXPECT_NE(b.command.value[0], 0.5);
  fakes::posterior.state[1] = kNan;
  fakes::posterior.start_status = tiller_status_sensor_not_finite;
  m = b.reading(0.2);
  (void)b.tick(&m);
  EXPECT_EQ(b.command.value[0], 0.5);
  EXPECT_EQ(b.executive->info().gate_rejections, 1u);
}

// ---- a model that does not explain the data --------------------------------------------------------------

/// In motion until the fake posterior's test has given its alarm: some 30 ticks of four deviations.
void alarm(Bench& b) {
  fakes::posterior.tested = true;
  b.activate();
  for (int i = 0; i < 200 && b.executive->info().adequacy != tiller_adequacy_inadequate; ++i) (void)b.tick();
  ASSERT_EQ(b.executive->info().adequacy, tiller_adequacy_inadequate);
}

TEST(Adequacy, InadequateModelIsAStatusThatNamesTheChannelAndStopsNothing) {
  Bench b;
  fakes::posterior.tested = true;
  b.activate();
  EXPECT_EQ(b.tick(), tiller_status_ok) << "no alarm yet";
  alarm(b);
  fakes::planner.command[0] = 1.25;
  EXPECT_EQ(b.tick(), tiller_status_model_inadequate);
  const tiller_info_t& info = b.executive->info();
  EXPECT_EQ(info.status, tiller_status_model_inadequate);
  EXPECT_EQ(info.inadequate_channel, 0u);
  EXPECT_EQ(info.inadequate_feature, static_cast<std::uint32_t>(tiller_feature_previous)) << "alike at every tick";
  EXPECT_GT(info.adequacy_statistic, 1.0);
  EXPECT_EQ(info.first_fault, tiller_status_ok);
  EXPECT_EQ(b.state(), tiller_state_active);
  EXPECT_EQ(b.command.value[0], 1.25) << "the plan's";
  const tiller_record_t* r = b.executive->recorder().find(info.ticks - 1);
  ASSERT_NE(r, nullptr);
  EXPECT_EQ(r->status, tiller_status_model_inadequate);
}

TEST(Adequacy, EveryFaultAndEveryOtherLimitGoBeforeIt) {
  Bench b;
  alarm(b);
  EXPECT_EQ(b.tick(nullptr), tiller_status_no_new_measurement);
  fakes::posterior.update_status = tiller_status_tempered;
  EXPECT_EQ(b.tick(), tiller_status_tempered);
  fakes::posterior.update_status = tiller_status_posterior_degenerate;
  EXPECT_EQ(b.tick(), tiller_status_posterior_degenerate);
  fakes::posterior.update_status = tiller_status_ok;
  fakes::planner.command[0] = 50.0;
  EXPECT_EQ(b.tick(), tiller_status_command_limited);
  fakes::planner.command[0] = 0.0;
  fakes::planner.result.status = tiller_status_iteration_capped;
  EXPECT_EQ(b.tick(), tiller_status_iteration_capped);
  fakes::planner.result.status = tiller_status_ok;
  const tiller_measurement_t bad = b.reading(kNan);
  EXPECT_EQ(b.tick(&bad), tiller_status_sensor_not_finite);
  EXPECT_EQ(b.tick(), tiller_status_model_inadequate) << "it has not gone away";
  fakes::planner.result.status = tiller_status_plan_not_finite;
  EXPECT_EQ(b.tick(), tiller_status_plan_not_finite);
  EXPECT_EQ(b.state(), tiller_state_hold);
  fakes::planner.result.status = tiller_status_ok;
  EXPECT_EQ(b.tick(), tiller_status_model_inadequate);
  (void)b.executive->stop(tiller_status_actuator_fault);
  EXPECT_EQ(b.tick(), tiller_status_actuator_fault);
}

TEST(Adequacy, StaysUntilReset) {
  Bench b;
  alarm(b);
  (void)b.executive->disarm();
  EXPECT_EQ(b.tick(), tiller_status_model_inadequate) << "STANDBY learns, and knows as much";
  (void)b.executive->stop(tiller_status_stopped);
  (void)b.tick();
  (void)b.executive->reset();
  EXPECT_EQ(b.executive->info().adequacy, static_cast<std::uint32_t>(tiller_adequacy_untested));
  EXPECT_EQ(b.tick(), tiller_status_ok);
}

// ---- faults of the planner -----------------------------------------------------------------------------

TEST(Plan, FailureIsHoldWithFeedbackAndRecoversByItself) {
  Bench b;
  b.activate();
  fakes::planner.result.status = tiller_status_plan_not_finite;
  fakes::planner.command[0] = 9.0;
  EXPECT_EQ(b.tick(0.1), tiller_status_plan_not_finite);
  EXPECT_EQ(b.state(), tiller_state_hold);
  EXPECT_DOUBLE_EQ(b.command.value[0], -2.0 * 0.1) << "u = -K (x - target), not the planner's";
  EXPECT_EQ(b.executive->info().first_fault, tiller_status_plan_not_finite);
  EXPECT_EQ(b.tick(0.15), tiller_status_plan_not_finite);
  EXPECT_DOUBLE_EQ(b.command.value[0], -2.0 * 0.15);
  EXPECT_EQ(b.executive->info().plan_failures, 2u);

  fakes::planner.result.status = tiller_status_ok;
  const int resets = fakes::planner.resets;
  EXPECT_EQ(b.tick(), tiller_status_ok);
  EXPECT_EQ(b.state(), tiller_state_active);
  EXPECT_EQ(b.command.value[0], 9.0);
  EXPECT_EQ(b.executive->info().first_fault, tiller_status_ok);
  EXPECT_EQ(fakes::planner.resets, resets) << "HOLD is motion: the warm start stays";
}

TEST(Plan, CommandThatIsNotFiniteIsAFailureWhateverTheStatusSays) {
  for (double bad : {kNan, std::numeric_limits<double>::infinity()}) {
    Bench b;
    b.activate();
    fakes::planner.command[0] = bad;
    EXPECT_EQ(b.tick(0.1), tiller_status_plan_not_finite);
    EXPECT_EQ(b.state(), tiller_state_hold);
    EXPECT_DOUBLE_EQ(b.command.value[0], -0.2);
  }
}

TEST(Plan, HoldAngleErrorIsWrapped) {
  tiller_config_t config = known_pendulum();
  config.cost.target[0] = 3.0;
  Bench b(config);
  b.activate();
  fakes::planner.result.status = tiller_status_plan_not_finite;
  (void)b.tick(-3.1);
  EXPECT_NEAR(b.command.value[0], -2.0 * (-6.1 + 6.283185307179586), 1e-12);
}

TEST(Plan, CommandBeyondTheLimitsIsCutAndCounted) {
  Bench b;
  b.activate();
  fakes::planner.command[0] = 50.0;
  EXPECT_EQ(b.tick(), tiller_status_command_limited);
  EXPECT_EQ(b.command.value[0], 10.0);
  EXPECT_EQ(b.executive->info().gate_cuts, 1u);
  EXPECT_EQ(b.state(), tiller_state_active);
  (void)b.tick();
  EXPECT_EQ(fakes::planner.last_command[0], 10.0) << "the planner is told what was sent, not what it wished";
}

TEST(Plan, NoTimeForAnIterationKeepsThePlanAndThenHolds) {
  Bench b;
  b.activate();
  fakes::planner.result = {tiller_status_iteration_capped, 0, 0.0};
  fakes::planner.command[0] = 1.0;
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(b.tick(), tiller_status_deadline_missed) << i;
    EXPECT_EQ(b.state(), tiller_state_active) << "half of the horizon of eight is trusted";
    EXPECT_EQ(b.command.value[0], 1.0);
  }
  (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_hold);
  EXPECT_EQ(b.executive->info().first_fault, tiller_status_deadline_missed);
  EXPECT_EQ(b.executive->info().late_plans, 5u);
  fakes::planner.result = {tiller_status_iteration_capped, 1, 0.0};
  EXPECT_EQ(b.tick(), tiller_status_iteration_capped);
  EXPECT_EQ(b.state(), tiller_state_active);
}

TEST(Heartbeat, NumberStandsStillWheneverNoPlanWasMade) {
  Bench b;
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 0u) << "disarmed: nothing is planned";
  b.activate();
  EXPECT_EQ(b.command.plan_sequence, 1u);
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 2u);
  EXPECT_EQ(b.executive->info().plans, 2u);
  (void)b.tick(nullptr);
  EXPECT_EQ(b.state(), tiller_state_active);
  EXPECT_EQ(b.command.plan_sequence, 2u) << "the rest of the last plan is no new one";
  fakes::planner.result.iterations = 0;
  (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_active);
  EXPECT_EQ(b.command.plan_sequence, 2u) << "nor is a plan moved on for want of time";
  fakes::planner.result = {tiller_status_plan_not_finite, 1, 0.0};
  (void)b.tick();
  EXPECT_EQ(b.state(), tiller_state_hold);
  EXPECT_EQ(b.command.plan_sequence, 2u) << "nor a failed one";
  fakes::planner.result = {tiller_status_ok, 1, 0.0};
  fakes::planner.command[0] = NAN;
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 2u) << "nor one that is not finite";
  fakes::planner.command[0] = 0.0;
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 3u);
  (void)b.executive->stop(tiller_status_stopped);
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 3u) << "SAFE plans nothing";
}

TEST(Wrap, PlansNumberGoesOnOverThirtyTwoBits) {
  Bench b;
  b.activate();
  tiller::WrapProbe::set(*b.executive, 0xfffffffeu, 0);
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 0xffffffffu);
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 0u);
  (void)b.tick();
  EXPECT_EQ(b.command.plan_sequence, 1u);
  EXPECT_EQ(b.executive->info().plans, 0x100000001u);
  EXPECT_EQ(b.state(), tiller_state_active);
}

TEST(Wrap, LatePlansOfYearsStayInHold) {
  tiller_config_t config = known_pendulum();
  config.safety.hold_ticks_to_safe = 0;  // HOLD may last
  Bench b(config);
  b.activate();
  fakes::planner.result.iterations = 0;
  for (int i = 0; i < 10; ++i) (void)b.tick();
  ASSERT_EQ(b.state(), tiller_state_hold);
  tiller::WrapProbe::set(*b.executive, 5, 0xfffffffeu);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(b.tick(), tiller_status_deadline_missed) << i;
    EXPECT_EQ(b.state(), tiller_state_hold) << i;
  }
  EXPECT_EQ(b.executive->info().plan_failures, 10u - 4u + 5u) << "each of them is a failed plan";
}

TEST(Plan, WarmStartIsDroppedOnlyWhenMotionBegins) {
  Bench b;
  (void)b.tick();
  EXPECT_EQ(fakes::planner.plans, 0) << "STANDBY does not plan";
  const int resets = fakes::planner.resets;
  b.activate();
  EXPECT_EQ(fakes::planner.resets, resets + 1);
  (void)b.tick();
  EXPECT_EQ(fakes::planner.resets, resets + 1);
  (void)b.executive->disarm();
  (void)b.tick();
  b.activate();
  EXPECT_EQ(fakes::planner.resets, resets + 2);
}

TEST(Plan, MotionBeginsAnewThoughNoTickSawItEnd) {
  const auto stop_and_reset = [](Bench& b) {
    (void)b.executive->stop(tiller_status_stopped);
    return b.executive->reset();
  };
  const auto disarm = [](Bench& b) { return b.executive->disarm(); };
  for (const std::function<tiller_status_t(Bench&)>& end :
       {std::function<tiller_status_t(Bench&)>(disarm), std::function<tiller_status_t(Bench&)>(stop_and_reset)}) {
    Bench b;
    b.activate();
    for (int i = 0; i < 5; ++i) (void)b.tick();
    ASSERT_EQ(fakes::planner.task_step, 5u);
    const int resets = fakes::planner.resets;
    ASSERT_EQ(end(b), tiller_status_ok);
    b.executive->prepare();
    EXPECT_EQ(fakes::planner.preparations, 0) << "nothing is planned in between";
    ASSERT_EQ(b.executive->arm(), tiller_status_ok);
    (void)b.tick();
    ASSERT_EQ(b.state(), tiller_state_active);
    EXPECT_EQ(fakes::planner.resets, resets + 1) << "no warm start from the motion before";
    EXPECT_EQ(fakes::planner.task_step, 0u) << "the task begins with the motion";
  }
}

TEST(Plan, ForcedIterationsHoldForOneTick) {
  Bench b;
  b.activate();
  const std::uint32_t configured = fakes::planner.iterations_asked;
  b.executive->force_iterations(7);
  (void)b.tick();
  EXPECT_EQ(fakes::planner.iterations_asked, 7u);
  (void)b.tick();
  EXPECT_EQ(fakes::planner.iterations_asked, configured);
}

std::int64_t fixed_clock(void*) { return 5000; }

TEST(Plan, DeadlineCountsFromTheTicksStartAndNeedsAClock) {
  tiller_config_t config = known_pendulum();
  config.planner.deadline_us = 3;
  {
    Bench b(config);
    b.activate();
    EXPECT_EQ(fakes::planner.deadline_ns, 0);
  }
  tiller_hooks_t hooks = {};
  hooks.now_ns = fixed_clock;
  Bench b(config, &hooks);
  b.activate();
  EXPECT_EQ(fakes::planner.deadline_ns, 5000 + 3000);
  b.executive->force_iterations(2);
  (void)b.tick();
  EXPECT_EQ(fakes::planner.deadline_ns, 0) << "a replay has no clock";
}

TEST(Plan, BeginsWhereTheRobotWillBeWhenTheCommandTakesHold) {
  Bench b;
  b.activate();
  fakes::posterior.state[1] = 1.0;  // rad/s
  (void)b.tick(0.5);
  EXPECT_EQ(fakes::planner.belief_state[0], 0.5f) << "no latency: from the measurement";
  tiller_measurement_t m = b.reading(0.5);
  m.command_latency_us = 10000;
  (void)b.tick(&m);
  // 10 ms at 1 rad/s, less what gravity and damping take: 0.5 (9.81 / 0.5 sin 0.5 + 0.5 / 0.125) 1e-4 = 6.7e-4
  EXPECT_NEAR(fakes::planner.belief_state[0], 0.51 - 6.7e-4, 1e-5);
}

// ---- the record ----------------------------------------------------------------------------------------

TEST(Record, KeepsEveryInputAndOutput) {
  Bench b;
  b.activate();
  fakes::planner.command[0] = 1.25;
  fakes::planner.result = {tiller_status_ok, 2, 33.0};
  tiller_measurement_t m = b.reading(0.3);
  m.sequence = 77;
  m.command_latency_us = 1234;
  const std::int64_t now_us = b.now_us;
  (void)b.tick(&m);
  const tiller_record_t* r = b.executive->recorder().find(1);
  ASSERT_NE(r, nullptr);
  EXPECT_EQ(r->tick, 1u);
  EXPECT_EQ(r->now_us, now_us);
  EXPECT_EQ(r->has_measurement, 1u);
  EXPECT_EQ(r->measurement.sequence, 77u);
  EXPECT_EQ(r->measurement.command_latency_us, 1234u);
  EXPECT_EQ(r->measurement.value[0], 0.3);
  EXPECT_EQ(r->command.sequence, 77u);
  EXPECT_EQ(r->command.value[0], 1.25);
  EXPECT_EQ(r->planner_iterations, 2u);
  EXPECT_EQ(r->plan_cost, 33.0);
  EXPECT_EQ(r->state_mean[0], 0.3);
  EXPECT_EQ(r->calls, 0u);
  ASSERT_NE(b.executive->recorder().find(0), nullptr);
  EXPECT_EQ(b.executive->recorder().find(0)->calls, static_cast<std::uint32_t>(tiller_call_arm));
  (void)b.tick(nullptr);
  EXPECT_EQ(b.executive->recorder().find(2)->has_measurement, 0u);
}

// A task begins with the motion: the row of a reference that is due is the plan's business to look up.
TEST(Task, StepsCountFromWhereMotionBegins) {
  Bench b;
  for (int i = 0; i < 3; ++i) (void)b.tick();  // STANDBY: no task
  EXPECT_EQ(fakes::planner.plans, 0);
  b.activate();
  EXPECT_EQ(fakes::planner.task_step, 0u);
  EXPECT_EQ(fakes::planner.tick, 3u);
  for (std::uint64_t step = 1; step < 5; ++step) {
    (void)b.tick();
    EXPECT_EQ(fakes::planner.task_step, step);
  }
  (void)b.executive->disarm();
  (void)b.tick();
  b.activate();
  EXPECT_EQ(fakes::planner.task_step, 0u) << "motion begins anew, and the task with it";
}

TEST(Task, PreparationIsForTheNextTick) {
  Bench b;
  b.executive->prepare();
  EXPECT_EQ(fakes::planner.preparations, 0) << "nothing is planned before motion";
  b.activate();
  (void)b.tick();
  b.executive->prepare();
  EXPECT_EQ(fakes::planner.preparations, 1);
  (void)b.tick();
  EXPECT_EQ(fakes::planner.expected_tick, fakes::planner.tick);
  EXPECT_EQ(fakes::planner.expected_task_step, fakes::planner.task_step);
  EXPECT_EQ(b.executive->recorder().find(1)->calls, 0u);
  EXPECT_EQ(b.executive->recorder().find(2)->calls, static_cast<std::uint32_t>(tiller_call_prepare));
  (void)b.executive->disarm();
  (void)b.tick();
  b.executive->prepare();
  EXPECT_EQ(fakes::planner.preparations, 1);
}

}  // namespace
