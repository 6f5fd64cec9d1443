#include "executive/plan_memory.hpp"

#include <gtest/gtest.h>

#include "bench.hpp"
#include "tiller/config.hpp"

namespace {

TEST(PlanMemory, FindsTheStepByTime) {
  const tiller::Config config = bench::known_pendulum();  // period 20 ms, horizon 8
  bench::Storage storage(4096);
  tiller::Arena arena = storage.arena();
  tiller::PlanMemory plan;
  plan.lay_out(arena, config);
  EXPECT_TRUE(plan.exhausted(0)) << "nothing kept yet";

  const float sequence[] = {0, 1, 2, 3, 4, 5, 6, 7};
  const double first = 0.1;  // not a float: what goes out is kept in full
  plan.keep(1000000, sequence, &first);
  EXPECT_EQ(plan.step(0)[0], 0.1);
  EXPECT_EQ(plan.step(3)[0], 3.0);
  const struct {
    std::int64_t after_us;
    std::uint32_t step;
  } cases[] = {
      {0, 0},        {1000, 0},   {17000, 0},  {18500, 1},  {20000, 1},    {21000, 1},  {37000, 1},
      {40000, 2},    {140000, 7}, {157000, 7}, {160000, 8}, {10000000, 8}, {-20000, 0}, {INT64_MAX - 1000000, 8},
      {INT64_MIN, 0}};
  for (const auto& c : cases) EXPECT_EQ(plan.step_at(1000000 + c.after_us), c.step) << c.after_us;
  plan.clear();
  EXPECT_TRUE(plan.exhausted(1000000));
}

}  // namespace
