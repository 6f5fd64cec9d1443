// Warm start and task begin where motion begins.
#include <gtest/gtest.h>

#include <functional>

#include "bench.hpp"

namespace {

using bench::Bench;

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
  EXPECT_EQ(fakes::planner.task_step, 0u) << "motion starts again, and the task with it";
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
  tiller_record_t r;
  ASSERT_TRUE(b.executive->recorder().read(1, r));
  EXPECT_EQ(r.calls, 0u);
  ASSERT_TRUE(b.executive->recorder().read(2, r));
  EXPECT_EQ(r.calls, static_cast<std::uint32_t>(tiller_call_prepare));
  (void)b.executive->disarm();
  (void)b.tick();
  b.executive->prepare();
  EXPECT_EQ(fakes::planner.preparations, 1);
}

}  // namespace
