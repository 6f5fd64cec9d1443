// The same inputs give the same commands to the last bit, on any number of threads; the next tick gives other noise.

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

#include "planner_matrix.hpp"
#include "thread_pool.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using Bits = EveryPlanner;

tiller::Config shared_work(std::uint32_t planner) {
  tiller::Config c = line_config(planner);
  c.planner.rollouts = 1040;  // the last chunk is not full
  c.planner.particles = 3;
  c.planner.iterations = 3;
  c.planner.horizon = 20;
  c.planner.risk = tiller_risk_cvar;
  c.planner.cvar_alpha = 0.5;
  c.planner.hold_steps = 2;  // more sequences than a search can go through
  c.planner.levels = 16;
  return c;
}

/// Commands and plans of 30 ticks on a moving state.
std::vector<double> run(Bench& bench) {
  std::vector<double> all;
  for (int t = 0; t < 30; ++t) {
    bench.set_state({std::cos(0.1 * t), -std::sin(0.2 * t)});
    for (std::uint32_t m = 0; m < bench.belief.count; ++m) bench.params[m] = 0.5f + 0.5f * static_cast<float>(m);
    all.push_back(bench.plan().cost);
    all.push_back(bench.command[0]);
    for (int i = 0; i < 20; ++i) all.push_back(static_cast<double>(bench.sequence()[i]));
  }
  return all;
}

void expect_same_on_any_threads(const tiller_config_t& config) {
  Bench alone(config);
  const std::vector<double> reference = run(alone);
  for (const std::uint32_t threads : {1u, 2u, 4u}) {
    ThreadPool pool(threads);
    const tiller_hooks_t hooks = pool.hooks();
    Bench bench(config, &hooks);
    EXPECT_EQ(run(bench), reference) << threads << " threads";
    std::printf("%s: %u threads, %llu pieces of work done by workers\n",
                tiller::find_planner(config.planner.kind)->name, threads,
                static_cast<unsigned long long>(pool.served_by_workers()));
  }
}

TEST_P(Bits, do_not_depend_on_threads) { expect_same_on_any_threads(shared_work(GetParam())); }

TEST_P(Bits, do_not_depend_on_threads_with_every_option) {
  tiller::Config c = shared_work(GetParam());
  switch_options_on(c);
  expect_same_on_any_threads(c);
}

TEST_P(Bits, repeat) {
  Bench first(shared_work(GetParam())), second(shared_work(GetParam()));
  const std::vector<double> reference = run(first);
  EXPECT_EQ(run(second), reference);
  second.reset();
  second.request.tick = 0;
  second.last_command[0] = 0.0;
  EXPECT_EQ(run(second), reference) << "after reset";
}

TEST_P(Bits, differ_by_tick_and_by_seed) {
  if (is_gradient(GetParam())) GTEST_SKIP() << "the optimum of a linear model is the same";
  tiller::Config c = shared_work(GetParam());
  // the whole plan: planners that choose among a few values often choose the same first one
  const auto planned = [](const tiller_config_t& config, std::uint64_t tick) {
    Bench bench(config);
    bench.set_state({0.2, 0.5});  // far from the limits, where commands meet
    bench.request.tick = tick;
    bench.plan();
    std::vector<double> plan(bench.sequence(), bench.sequence() + config.planner.horizon);
    plan.push_back(bench.command[0]);
    return plan;
  };
  const std::vector<double> reference = planned(c, 7);
  EXPECT_EQ(planned(c, 7), reference);
  EXPECT_NE(planned(c, 8), reference);
  EXPECT_NE(planned(c, 7 + (std::uint64_t{1} << 32)), reference);
  c.seed += std::uint64_t{1} << 32;
  EXPECT_NE(planned(c, 7), reference);
}

#if defined(__SSE2__)
TEST_P(Bits, of_the_callers_floating_point_mode_are_restored) {
  const unsigned before = _mm_getcsr();
  Bench bench(shared_work(GetParam()));
  bench.set_state({1.0, 0.0});
  bench.plan();
  EXPECT_EQ(_mm_getcsr() & 0xffc0u, before & 0xffc0u);  // all but the sticky exception flags
}
#endif

TILLER_EVERY_PLANNER(Bits);

}  // namespace
}  // namespace tiller_test
