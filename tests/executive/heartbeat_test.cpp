// A plan's number goes on with each new plan and with nothing else, over counters of years too.
#include <gtest/gtest.h>

#include <cmath>

#include "bench.hpp"
#include "tiller/config.hpp"

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
  tiller::Config config = known_pendulum();
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

}  // namespace
