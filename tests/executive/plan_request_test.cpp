// A request to a planner: iterations, deadline, and the state where the command takes hold.
#include <gtest/gtest.h>

#include <algorithm>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

using bench::Bench;
using bench::known_pendulum;

std::int64_t fixed_clock(void*) { return 5000; }

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

TEST(Plan, DeadlineCountsFromTheTicksStartAndNeedsAClock) {
  tiller::Config config = known_pendulum();
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

/// Of a planner that uses its deadline up and needs 20 us to come back; everything else takes 5 us a reading.
struct SpentClock {
  std::int64_t now_ns = 0, deadline_ns = 0;
  static std::int64_t look(void* self) {
    auto& clock = *static_cast<SpentClock*>(self);
    clock.now_ns += 5000;
    if (fakes::planner.deadline_ns == clock.deadline_ns) return clock.now_ns;
    clock.deadline_ns = fakes::planner.deadline_ns;
    return clock.now_ns = std::max(clock.now_ns, clock.deadline_ns) + 20000;
  }
};

TEST(Plan, TheDeadlineIsTheTicksSoThePlannersIsEarlier) {
  tiller::Config config = known_pendulum();
  config.planner.deadline_us = 1000;
  SpentClock clock;
  tiller_hooks_t hooks = {};
  hooks.now_ns = SpentClock::look;
  hooks.context = &clock;
  Bench b(config, &hooks);
  b.activate();
  EXPECT_GT(b.executive->info().tick_ns, 1000000) << "nobody knows yet what comes after a plan";
  int over = 0;
  std::int64_t least = 1000000;
  for (int k = 0; k < 500; ++k) {
    (void)b.tick();
    over += b.executive->info().tick_ns > 1000000;
    least = std::min(least, b.executive->info().tick_ns);
  }
  EXPECT_LE(over, 6) << "one of 128";
  EXPECT_GT(least, 980000) << "and no more time than that is given away";
  fakes::planner.result = {tiller_status_ok, 0, 0.0};
  for (int k = 0; k < 4; ++k) (void)b.tick();
  EXPECT_GT(b.executive->info().tick_ns, 1000000) << "a plan without an iteration gets the time back";
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

// A replay asks for as many iterations as the record says: a plan that stops before the refused one is not refused.
TEST(Plan, ARefusedIterationIsRecordedAsBegun) {
  Bench b;
  b.activate();
  fakes::planner.result = {tiller_status_plan_not_finite, 0, 0.0};
  (void)b.tick();
  EXPECT_EQ(b.executive->info().planner_iterations, 1u);
  fakes::planner.result = {tiller_status_plan_not_finite, 2, 0.0, true};
  (void)b.tick();
  EXPECT_EQ(b.executive->info().planner_iterations, 3u);
  fakes::planner.result = {tiller_status_plan_not_finite, 2, 0.0};
  (void)b.tick();
  EXPECT_EQ(b.executive->info().planner_iterations, 2u) << "refused as a whole, after its last iteration";
  fakes::planner.result = {tiller_status_ok, 0, 0.0};
  (void)b.tick();
  EXPECT_EQ(b.executive->info().planner_iterations, 0u) << "no time for one";
}

}  // namespace
