// The one problem whose answer is known: a linear system with quadratic cost, no limit in reach. The planner runs in
// closed loop; its cost is set against the discrete Riccati solution of the same sum.

#include <gtest/gtest.h>

#include "planner_matrix.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

struct Gain {
  double k[2];
};

/// Gains of the finite problem by the Riccati recursion, written out for two states; [0] is the first step's.
std::vector<Gain> riccati(const tiller_config_t& c, double mass_kg, std::uint32_t steps) {
  const double dt = c.period_s;
  const double a[2][2] = {{1.0, dt}, {0.0, 1.0}}, b[2] = {0.0, dt / mass_kg};
  double p[2][2] = {{c.cost.terminal_weight[0], 0.0}, {0.0, c.cost.terminal_weight[1]}};
  std::vector<Gain> gains(steps);
  for (std::uint32_t t = steps; t-- > 0;) {
    double pa[2][2], pb[2];
    for (int i = 0; i < 2; ++i) {
      pb[i] = p[i][0] * b[0] + p[i][1] * b[1];
      for (int j = 0; j < 2; ++j) pa[i][j] = p[i][0] * a[0][j] + p[i][1] * a[1][j];
    }
    const double h = c.cost.input_weight[0] + b[0] * pb[0] + b[1] * pb[1];
    for (int j = 0; j < 2; ++j) gains[t].k[j] = (b[0] * pa[0][j] + b[1] * pa[1][j]) / h;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j)
        p[i][j] = (i == j ? c.cost.state_weight[i] : 0.0) + a[0][i] * pa[0][j] + a[1][i] * pa[1][j] -
                  (a[0][i] * pb[0] + a[1][i] * pb[1]) * gains[t].k[j];
  }
  return gains;
}

/// Cost of 300 steps from (1 m, 0) under `policy(t, x)`.
template <class Policy>
double closed_loop_cost(const tiller_config_t& c, Policy policy) {
  double x[2] = {1.0, 0.0}, cost = 0.0;
  for (std::uint32_t t = 0; t < 300; ++t) {
    const double u = policy(t, x);
    cost +=
        c.cost.state_weight[0] * x[0] * x[0] + c.cost.state_weight[1] * x[1] * x[1] + c.cost.input_weight[0] * u * u;
    const double velocity = x[1];
    x[1] += c.period_s * u;
    x[0] += c.period_s * velocity;
  }
  return cost + c.cost.terminal_weight[0] * x[0] * x[0] + c.cost.terminal_weight[1] * x[1] * x[1];
}

class Lqr : public ::testing::TestWithParam<std::uint32_t> {};

TEST_P(Lqr, closed_loop_cost_is_near_optimal) {
  tiller::Config c = line_config(GetParam());
  c.planner.rollouts = 256;
  c.planner.iterations = 3;
  c.planner.levels = 15;
  for (double& low : c.safety.input_low) low = -50.0;
  for (double& high : c.safety.input_high) high = 50.0;
  // 15 values of an input are 7 N apart, held for 0.1 s: near the goal such a plan chatters about the best one
  const double allowed = GetParam() == tiller_planner_mcts ? 1.6 : 1.1;
  const std::vector<Gain> gains = riccati(c, 1.0, 300);
  const double optimal = closed_loop_cost(
      c, [&](std::uint32_t t, const double* x) { return -gains[t].k[0] * x[0] - gains[t].k[1] * x[1]; });
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    c.seed = seed;
    Bench bench(c);
    const double cost = closed_loop_cost(c, [&](std::uint32_t, const double* x) {
      bench.set_state({x[0], x[1]});
      EXPECT_EQ(bench.plan().status, tiller_status_ok);
      return bench.command[0];
    });
    std::printf("%s seed %d: closed-loop cost %.4f, Riccati %.4f, ratio %.3f\n",
                tiller::find_planner(c.planner.kind)->name, static_cast<int>(seed), cost, optimal, cost / optimal);
    EXPECT_GE(cost, optimal * (1.0 - 1e-9));  // nobody beats the optimum: the two costs are the same sum
    EXPECT_LE(cost, optimal * allowed);
  }
}

INSTANTIATE_TEST_SUITE_P(planners, Lqr, ::testing::Range(0u, static_cast<std::uint32_t>(tiller_planner_policy)),
                         [](const auto& p) { return tiller::find_planner(p.param)->name; });

}  // namespace
}  // namespace tiller_test
