// A command at any time: deadlines, zero iterations, beliefs without a finite trajectory.

#include <atomic>

#include "planner_matrix.hpp"
#include "thread_pool.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using Anytime = EveryPlanner;

// Time passes in rollout calls alone: one call, one unit. Atomic, because workers roll out too.
std::atomic<std::int64_t> ticking{0};

tiller_hooks_t clock_hooks() {
  tiller_hooks_t h{};
  h.size = sizeof h;
  h.version = TILLER_CONFIG_VERSION;
  h.now_ns = [](void*) { return ticking.load(); };
  return h;
}

struct TickingClock {
  TickingClock() {
    ticking = 0;
    on_plain_rollout = [] { ++ticking; };
  }
  ~TickingClock() { on_plain_rollout = nullptr; }
};

// 512 rollouts in chunks of 64 over 4 particles: 32 calls an iteration.
tiller::Config long_iterations(std::uint32_t planner) {
  tiller::Config c = line_config(planner);
  c.planner.rollouts = 512;
  c.planner.particles = 4;
  c.planner.horizon = 10;
  return c;
}
constexpr std::int64_t kCallsPerIteration = 32;
// After the deadline: the call that was running, and up to four in which the planner settles on its mean (MPPI's
// line search; each is one rollout per particle, not K).
constexpr std::int64_t kCallsToSettle = 4;

TEST_P(Anytime, stops_at_the_deadline_within_one_rollout_call) {
  if (is_gradient(GetParam())) GTEST_SKIP() << "see ilqr_test.cpp";
  const TickingClock clock;
  const tiller_hooks_t hooks = clock_hooks();
  std::int64_t worst = 0;
  for (std::int64_t budget = 1; budget < 5 * kCallsPerIteration; ++budget) {
    Bench bench(long_iterations(GetParam()), &hooks);
    bench.set_state({1.0, 0.0});
    bench.request.deadline.iterations = 100;
    bench.request.deadline.deadline_ns = ticking + budget;
    const tiller::PlanResult result = bench.plan();
    const std::int64_t late = ticking - bench.request.deadline.deadline_ns;
    worst = std::max(worst, late);
    EXPECT_EQ(result.status, tiller_status_iteration_capped);
    EXPECT_LE(late, kCallsToSettle);
    EXPECT_EQ(result.iterations, budget / kCallsPerIteration);
    EXPECT_TRUE(std::isfinite(bench.command[0]));
  }
  std::printf("%s: at worst %d rollout calls late\n", tiller::find_planner(GetParam())->name, static_cast<int>(worst));
}

TEST_P(Anytime, a_partial_iteration_leaves_no_trace) {
  if (is_gradient(GetParam())) GTEST_SKIP() << "see ilqr_test.cpp";
  const TickingClock clock;
  const tiller_hooks_t hooks = clock_hooks();
  Bench interrupted(long_iterations(GetParam()), &hooks), whole(long_iterations(GetParam()), &hooks);
  for (Bench* bench : {&interrupted, &whole}) bench->set_state({1.0, 0.0});
  for (int i = 0; i < 5; ++i) {
    interrupted.request.deadline.iterations = 100;
    interrupted.request.deadline.deadline_ns = ticking + 2 * kCallsPerIteration + 7;
    ASSERT_EQ(interrupted.plan().iterations, 2u);
    whole.request.deadline.iterations = 2;  // as a replay does it
    const tiller::PlanResult result = whole.plan();
    EXPECT_EQ(result.status, tiller_status_ok);
    EXPECT_EQ(0, std::memcmp(interrupted.command, whole.command, sizeof whole.command));
    EXPECT_EQ(0, std::memcmp(interrupted.sequence(), whole.sequence(), 10 * sizeof(float)));
  }
}

TEST_P(Anytime, deadline_holds_with_threads) {
  const TickingClock clock;
  ThreadPool pool(4);
  tiller_hooks_t hooks = pool.hooks();
  hooks.now_ns = [](void*) { return ticking.load(); };
  Bench bench(long_iterations(GetParam()), &hooks);
  for (std::int64_t budget = 1; budget < 3 * kCallsPerIteration; budget += 5) {
    bench.set_state({1.0, 0.0});
    bench.request.deadline.iterations = 100;
    bench.request.deadline.deadline_ns = ticking + budget;
    bench.plan();
    EXPECT_LE(ticking - bench.request.deadline.deadline_ns, kCallsToSettle + 3);  // one call a thread
    EXPECT_TRUE(std::isfinite(bench.command[0]));
  }
}

TEST_P(Anytime, zero_iterations_follow_the_old_plan) {
  Bench bench(line_config(GetParam()));
  bench.set_state({1.0, 0.0});
  bench.plan();
  const std::vector<float> old(bench.sequence(), bench.sequence() + 50);
  bench.request.deadline.iterations = 0;
  for (std::uint32_t t = 1; t < 50; ++t) {
    const tiller::PlanResult result = bench.plan();
    EXPECT_EQ(result.status, tiller_status_ok);
    EXPECT_EQ(result.iterations, 0u);
    EXPECT_NEAR(bench.command[0], static_cast<double>(old[t]), 2e-6) << t;  // rounding of float at 5 N
  }
}

TEST_P(Anytime, a_pause_does_not_bring_back_a_stale_plan) {
  Bench bench(line_config(GetParam()));
  bench.set_state({1.0, 0.0});
  bench.plan();
  const float last = bench.sequence()[49];
  bench.request.tick += 1000;
  bench.request.deadline.iterations = 0;
  bench.plan();
  EXPECT_FLOAT_EQ(static_cast<float>(bench.command[0]), last);  // all of the plan is past: its end holds
}

TEST_P(Anytime, beliefs_without_a_finite_trajectory_keep_the_plan) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    Bench bench(line_config(GetParam())), untouched(line_config(GetParam()));
    for (Bench* b : {&bench, &untouched}) {
      b->set_state({1.0, 0.0});
      ASSERT_EQ(b->plan().status, tiller_status_ok);
      b->request.deadline.iterations = 0;
    }
    bench.request.deadline.iterations = 2;
    bench.set_state({bad, 0.0});
    const tiller::PlanResult result = bench.plan();
    untouched.plan();
    EXPECT_EQ(result.status, tiller_status_plan_not_finite);
    EXPECT_EQ(result.iterations, 0u);
    EXPECT_TRUE(std::isinf(result.cost));
    EXPECT_EQ(bench.command[0], untouched.command[0]);
    bench.set_state({1.0, 0.0});  // and the next one plans again
    EXPECT_EQ(bench.plan().status, tiller_status_ok);
  }
}

TEST_P(Anytime, no_belief_is_no_plan) {
  Bench bench(line_config(GetParam()));
  bench.belief.count = 0;
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
  EXPECT_EQ(bench.command[0], 0.0);
  bench.request.belief = nullptr;
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
}

TEST_P(Anytime, one_bad_particle_makes_no_rollout_finite) {
  tiller::Config c = line_config(GetParam());
  c.planner.particles = 4;
  Bench bench(c);
  bench.params[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
}

TILLER_EVERY_PLANNER(Anytime);

}  // namespace
}  // namespace tiller_test
