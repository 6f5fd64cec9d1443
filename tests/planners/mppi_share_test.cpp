// MPPI solves for lambda: the weights' effective sample size is the configured share of the finite samples.

#include <gtest/gtest.h>

#include "planners/sampler.hpp"
#include "problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

double effective_share(const tiller::Sampler& s) {
  double sum = 0.0, squares = 0.0;
  for (std::uint32_t k = 0; k < s.rollouts; ++k) {
    sum += static_cast<double>(s.weight[k]);
    squares += static_cast<double>(s.weight[k]) * static_cast<double>(s.weight[k]);
  }
  return sum * sum / squares / s.range.finite;
}

TEST(MppiShare, is_the_temperature_whatever_the_costs_scale) {
  for (const double share : {0.01, 0.05, 0.3, 0.9})
    for (const double scale : {1e-12, 1.0, 1e12}) {
      tiller::Config c = line_config(tiller_planner_mppi);
      c.planner.rollouts = 1024;
      c.planner.temperature = share;
      for (int i = 0; i < 2; ++i) {
        c.cost.state_weight[i] *= scale;
        c.cost.terminal_weight[i] *= scale;
      }
      c.cost.input_weight[0] *= scale;
      Bench bench(c);
      for (int t = 0; t < 20; ++t) {
        bench.set_state({std::cos(0.2 * t), 0.0});
        ASSERT_EQ(bench.plan().status, tiller_status_ok);
        // the solver's tolerance is 2 % of the logarithm
        EXPECT_NEAR(effective_share(*static_cast<const tiller::Sampler*>(bench.planner())), share, 0.021 * share);
      }
    }
}

TEST(MppiShare, of_equal_costs_is_one) {
  tiller::Config c = line_config(tiller_planner_mppi);
  c.planner.noise_sd[0] = 1e-30;
  Bench bench(c);
  bench.set_state({1.0, 0.0});
  ASSERT_EQ(bench.plan().status, tiller_status_ok);
  EXPECT_DOUBLE_EQ(effective_share(*static_cast<const tiller::Sampler*>(bench.planner())), 1.0);
  EXPECT_NEAR(bench.command[0], 0.0, 1e-29);
}

}  // namespace
}  // namespace tiller_test
