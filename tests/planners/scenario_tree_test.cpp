// iLQR on a tree of scenarios, on linear systems: the whole tree is then one quadratic in all of its inputs, which the
// test writes out by simulating, and solves densely.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

constexpr std::uint32_t kSteps = 12;

tiller::Config tree_config(std::uint32_t masses, std::uint32_t shared) {
  tiller::Config c = line_config(tiller_planner_ilqr);
  c.planner.horizon = kSteps;
  c.planner.particles = masses;
  c.planner.iterations = 20;
  c.planner.closed_loop = 1;
  c.planner.shared_steps = shared;
  c.safety.input_low[0] = -1e6;
  c.safety.input_high[0] = 1e6;
  return c;
}

void spread_out(Bench& bench) {
  const std::uint32_t m = bench.belief.count;
  for (std::uint32_t j = 0; j < m; ++j) {
    bench.params[j] = 0.5f + 0.4f * static_cast<float>(j);
    bench.state[j] = 1.0f - 0.3f * static_cast<float>(j);
    bench.state[m + j] = 0.2f * static_cast<float>(j);
  }
}

/// All inputs of the tree: first the shared ones, then branch by branch.
using Inputs = std::vector<double>;

struct Tree {
  const Bench& bench;
  std::uint32_t masses, shared;

  std::size_t size() const { return shared + std::size_t{masses} * (kSteps - shared); }
  std::size_t at(std::uint32_t mass, std::uint32_t step) const {
    return step < shared ? step : shared + std::size_t{mass} * (kSteps - shared) + step - shared;
  }
  double cost_of(const Inputs& u, std::uint32_t j) const {
    const tiller_cost_config_t& w = bench.config().cost;
    const double h = bench.config().period_s;
    double x = static_cast<double>(bench.state[j]), v = static_cast<double>(bench.state[masses + j]), cost = 0.0;
    double last = bench.last_command[0];
    for (std::uint32_t k = 0; k < kSteps; ++k) {
      const double input = u[at(j, k)];
      cost += w.state_weight[0] * x * x + w.state_weight[1] * v * v + w.input_weight[0] * input * input +
              w.input_rate_weight[0] * (input - last) * (input - last);
      last = input;
      x += h * v;
      v += h * input / static_cast<double>(bench.params[j]);
    }
    return cost + w.terminal_weight[0] * x * x + w.terminal_weight[1] * v * v;
  }
  double mean_cost(const Inputs& u) const {
    double sum = 0.0;
    for (std::uint32_t j = 0; j < masses; ++j) sum += cost_of(u, j) / masses;
    return sum;
  }
};

/// value + gradient' u + 1/2 u' hessian u, from values alone: the cost is quadratic.
struct Quadratic {
  double value;
  Inputs gradient;
  std::vector<Inputs> hessian;

  explicit Quadratic(const Tree& tree) {
    const std::size_t n = tree.size();
    Inputs u(n, 0.0);
    value = tree.mean_cost(u);
    Inputs plus(n), minus(n);
    for (std::size_t i = 0; i < n; ++i) {
      u[i] = 1.0;
      plus[i] = tree.mean_cost(u);
      u[i] = -1.0;
      minus[i] = tree.mean_cost(u);
      u[i] = 0.0;
    }
    gradient.resize(n);
    hessian.assign(n, Inputs(n));
    for (std::size_t i = 0; i < n; ++i) {
      gradient[i] = 0.5 * (plus[i] - minus[i]);
      hessian[i][i] = plus[i] + minus[i] - 2.0 * value;
      for (std::size_t j = 0; j < i; ++j) {
        u[i] = u[j] = 1.0;
        hessian[i][j] = hessian[j][i] = tree.mean_cost(u) - plus[i] - plus[j] + value;
        u[i] = u[j] = 0.0;
      }
    }
  }

  /// By elimination.
  Inputs minimum() const {
    const std::size_t n = gradient.size();
    std::vector<Inputs> a = hessian;
    Inputs b(n);
    for (std::size_t i = 0; i < n; ++i) b[i] = -gradient[i];
    for (std::size_t p = 0; p < n; ++p)
      for (std::size_t i = p + 1; i < n; ++i) {
        const double f = a[i][p] / a[p][p];
        for (std::size_t j = p; j < n; ++j) a[i][j] -= f * a[p][j];
        b[i] -= f * b[p];
      }
    for (std::size_t p = n; p-- > 0;) {
      for (std::size_t j = p + 1; j < n; ++j) b[p] -= a[p][j] * b[j];
      b[p] /= a[p][p];
    }
    return b;
  }

  /// By coordinate descent, until nothing moves.
  Inputs minimum_within(double low, double high) const {
    const std::size_t n = gradient.size();
    Inputs u(n, 0.0);
    for (int pass = 0; pass < 200000; ++pass) {
      double moved = 0.0;
      for (std::size_t i = 0; i < n; ++i) {
        double pull = gradient[i];
        for (std::size_t j = 0; j < n; ++j) pull += hessian[i][j] * u[j];
        const double next = std::min(std::max(u[i] - pull / hessian[i][i], low), high);
        moved = std::max(moved, std::fabs(next - u[i]));
        u[i] = next;
      }
      if (moved < 1e-13) break;
    }
    return u;
  }
};

struct Shape {
  std::uint32_t masses, shared;
  double rate_weight;
};

class ScenarioTree : public ::testing::TestWithParam<Shape> {};
INSTANTIATE_TEST_SUITE_P(Shapes, ScenarioTree,
                         ::testing::Values(Shape{2, 1, 0.0}, Shape{3, 1, 0.0}, Shape{8, 1, 0.0}, Shape{3, 4, 0.0},
                                           Shape{4, kSteps - 1, 0.0}, Shape{3, 1, 0.05}, Shape{5, 3, 0.05}));

TEST_P(ScenarioTree, first_input_and_cost_are_those_of_the_dense_solution) {
  const auto [masses, shared, rate_weight] = GetParam();
  tiller::Config c = tree_config(masses, shared);
  c.cost.input_rate_weight[0] = rate_weight;
  Bench bench(c);
  spread_out(bench);
  const Tree tree{bench, masses, shared};
  const Inputs best = Quadratic(tree).minimum();
  const tiller::PlanResult result = bench.plan_again();
  EXPECT_EQ(result.status, tiller_status_ok);
  EXPECT_NEAR(bench.command[0], best[0], 1e-6 * (1.0 + std::fabs(best[0])));
  EXPECT_NEAR(result.cost, tree.mean_cost(best), 1e-9 * (1.0 + tree.mean_cost(best)));
}

TEST_P(ScenarioTree, keeps_to_the_box_as_the_dense_solution_does) {
  const auto [masses, shared, rate_weight] = GetParam();
  tiller::Config c = tree_config(masses, shared);
  c.cost.input_rate_weight[0] = rate_weight;
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 2.0;
  Bench bench(c);
  spread_out(bench);
  const Tree tree{bench, masses, shared};
  const Inputs best = Quadratic(tree).minimum_within(-3.0, 2.0);
  // some inputs are at a limit, some are not
  ASSERT_GT(std::count(best.begin(), best.end(), -3.0), 0);
  ASSERT_LT(std::count(best.begin(), best.end(), -3.0), static_cast<long>(best.size()));
  const tiller::PlanResult result = bench.plan_again();
  EXPECT_NEAR(result.cost, tree.mean_cost(best), 1e-7 * (1.0 + tree.mean_cost(best)));
  EXPECT_NEAR(bench.command[0], best[0], 1e-4);
}

/// Risk-averse trees: no worse in the worst case than one sequence, which is one of the trees.
TEST(ScenarioTree, the_worst_branch_costs_no_more_than_under_one_sequence) {
  tiller::Config c = tree_config(5, 1);
  c.planner.risk = tiller_risk_worst;
  c.planner.iterations = 60;
  tiller::Config one = c;
  one.planner.closed_loop = 0;
  one.planner.shooting = tiller_shooting_single;
  Bench tree(c), sequence(one);
  for (Bench* bench : {&tree, &sequence}) {
    spread_out(*bench);
    // on both sides of the target: one sequence cannot push both towards it
    bench->state[0] = 1.0f;
    bench->state[1] = -1.0f;
  }
  const double in_tree = tree.plan_again().cost, in_sequence = sequence.plan_again().cost;
  EXPECT_LT(in_tree, 0.95 * in_sequence);
}

TEST(ScenarioTree, of_every_step_shared_is_one_sequence) {
  tiller::Config c = tree_config(3, kSteps);
  tiller::Config one = c;
  one.planner.closed_loop = 0;
  Bench tree(c), sequence(one);
  spread_out(tree);
  spread_out(sequence);
  tree.plan_again();
  sequence.plan_again();
  EXPECT_EQ(tree.command[0], sequence.command[0]);
  EXPECT_EQ(tree.bytes(), sequence.bytes());
}

// From tick to tick the branches are shifted and merged; the plan settles to rest, and is as good as a new one.
TEST(ScenarioTree, goes_on_from_the_plan_before) {
  const tiller::Config c = tree_config(4, 2);
  Bench kept(c);
  spread_out(kept);
  for (int tick = 0; tick < 8; ++tick) {
    ASSERT_EQ(kept.plan().status, tiller_status_ok);
    Bench fresh(c);
    fresh.params = kept.params;
    fresh.state = kept.state;
    fresh.belief.params = fresh.params.data();
    fresh.belief.state = fresh.state.data();
    std::copy(kept.last_command, kept.last_command + 1, fresh.last_command);
    const double cost = fresh.plan_again().cost;
    const tiller::PlanResult again = kept.plan();
    EXPECT_NEAR(again.cost, cost, 1e-6 * (1.0 + cost)) << tick;
  }
}

TEST(ScenarioTree, survives_bad_hypotheses_and_fewer_of_them) {
  Bench bench(tree_config(4, 1));
  spread_out(bench);
  ASSERT_EQ(bench.plan().status, tiller_status_ok);
  const std::vector<float> good = bench.params;
  bench.params[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
  EXPECT_TRUE(std::isfinite(bench.command[0]));
  bench.params = good;
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
  const std::vector<float> params = {1.0f, 1.2f}, state = {0.5f, 0.4f, 0.0f, 0.1f};
  bench.belief.count = 2;
  bench.belief.params = params.data();
  bench.belief.state = state.data();
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
  bench.request.belief = nullptr;
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
  EXPECT_TRUE(std::isfinite(bench.command[0]));
}

TEST(ScenarioTree, feedback_of_a_branching_plan_answers_the_deviation) {
  Bench bench(tree_config(3, 2));
  spread_out(bench);
  bench.plan_again();
  const tiller::PlannerTable& table = *tiller::find_planner(tiller_planner_ilqr);
  for (std::uint32_t k = 0; k < kSteps; ++k) {
    double gain[2], state[2], input;
    ASSERT_TRUE(table.feedback(bench.planner(), k, gain, state, &input)) << k;
    // a push back; the last one comes too late for the position
    if (k + 1 < kSteps) {
      EXPECT_LT(gain[0], 0.0) << k;
    }
    EXPECT_NEAR(input, static_cast<double>(bench.sequence()[k]), 1e-5 * (1.0 + std::fabs(input)));
  }
  EXPECT_FALSE(table.feedback(bench.planner(), kSteps, nullptr, nullptr, nullptr));
}

}  // namespace
}  // namespace tiller_test
