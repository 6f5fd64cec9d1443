// sqp on a tree of scenarios, on linear systems: the whole tree is then one quadratic program in all of its inputs,
// which the test writes out by simulating, and solves densely.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "dense_qp.hpp"
#include "planners/ilqr.hpp"
#include "planners/sqp.hpp"
#include "planners/sqp_tree.hpp"
#include "rollout/state_spread.hpp"
#include "tiller/config.hpp"
#include "tree_problem.hpp"

namespace tiller_test {
namespace {

using Motion = std::vector<std::array<double, 2>>;

constexpr double kMostSpeed = 1.5, kLeastSpeed = -0.2, kMostChange = 1.5, kBox = 5.0;

tiller::Config sqp_tree_config(std::uint32_t masses, std::uint32_t shared) {
  tiller::Config c = tree_config(masses, shared, tiller_planner_sqp);
  c.planner.qp_iterations = 100;
  c.planner.qp_tolerance = 1e-10;  // where a multiplier is nearly zero, an input errs by the root of it
  return c;
}

void bound_speed(tiller::Config& c) {
  c.cost.hard_bounds = 2u;
  c.state_low[1] = kLeastSpeed;
  c.state_high[1] = kMostSpeed;
}

/// States 0..N of a mass.
Motion motion_of(const Tree& tree, const Inputs& u, std::uint32_t j) {
  const double h = tree.bench.config().period_s;
  double x = static_cast<double>(tree.bench.state[j]), v = static_cast<double>(tree.bench.state[tree.masses + j]);
  Motion motion = {{x, v}};
  for (std::uint32_t k = 0; k < kSteps; ++k) {
    x += h * v;
    v += h * u[tree.at(j, k)] / static_cast<double>(tree.bench.params[j]);
    motion.push_back({x, v});
  }
  return motion;
}

/// The tree's cost, with the limits of inputs and changes and the bounds on states of its configuration.
DenseQp dense_of(const Tree& tree) {
  const tiller_config_t& c = tree.bench.config();
  const Quadratic cost(tree);
  const std::size_t n = tree.size();
  DenseQp q(n);
  q.gradient = cost.gradient;
  q.hessian = cost.hessian;
  const Inputs zero(n, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    Inputs row(n, 0.0);
    row[i] = 1.0;
    q.within(c.safety.input_low[0], row, c.safety.input_high[0]);
  }
  const double most = c.safety.input_rate_per_s[0] * c.period_s;
  for (std::uint32_t j = 0; j < tree.masses; ++j) {
    for (std::uint32_t k = j == 0 ? 0 : tree.shared; k < kSteps; ++k) {
      Inputs row(n, 0.0);
      row[tree.at(j, k)] = 1.0;
      if (k > 0) row[tree.at(j, k - 1)] = -1.0;
      const double before = k > 0 ? 0.0 : tree.bench.last_command[0];
      q.within(before - most, row, before + most);
    }
    const Motion still = motion_of(tree, zero, j);
    std::vector<Motion> moved;
    for (std::size_t i = 0; i < n; ++i) {
      Inputs one = zero;
      one[i] = 1.0;
      moved.push_back(motion_of(tree, one, j));
    }
    for (std::uint32_t s = 0; s < 2; ++s) {
      if (((c.cost.hard_bounds >> s) & 1u) == 0) continue;
      for (std::uint32_t k = 1; k <= kSteps; ++k) {
        Inputs row(n);
        for (std::size_t i = 0; i < n; ++i) row[i] = moved[i][k][s] - still[k][s];
        q.within(c.cost.state_low[s] - still[k][s], row, c.cost.state_high[s] - still[k][s]);
      }
    }
  }
  return q;
}

const tiller::ScenarioTree& tree_of(const Bench& bench) {
  if (bench.config().planner.kind == tiller_planner_ilqr)
    return *static_cast<const tiller::Ilqr*>(bench.planner())->tree;
  return *static_cast<const tiller::Sqp*>(bench.planner())->tree->tree;
}

/// The planned inputs of all branches; the shared periods are the first branch's, and must be every branch's.
Inputs planned(const Bench& bench, const Tree& tree) {
  const tiller::ScenarioTree& t = tree_of(bench);
  Inputs u(tree.size());
  for (std::uint32_t j = 0; j < tree.masses; ++j)
    for (std::uint32_t k = 0; k < kSteps; ++k) {
      u[tree.at(j, k)] = t.branch[j].control[k];
      if (k < tree.shared) {
        EXPECT_EQ(t.branch[j].control[k], t.branch[0].control[k]) << j << " " << k;
      }
    }
  return u;
}

double largest_difference(const Inputs& a, const Inputs& b) {
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::fabs(a[i] - b[i]));
  return worst;
}

struct Shape {
  std::uint32_t masses, shared;
  double rate_weight;
  bool rates, states;
};

class SqpTree : public ::testing::TestWithParam<Shape> {};
INSTANTIATE_TEST_SUITE_P(Shapes, SqpTree,
                         ::testing::Values(Shape{2, 1, 0.0, false, false}, Shape{3, 1, 0.0, false, true},
                                           Shape{3, 4, 0.0, false, true}, Shape{8, 1, 0.0, false, true},
                                           Shape{2, 1, 0.0, true, false}, Shape{3, 2, 0.0, true, true},
                                           Shape{2, kSteps - 1, 0.0, true, true}, Shape{3, 1, 0.05, false, true},
                                           Shape{5, 3, 0.05, true, true}, Shape{8, 2, 0.05, true, true}));

TEST_P(SqpTree, inputs_of_all_branches_are_those_of_the_dense_solution) {
  const auto [masses, shared, rate_weight, rates, states] = GetParam();
  tiller::Config c = sqp_tree_config(masses, shared);
  c.cost.input_rate_weight[0] = rate_weight;
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  if (rates) c.safety.input_rate_per_s[0] = kMostChange / c.period_s;
  if (states) bound_speed(c);
  Bench bench(c);
  spread_out(bench);
  bench.last_command[0] = 1.0;
  const Tree tree{bench, masses, shared};
  const DenseQp dense = dense_of(tree);
  const Inputs best = dense.solve();
  ASSERT_GT(dense.active(best, 1e-6), 2u) << "or the bounds say nothing";
  const tiller::PlanResult result = bench.plan_again();
  EXPECT_EQ(result.status, tiller_status_ok);
  const Inputs ours = planned(bench, tree);
  std::printf("%zu of %zu rows active: inputs to %.1e N of %.0f N, cost %.6f against %.6f, %u iterations\n",
              dense.active(best, 1e-6), dense.rows.size(), largest_difference(ours, best), kBox, result.cost,
              tree.mean_cost(best), result.iterations);
  EXPECT_LE(largest_difference(ours, best), 1e-6 * kBox);
  EXPECT_NEAR(bench.command[0], best[0], 1e-6 * kBox);
  EXPECT_NEAR(result.cost, tree.mean_cost(best), 1e-7 * (1.0 + tree.mean_cost(best)));
}

TEST(SqpTree, is_the_tree_of_ilqr_where_no_limit_is_in_the_way) {
  for (const double rate_weight : {0.0, 0.05}) {
    tiller::Config c = sqp_tree_config(5, 2);
    c.cost.input_rate_weight[0] = rate_weight;
    tiller::Config other = c;
    other.planner.kind = tiller_planner_ilqr;
    Bench bench(c), ilqr(other);
    spread_out(bench);
    spread_out(ilqr);
    const double cost = bench.plan_again().cost;
    EXPECT_NEAR(cost, ilqr.plan_again().cost, 1e-11 * cost);
    const Inputs ours = planned(bench, {bench, 5, 2}), theirs = planned(ilqr, {ilqr, 5, 2});
    double largest = 0.0;
    for (const double u : theirs) largest = std::max(largest, std::fabs(u));
    std::printf("largest difference %.1e of %.1f N\n", largest_difference(ours, theirs), largest);
    EXPECT_LE(largest_difference(ours, theirs), 1e-10 * largest);
  }
}

TEST(SqpTree, of_one_hypothesis_or_of_shared_steps_alone_is_one_sequence) {
  for (const bool alone : {true, false}) {
    tiller::Config c = sqp_tree_config(alone ? 1 : 3, alone ? 1 : kSteps);
    bound_speed(c);
    tiller::Config one = c;
    one.planner.closed_loop = 0;
    Bench tree(c), sequence(one);
    spread_out(tree);
    spread_out(sequence);
    for (int tick = 0; tick < 3; ++tick) {
      tree.plan();
      sequence.plan();
      EXPECT_EQ(tree.command[0], sequence.command[0]);
    }
    EXPECT_EQ(tree.bytes(), sequence.bytes());
  }
}

/// A belief with fewer hypotheses than there is room for.
TEST(SqpTree, under_one_hypothesis_of_many_is_the_plan_for_it) {
  tiller::Config c = sqp_tree_config(4, 2);
  bound_speed(c);
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  tiller::Config one = c;
  one.planner.particles = 1;
  Bench tree(c), sequence(one);
  spread_out(sequence);
  tree.belief = sequence.belief;
  const double cost = sequence.plan_again().cost;
  const tiller::PlanResult result = tree.plan_again();
  EXPECT_EQ(result.status, tiller_status_ok);
  EXPECT_NEAR(result.cost, cost, 1e-7 * cost);
  for (std::uint32_t k = 0; k < kSteps; ++k)
    EXPECT_NEAR(static_cast<double>(tree.sequence()[k]), static_cast<double>(sequence.sequence()[k]), 1e-5 * kBox);
}

/// One sequence has to serve masses on both sides of the target; a tree serves each once it knows which it has.
TEST(SqpTree, costs_less_than_one_sequence) {
  for (const std::uint32_t risk : {tiller_risk_mean, tiller_risk_worst}) {
    tiller::Config c = sqp_tree_config(4, 1);
    c.planner.risk = risk;
    c.planner.iterations = 60;
    c.cost.input_weight[0] = 1e-4;
    c.safety.input_low[0] = -30.0;
    c.safety.input_high[0] = 30.0;
    c.cost.hard_bounds = 2u;
    c.state_low[1] = -0.8;
    c.state_high[1] = 0.8;
    tiller::Config one = c;
    one.planner.closed_loop = 0;
    Bench tree(c), sequence(one);
    for (Bench* bench : {&tree, &sequence})
      for (std::uint32_t j = 0; j < 4; ++j) {
        bench->params[j] = 0.5f + 0.2f * static_cast<float>(j);
        bench->state[j] = j % 2 == 0 ? 0.15f : -0.15f;
      }
    const double in_tree = tree.plan_again().cost, in_sequence = sequence.plan_again().cost;
    std::printf("risk %u: %.3f as a tree, %.3f as one sequence\n", risk, in_tree, in_sequence);
    EXPECT_LT(in_tree, 0.9 * in_sequence);
    for (std::uint32_t j = 0; j < 4; ++j)
      for (const auto& x : motion_of({tree, 4, 1}, planned(tree, {tree, 4, 1}), j))
        EXPECT_LE(std::fabs(x[1]), 0.8 + 1e-6);
  }
}

/// The worst case has all of the weight; the light mass near its bound has none. The trunk that pushes the far mass
/// must still leave the light one room to brake.
TEST(SqpTree, leaves_hypotheses_without_weight_a_way_within_their_bounds) {
  constexpr std::uint32_t kShared = 4;
  tiller::Config c = sqp_tree_config(2, kShared);
  c.planner.risk = tiller_risk_worst;
  c.planner.iterations = 40;
  c.safety.input_low[0] = -5.0;
  c.safety.input_high[0] = 5.0;
  const auto farthest = [&](bool bounded) {
    tiller::Config d = c;
    d.cost.hard_bounds = bounded ? 1u : 0u;
    d.state_high[0] = 0.17;
    Bench bench(d);
    bench.params = {1.0f, 0.25f};
    bench.state = {-3.0f, 0.1f, 0.0f, 0.0f};
    bench.belief.params = bench.params.data();
    bench.belief.state = bench.state.data();
    EXPECT_EQ(bench.plan_again().status, tiller_status_ok);
    const Tree tree{bench, 2, kShared};
    const Inputs u = planned(bench, tree);
    double most = 0.0;
    for (const auto& x : motion_of(tree, u, 1)) most = std::max(most, x[0]);
    std::printf("%s: pushed by %.3f N first, as far as %.4f m\n", bounded ? "bounded" : "free", u[0], most);
    return most;
  };
  EXPECT_GT(farthest(false), 0.2) << "or nothing is in the way";
  EXPECT_LE(farthest(true), 0.17 + 1e-5);
}

TEST(SqpTree, goes_on_from_the_plan_before) {
  tiller::Config c = sqp_tree_config(4, 2);
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  c.safety.input_rate_per_s[0] = kMostChange / c.period_s;
  bound_speed(c);
  Bench kept(c);
  spread_out(kept);
  for (int tick = 0; tick < 8; ++tick) {
    kept.request.deadline.iterations = 20;
    const tiller::PlanResult first = kept.plan();
    ASSERT_EQ(first.status, tiller_status_ok) << tick;
    Bench fresh(c);
    fresh.params = kept.params;
    fresh.state = kept.state;
    fresh.belief.params = fresh.params.data();
    fresh.belief.state = fresh.state.data();
    std::copy(kept.last_command, kept.last_command + 1, fresh.last_command);
    const tiller::PlanResult anew = fresh.plan_again(), again = kept.plan();
    EXPECT_NEAR(again.cost, anew.cost, 1e-6 * (1.0 + anew.cost)) << tick;
  }
}

TEST(SqpTree, is_the_same_to_the_bit_from_a_reset) {
  tiller::Config c = sqp_tree_config(3, 2);
  c.planner.iterations = 2;
  c.planner.risk = tiller_risk_cvar;
  c.planner.cvar_alpha = 0.5;
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  c.safety.input_rate_per_s[0] = kMostChange / c.period_s;
  bound_speed(c);
  Bench bench(c), other(c);
  const auto ride = [](Bench& b) {
    std::vector<double> commands;
    spread_out(b);
    b.request.tick = 0;
    b.last_command[0] = 0.0;
    for (int tick = 0; tick < 6; ++tick) {
      b.state[1] += 0.01f;
      b.plan();
      commands.push_back(b.command[0]);
    }
    return commands;
  };
  const std::vector<double> once = ride(bench);
  EXPECT_EQ(ride(other), once);
  bench.reset();
  EXPECT_EQ(ride(bench), once);
}

TEST(SqpTree, says_when_bounds_cannot_be_kept_and_when_a_program_runs_into_its_cap) {
  tiller::Config c = sqp_tree_config(3, 1);
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;
  bound_speed(c);
  Bench fast(c);
  spread_out(fast);
  fast.state[3 + 2] = 2.0f;  // beyond its bound, and 3 N brake 1.3 kg by 0.05 m/s a period
  EXPECT_EQ(fast.plan().status, tiller_status_bounds_relaxed);
  c.planner.qp_iterations = 2;
  c.safety.input_rate_per_s[0] = 1.0 / c.period_s;
  Bench hurried(c);
  spread_out(hurried);
  EXPECT_EQ(hurried.plan().status, tiller_status_program_unsolved);
  EXPECT_LE(std::fabs(hurried.command[0]), 1.0 + 1e-12);
}

TEST(SqpTree, survives_bad_hypotheses_and_fewer_of_them) {
  tiller::Config c = sqp_tree_config(4, 1);
  c.safety.input_rate_per_s[0] = kMostChange / c.period_s;
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  bound_speed(c);
  Bench bench(c);
  spread_out(bench);
  survives_bad_hypotheses(bench);
}

TEST(SqpTree, feedback_answers_the_deviation) {
  tiller::Config c = sqp_tree_config(3, 2);
  bound_speed(c);  // whose gains come from another sweep than the solution
  Bench bench(c);
  spread_out(bench);
  bench.plan_again();
  const tiller::PlannerTable& table = *tiller::find_planner(tiller_planner_sqp);
  for (std::uint32_t k = 0; k < kSteps; ++k) {
    double gain[2], state[2], input;
    ASSERT_TRUE(table.feedback(bench.planner(), k, gain, state, &input)) << k;
    if (k + 1 < kSteps) {
      EXPECT_LT(gain[0], 0.0) << k;
    }
    EXPECT_NEAR(input, static_cast<double>(bench.sequence()[k]), 1e-5 * (1.0 + std::fabs(input)));
  }
  EXPECT_FALSE(table.feedback(bench.planner(), kSteps, nullptr, nullptr, nullptr));
}

/// Where no bound is active the gain of the first input is what a new plan would answer.
TEST(SqpTree, feedback_of_the_trunk_is_the_answer_of_a_plan_made_anew) {
  tiller::Config c = sqp_tree_config(3, 2);
  bound_speed(c);
  c.cost.state_high = nullptr;
  c.cost.state_low = nullptr;
  c.cost.bound_weight = nullptr;
  c.safety.input_low[0] = -1e5;
  c.safety.input_high[0] = 1e5;
  for (int i = 0; i < 2; ++i) {
    Bench here(c), there(c);
    spread_out(here);
    spread_out(there);
    for (std::uint32_t j = 0; j < 3; ++j) there.state[i * 3 + j] += 0.125f;
    here.plan_again();
    there.plan_again();
    double gain[2], state[2], input;
    ASSERT_TRUE(tiller::find_planner(tiller_planner_sqp)->feedback(here.planner(), 0, gain, state, &input));
    EXPECT_NEAR((there.command[0] - here.command[0]) / 0.125, gain[i], 1e-3 * std::fabs(gain[i])) << i;
  }
}

/// Bounds stand back by what the state of a branch will spread by, and no further.
TEST(SqpTree, keeps_margins_in_every_branch) {
  tiller::Config c = sqp_tree_config(3, 2);
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  bound_speed(c);
  tiller::Config risky = c;
  risky.cost.bound_risk = 0.05;
  Bench means(c), bench(risky);
  tiller::StateSpread spread;
  spread.states = 2;
  spread.process[0] = 1e-8;
  spread.process[3] = 1e-4;
  spread.sensor_variance[0] = spread.sensor_variance[1] = 1e-4;
  bench.belief.spread = &spread;
  for (Bench* b : {&means, &bench}) {
    spread_out(*b);
    EXPECT_EQ(b->plan_again().status, tiller_status_ok);
  }
  const auto slowest = [&](const Bench& b, std::uint32_t j) {
    double least = 0.0;
    for (const auto& x : motion_of({b, 3, 2}, planned(b, {b, 3, 2}), j)) least = std::min(least, x[1]);
    return least;
  };
  for (std::uint32_t j = 0; j < 2; ++j) {  // the last one does not come to its bound
    std::printf("mass %u: as fast as %.4f m/s, with margins %.4f\n", j, slowest(means, j), slowest(bench, j));
    EXPECT_NEAR(slowest(means, j), kLeastSpeed, 1e-6);
    // a hundredth and a half of a metre per second: 1.6 deviations of a period's 1e-2 and more
    EXPECT_GE(slowest(bench, j), kLeastSpeed + 0.015);
    EXPECT_LE(slowest(bench, j), kLeastSpeed + 0.2);
  }
}

/// The same of a force that is not known.
TEST(SqpTree, counts_the_force_in_every_branch) {
  tiller::Config c = sqp_tree_config(3, 2);
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  bound_speed(c);
  c.cost.bound_risk = 0.05;
  tiller::StateSpread still;
  still.states = 2;
  still.process[0] = 1e-8;
  still.process[3] = 1e-4;
  still.sensor_variance[0] = still.sensor_variance[1] = 1e-4;
  tiller::StateSpread pushed = still;
  pushed.forces = 1;
  pushed.force_kept = 0.9;
  pushed.force_sd[0] = 0.4;
  pushed.force_size[0] = 0.6;
  double slowest[2][2];
  for (const bool counted : {false, true}) {
    Bench b(c, nullptr, tiller::select_rollout(double_integrator), true);
    b.belief.spread = counted ? &pushed : &still;
    spread_out(b);
    EXPECT_EQ(b.plan_again().status, tiller_status_ok);
    for (std::uint32_t j = 0; j < 2; ++j) {
      double& least = slowest[counted ? 1 : 0][j] = 0.0;
      for (const auto& x : motion_of({b, 3, 2}, planned(b, {b, 3, 2}), j)) least = std::min(least, x[1]);
    }
  }
  for (std::uint32_t j = 0; j < 2; ++j) {
    std::printf("mass %u: as fast as %.4f m/s, with the force counted %.4f\n", j, slowest[0][j], slowest[1][j]);
    EXPECT_GE(slowest[1][j], slowest[0][j] + 0.01);
    EXPECT_LE(slowest[1][j], slowest[0][j] + 0.3);
  }
}

// The clock counts how often it is read (deadline_test.cpp).
TEST(SqpTree, stops_at_the_deadline) {
  static std::int64_t reads = 0;
  tiller_hooks_t hooks{};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  hooks.now_ns = [](void*) { return ++reads; };
  tiller::Config c = sqp_tree_config(3, 2);
  c.safety.input_low[0] = -kBox;
  c.safety.input_high[0] = kBox;
  c.safety.input_rate_per_s[0] = kMostChange / c.period_s;
  bound_speed(c);
  Bench bench(c, &hooks);
  spread_out(bench);
  int cut = 0;
  for (std::int64_t deadline = 1; deadline < 40; ++deadline) {
    reads = 0;
    bench.state[1] = 0.7f + 0.02f * static_cast<float>(deadline % 7);
    bench.request.deadline.iterations = 20;
    bench.request.deadline.deadline_ns = deadline;
    const double last = bench.last_command[0];
    const tiller::PlanResult result = bench.plan();
    EXPECT_LE(reads - deadline, 2) << "one look ends a program's iterations, the next the plan's";
    EXPECT_LE(std::fabs(bench.command[0] - last), kMostChange * (1.0 + 1e-9));
    EXPECT_LE(std::fabs(bench.command[0]), kBox);
    cut += result.status == tiller_status_iteration_capped;
  }
  EXPECT_GT(cut, 10);
  bench.request.deadline = {};
  bench.request.deadline.iterations = 0;
  const double last = bench.last_command[0];
  bench.plan();
  EXPECT_LE(std::fabs(bench.command[0] - last), kMostChange * (1.0 + 1e-9));
}

}  // namespace
}  // namespace tiller_test
