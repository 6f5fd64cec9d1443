// Nothing is planned from an estimate that is not one: faults of the posterior, and what is not learnt.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

using bench::Bench;
using bench::known_pendulum;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(Transition, NoLearningInSafe) {
  Bench b;
  b.activate();
  (void)b.executive->stop(tiller_status_stopped);
  const std::size_t before = fakes::posterior.transitions.size();
  for (int i = 0; i < 5; ++i) EXPECT_EQ(b.tick(), tiller_status_stopped);
  EXPECT_EQ(fakes::posterior.transitions.size(), before);
  (void)b.executive->reset();
  (void)b.tick();
  EXPECT_EQ(fakes::posterior.starts, 2) << "the state estimate starts again";
}

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
  EXPECT_EQ(b.tick(), tiller_status_ok) << "the filters start again at this measurement";
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
  fakes::posterior.update_status = tiller_status_measurement_outlier;
  const int plans = fakes::planner.plans;
  EXPECT_EQ(b.tick(), tiller_status_measurement_outlier);
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
  tiller::Config config = known_pendulum();
  config.hold_gain[1] = 1.0;
  Bench b(config);
  b.activate();
  fakes::planner.result.status = tiller_status_plan_not_finite;
  (void)b.tick();
  ASSERT_EQ(b.state(), tiller_state_hold);
  fakes::posterior.update_status = tiller_status_measurement_outlier;
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
  tiller::Config config = known_pendulum();
  config.safety.safe_command[0] = 0.5;
  config.hold_gain[1] = 1.0;
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

}  // namespace
