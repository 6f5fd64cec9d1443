// A plan that failed, came late or is not finite never reaches the motor: HOLD, with feedback.
#include <gtest/gtest.h>

#include <limits>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

using bench::Bench;
using bench::known_pendulum;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Requirement: SR-10
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

// Requirement: SR-1, SR-10
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
  tiller::Config config = known_pendulum();
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
  EXPECT_EQ(b.executive->info().gate_clipped, 1u);
  EXPECT_EQ(b.state(), tiller_state_active);
  (void)b.tick();
  EXPECT_EQ(fakes::planner.last_command[0], 10.0) << "the planner is told what was sent, not what it wished";
}

// Requirement: SR-10
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

}  // namespace
