// A model that does not explain the data is told of, and stops nothing.
#include <gtest/gtest.h>

#include <limits>

#include "bench.hpp"

namespace {

using bench::Bench;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// In motion until the fake posterior's test has given its alarm: some 30 ticks of four deviations.
void alarm(Bench& b) {
  fakes::posterior.tested = true;
  b.activate();
  for (int i = 0; i < 200 && b.executive->info().adequacy != tiller_adequacy_inadequate; ++i) (void)b.tick();
  ASSERT_EQ(b.executive->info().adequacy, tiller_adequacy_inadequate);
}

// Requirement: SR-20
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
  tiller_record_t r;
  ASSERT_TRUE(b.executive->recorder().read(info.ticks - 1, r));
  EXPECT_EQ(r.status, tiller_status_model_inadequate);
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
  EXPECT_EQ(b.tick(), tiller_status_model_inadequate) << "what was found stands while the robot stands by";
  (void)b.executive->stop(tiller_status_stopped);
  (void)b.tick();
  (void)b.executive->reset();
  EXPECT_EQ(b.executive->info().adequacy, static_cast<std::uint32_t>(tiller_adequacy_untested));
  EXPECT_EQ(b.tick(), tiller_status_ok);
}

}  // namespace
