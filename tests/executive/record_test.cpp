// The record keeps every input and output of a tick.
#include <gtest/gtest.h>

#include "bench.hpp"

namespace {

using bench::Bench;

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
  tiller_record_t r;
  ASSERT_TRUE(b.executive->recorder().read(1, r));
  EXPECT_EQ(r.tick, 1u);
  EXPECT_EQ(r.now_us, now_us);
  EXPECT_EQ(r.has_measurement, 1u);
  EXPECT_EQ(r.measurement.sequence, 77u);
  EXPECT_EQ(r.measurement.command_latency_us, 1234u);
  EXPECT_EQ(r.measurement.value[0], 0.3);
  EXPECT_EQ(r.command.sequence, 77u);
  EXPECT_EQ(r.command.value[0], 1.25);
  EXPECT_EQ(r.planner_iterations, 2u);
  EXPECT_EQ(r.plan_cost, 33.0);
  EXPECT_EQ(r.state_mean[0], 0.3);
  EXPECT_EQ(r.calls, 0u);
  ASSERT_TRUE(b.executive->recorder().read(0, r));
  EXPECT_EQ(r.calls, static_cast<std::uint32_t>(tiller_call_arm));
  (void)b.tick(nullptr);
  ASSERT_TRUE(b.executive->recorder().read(2, r));
  EXPECT_EQ(r.has_measurement, 0u);
  EXPECT_FALSE(b.executive->recorder().read(3, r));
}

}  // namespace
