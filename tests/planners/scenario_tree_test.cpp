// iLQR on a tree of scenarios, on linear systems: the whole tree is then one quadratic in all of its inputs, which the
// test writes out by simulating, and solves densely.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tiller/config.hpp"
#include "tree_problem.hpp"

namespace tiller_test {
namespace {

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
  survives_bad_hypotheses(bench);
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
