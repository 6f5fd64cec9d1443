// hybrid: which swing-up it finds in closed loop, that it holds what falls under its inputs alone, and that no plan
// costs more than those it began from.

#include <gtest/gtest.h>

#include "swing_up_problem.hpp"

namespace tiller_test {
namespace {

tiller::Config hybrid_config(std::uint32_t shooting, std::uint32_t refinements, std::uint64_t seed) {
  tiller::Config c = swing_up_config(tiller_planner_hybrid);
  c.planner.shooting = shooting;
  c.planner.refine_iterations = refinements;
  c.planner.iterations = 1 + refinements;
  c.seed = seed;
  return c;
}

/// Half of x'Qx + u'Ru over 400 steps from hanging.
double closed_loop_cost(const tiller_config_t& c) {
  CartPoleBench bench(c);
  double x[4] = {0.0, kHanging, 0.0, 0.0}, sum = 0.0;
  for (int t = 0; t < 400; ++t) {
    bench.set_state({x[0], x[1], x[2], x[3]});
    EXPECT_NE(bench.plan().status, tiller_status_plan_not_finite);
    EXPECT_LE(std::fabs(bench.command[0]), 20.0);
    sum += stage_cost(x, bench.command[0]);
    step_cart_pole(x, bench.command[0]);
  }
  return sum;
}

/// Single shooting ends in the minimum next to where it begins: it is the scout that finds the better one.
TEST(Hybrid, finds_the_better_swing_up) {
  int by_single = 0, by_multiple = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const double single = closed_loop_cost(hybrid_config(tiller_shooting_single, 5, seed)),
                 multiple = closed_loop_cost(hybrid_config(tiller_shooting_multiple, 5, seed));
    std::printf("seed %u: half the cost %.2f by single, %.2f by multiple shooting\n", static_cast<unsigned>(seed),
                single, multiple);
    by_single += single < 105.0;  // 95.09 is the best that any solver is known to find
    by_multiple += multiple < 105.0;
  }
  EXPECT_GE(by_single, 6);  // some samples lie in another valley
  EXPECT_GE(by_multiple, 8);
}

/// The cost that a plan reports is that of its sequence, and neither the shifted old one nor the sampled one is
/// cheaper.
TEST(Hybrid, plan_costs_no_more_than_its_warm_start_nor_its_samples) {
  for (const std::uint32_t shooting : {tiller_shooting_single, tiller_shooting_multiple}) {
    CartPoleBench bench(hybrid_config(shooting, 3, 1)), unrefined(hybrid_config(shooting, 0, 1));
    std::array<double, 4> x = {0.0, kHanging, 0.0, 0.0};
    for (int t = 0; t < 80; ++t) {
      for (CartPoleBench* b : {&bench, &unrefined}) b->set_state({x[0], x[1], x[2], x[3]});
      const double warm = sequence_cost(bench, x, t == 0 ? 0 : 1);
      // the sampler keeps a mean of its own, so that without refinements it draws the same
      const double sampled = unrefined.plan_again().cost;
      const double cost = bench.plan().cost, sent = sequence_cost(bench, x);
      EXPECT_NEAR(cost, sent, 1e-3 * sent + 1e-4) << "tick " << t;  // states and sequence are floats
      EXPECT_LE(cost, warm * (1.0 + 1e-3) + 1e-4) << "tick " << t;
      EXPECT_TRUE(t > 0 || cost <= sampled) << cost << " of " << sampled;
      ++unrefined.request.tick;
      step_cart_pole(x.data(), bench.command[0]);
    }
  }
}

}  // namespace
}  // namespace tiller_test
