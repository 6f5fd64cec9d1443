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

/// Two masses on lines of their own as one model of two inputs.
void two_masses(const double* x, const double* u, const double* f, const tiller_body_t*, const double* p, double* dx) {
  for (int i = 0; i < 2; ++i) dx[i] = x[2 + i], dx[2 + i] = (u[i] + f[i]) / p[i];
}
const char* const kTwoNames[] = {"x1", "x2", "v1", "v2"};
const tiller_joint_t kTwoJoints[] = {{"first", 0, 2, 0, 0}, {"second", 1, 3, 1, 0}};

tiller_model_t two_mass_model() {
  tiller_model_t m{};
  m.size = sizeof m;
  m.version = TILLER_MODEL_VERSION;
  m.name = "two_masses";
  m.state_count = 4;
  m.input_count = m.param_count = m.joint_count = 2;
  m.state_names = m.input_names = m.param_names = m.force_names = kTwoNames;
  m.joints = kTwoJoints;
  m.dynamics = two_masses;
  return m;
}

/// What has nothing to do with one another is planned as each alone, whatever the weights that tie an input to the one
/// before.
TEST(ScenarioTree, masses_side_by_side_are_pushed_as_each_alone) {
  constexpr std::uint32_t kMasses = 3, kShared = 4;
  const tiller_model_t model = two_mass_model();
  tiller::Config one = tree_config(kMasses, kShared);
  one.cost.input_rate_weight[0] = 0.05;
  tiller::Config both = one;
  both.model = &model;
  both.param_count = 2;
  for (double* weight : {both.cost.state_weight, both.cost.terminal_weight})
    weight[3] = weight[2] = weight[1], weight[1] = weight[0];
  both.cost.input_weight[1] = both.cost.input_weight[0];
  both.cost.input_rate_weight[1] = both.cost.input_rate_weight[0];
  both.safety.input_low[1] = both.safety.input_low[0];
  both.safety.input_high[1] = both.safety.input_high[0];
  Bench beside(both), first(one), second(one);
  spread_out(first);
  spread_out(second);
  for (std::uint32_t j = 0; j < kMasses; ++j) {
    second.params[j] *= 2.0f;
    second.state[j] *= -0.5f;
    int i = 0;
    for (Bench* alone : {&first, &second}) {
      beside.params[i * kMasses + j] = alone->params[j];
      beside.state[i * kMasses + j] = alone->state[j];
      beside.state[(2 + i) * kMasses + j] = alone->state[kMasses + j];
      ++i;
    }
  }
  for (Bench* bench : {&beside, &first, &second}) ASSERT_EQ(bench->plan_again().status, tiller_status_ok);
  EXPECT_NEAR(beside.command[0], first.command[0], 1e-6 * (1.0 + std::fabs(first.command[0])));
  EXPECT_NEAR(beside.command[1], second.command[0], 1e-6 * (1.0 + std::fabs(second.command[0])));
  for (std::uint32_t k = 0; k < kSteps; ++k) {
    EXPECT_NEAR(beside.sequence()[2 * k], first.sequence()[k], 1e-4) << k;
    EXPECT_NEAR(beside.sequence()[2 * k + 1], second.sequence()[k], 1e-4) << k;
  }
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
