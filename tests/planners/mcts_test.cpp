// The tree by itself, on problems whose answer is known, and the planner's own settings.

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "planners/mcts_tree.hpp"
#include "problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using tiller::MctsTree;

struct Tree {
  Tree(std::uint32_t nodes, std::uint32_t actions) : memory(new unsigned char[nodes * 64 + 4096]) {
    const auto at = reinterpret_cast<std::uintptr_t>(memory.get());
    tiller::Arena arena(memory.get() + (64 - at % 64) % 64, nodes * 64 + 4000);
    tree.lay_out(arena, nodes);
    EXPECT_TRUE(arena.fits());
    tree.clear(actions);
  }
  std::unique_ptr<unsigned char[]> memory;
  MctsTree tree;
};

constexpr std::uint32_t kNothing[8] = {MctsTree::kNone, MctsTree::kNone, MctsTree::kNone, MctsTree::kNone,
                                       MctsTree::kNone, MctsTree::kNone, MctsTree::kNone, MctsTree::kNone};

/// Cost of a path: the sum of what each choice lies off the wanted one, with noise like that of a default policy.
double path_cost(const std::uint32_t* choices, std::uint32_t depth, std::mt19937& random) {
  const std::uint32_t wanted[] = {2, 0, 1, 2};
  double cost = std::uniform_real_distribution<double>(0.0, 0.5)(random);
  for (std::uint32_t i = 0; i < 4; ++i) cost += i < depth ? (choices[i] == wanted[i] ? 0.0 : 1.0) : 0.5;
  return cost;
}

TEST(MctsTree, visits_the_best_path_most_and_every_choice_at_least_once) {
  Tree t(1024, 3);
  std::mt19937 random(1);
  for (int batch = 0; batch < 60; ++batch) {
    std::uint32_t leaves[8], choices[8];
    for (std::uint32_t& leaf : leaves)
      leaf = t.tree.select({4, kNothing, static_cast<std::uint32_t>(random()), {0.0, 2.0}, 0.5});
    for (const std::uint32_t leaf : leaves) {
      const std::uint32_t depth = t.tree.path(leaf, choices);
      t.tree.back_up(leaf, path_cost(choices, depth, random));
    }
    t.tree.commit();
  }
  EXPECT_EQ(t.tree.visits(MctsTree::kRoot), 480.0);
  // down the wanted path each child has most of its parent's visits
  double before = 480.0;
  for (const std::uint32_t wanted : {2u, 0u, 1u}) {
    t.tree.descend(wanted);
    EXPECT_GT(t.tree.visits(MctsTree::kRoot), 0.5 * before);
    before = t.tree.visits(MctsTree::kRoot);
  }
}

TEST(MctsTree, a_batch_spreads_out) {
  Tree t(1024, 3);
  std::set<std::uint32_t> leaves;
  for (std::uint32_t i = 0; i < 39; ++i) leaves.insert(t.tree.select({6, kNothing, i << 24, {}, 0.5}));
  EXPECT_EQ(leaves.size(), 39u);  // 3 + 9 + 27: nothing is known yet, so the tree fills level by level
}

TEST(MctsTree, cancelled_batches_leave_no_trace) {
  std::mt19937 random(3);
  Tree a(256, 4), b(256, 4);
  for (int batch = 0; batch < 20; ++batch) {
    std::uint32_t words[16], choices[8];
    for (std::uint32_t& w : words) w = static_cast<std::uint32_t>(random());
    std::uint32_t lost[16];
    for (int i = 0; i < 16; ++i)
      lost[i] = b.tree.select({5, kNothing, static_cast<std::uint32_t>(random()), {0.0, 2.0}, 1.0});
    for (const std::uint32_t leaf : lost) b.tree.cancel(leaf);
    b.tree.remove_uncommitted();
    ASSERT_EQ(a.tree.used(), b.tree.used());
    std::uint32_t leaves[16];
    for (int i = 0; i < 16; ++i) {
      leaves[i] = a.tree.select({5, kNothing, words[i], {0.0, 2.0}, 1.0});
      ASSERT_EQ(leaves[i], b.tree.select({5, kNothing, words[i], {0.0, 2.0}, 1.0})) << batch << " " << i;
    }
    for (const std::uint32_t leaf : leaves) {
      const double cost = path_cost(choices, a.tree.path(leaf, choices), random);
      a.tree.back_up(leaf, cost);
      b.tree.back_up(leaf, cost);
    }
    a.tree.commit();
    b.tree.commit();
  }
  EXPECT_EQ(a.tree.used(), 256u) << "the pool filled up, and the search went on";
}

TEST(MctsTree, descends_with_all_that_is_below_and_gives_the_rest_back) {
  Tree t(512, 3);
  std::mt19937 random(5);
  std::uint32_t choices[8];
  double below = 0.0;
  std::set<std::vector<std::uint32_t>> known;
  for (int i = 0; i < 300; ++i) {
    const std::uint32_t leaf = t.tree.select({5, kNothing, static_cast<std::uint32_t>(random()), {0.0, 2.0}, 1.0});
    const std::uint32_t depth = t.tree.path(leaf, choices);
    below += depth > 0 && choices[0] == 1;
    if (choices[0] == 1) known.insert(std::vector<std::uint32_t>(choices + 1, choices + depth));
    t.tree.back_up(leaf, path_cost(choices, depth, random));
    t.tree.commit();
  }
  t.tree.descend(1);
  EXPECT_EQ(t.tree.visits(MctsTree::kRoot), below);
  EXPECT_EQ(t.tree.used(), known.size());
  for (std::uint32_t n = 0; n < t.tree.used(); ++n) {
    const std::uint32_t depth = t.tree.path(n, choices);
    EXPECT_TRUE(known.count(std::vector<std::uint32_t>(choices, choices + depth)));
  }
  t.tree.fade(0.5);
  EXPECT_EQ(t.tree.visits(MctsTree::kRoot), 0.5 * below);
  Tree bare(16, 3);
  bare.tree.descend(2);  // a choice that was never tried
  EXPECT_EQ(bare.tree.used(), 1u);
}

TEST(Mcts, plays_no_other_values_than_its_levels) {
  tiller::Config c = line_config(tiller_planner_mcts);
  c.planner.levels = 3;
  Bench bench(c);
  bool moved = false;
  for (int t = 0; t < 100; ++t) {
    bench.set_state({std::cos(0.1 * t), std::sin(0.2 * t)});
    bench.plan();
    for (int i = 0; i < 50; ++i) {
      const float u = bench.sequence()[i];
      ASSERT_TRUE(u == -5.0f || u == 0.0f || u == 5.0f) << u;
    }
    moved = moved || bench.command[0] != 0.0;
  }
  EXPECT_TRUE(moved);
}

TEST(Mcts, holds_choices_on_the_clock) {
  tiller::Config c = line_config(tiller_planner_mcts);
  c.planner.hold_steps = 7;
  Bench bench(c);
  for (int tick = 0; tick < 40; ++tick) {
    bench.set_state({1.0, -1.0});
    bench.plan();
    for (int i = 1; i < 50; ++i)  // choices change where the clock is at a multiple of seven periods
      if ((tick + i) % 7 != 0) {
        ASSERT_EQ(bench.sequence()[i], bench.sequence()[i - 1]) << tick << " " << i;
      }
  }
}

/// The tree does better than its default policies: a pool of 16 nodes is full after three choices have been opened, and
/// every simulation then goes on at random from there. Where the plan comes to rest within the horizon, that is; far
/// from the goal, with the input at its limit for most of the time, the default policies do as well.
TEST(Mcts, is_better_for_its_tree) {
  double with = 0.0, without = 0.0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
    for (const bool tree : {true, false}) {
      tiller::Config c = line_config(tiller_planner_mcts);
      c.seed = seed;
      c.planner.rollouts = 64;
      c.planner.iterations = 16;
      c.planner.nodes = tree ? 1024 : 16;
      c.planner.levels = 5;
      Bench bench(c);
      bench.set_state({0.5, 1.0});
      bench.plan();  // the first one looks at random
      (tree ? with : without) += bench.plan().cost / 20.0;
    }
  std::printf("mean plan cost with 1024 nodes %.4f, with 16 %.4f\n", with, without);
  EXPECT_LT(with, 0.95 * without);
}

constexpr int kMasses = 4;

/// Masses that know nothing of each other, each with an input of its own: the best plan for all is the best for each.
const tiller_model_t& masses() {
  static const char* const names[] = {"a_m", "b_m", "c_m", "d_m", "a_m_s", "b_m_s", "c_m_s", "d_m_s"};
  static const char* const inputs[] = {"a_N", "b_N", "c_N", "d_N"};
  static const char* const params[] = {"mass_kg"};
  static const tiller_model_t model = [] {
    tiller_model_t m{};
    m.size = sizeof m;
    m.version = TILLER_MODEL_VERSION;
    m.name = "masses";
    m.state_count = 2 * kMasses;
    m.input_count = kMasses;
    m.param_count = 1;
    m.state_names = names;
    m.input_names = inputs;
    m.param_names = params;
    m.dynamics = [](const double* x, const double* u, const double*, const tiller_body_t*, const double* p,
                    double* dxdt) {
      for (int i = 0; i < kMasses; ++i) {
        dxdt[i] = x[kMasses + i];
        dxdt[kMasses + i] = u[i] / p[0];
      }
    };
    return m;
  }();
  return model;
}

tiller::Config masses_config(std::uint32_t nodes) {
  tiller::Config c = line_config(tiller_planner_mcts);
  c.model = &masses();
  c.planner.nodes = nodes;
  c.planner.iterations = 16;
  for (int i = 0; i < kMasses; ++i) {
    c.cost.state_weight[i] = 1.0;
    c.cost.state_weight[kMasses + i] = 0.1;
    c.cost.terminal_weight[i] = 20.0;
    c.cost.terminal_weight[kMasses + i] = 10.0;
    c.cost.input_weight[i] = 0.01;
  }
  return c;
}

const std::vector<double> kAtStart = {0.5, -0.4, 0.3, -0.2, 0.0, 0.5, -0.5, 0.2};

/// 5^4 values together are more than a node has children: a choice then sets one input, and every input keeps its five.
/// The masses are brought to rest by planning again and again.
TEST(Mcts, many_inputs_keep_their_levels_and_reach_their_targets) {
  const tiller::Config c = masses_config(4096);
  Bench bench(c);
  std::vector<double> x = kAtStart;
  std::set<float> seen[kMasses];
  for (int tick = 0; tick < 150; ++tick) {
    bench.set_state(x);
    bench.plan();
    for (int i = 0; i < kMasses; ++i) {
      for (int row = 0; row < 50; ++row) seen[i].insert(bench.sequence()[row * kMasses + i]);
      x[i] += c.period_s * x[kMasses + i];
      x[kMasses + i] += c.period_s * bench.command[i];
    }
  }
  for (const std::set<float>& input : seen) {
    EXPECT_TRUE(input.count(-2.5f) || input.count(2.5f)) << "in between, which two or three levels would lack";
    for (const float value : input)
      EXPECT_TRUE(std::set<float>({-5.0f, -2.5f, 0.0f, 2.5f, 5.0f}).count(value)) << value;
  }
  // the least change of speed is 2.5 N for 0.1 s, so a mass comes to rest within 0.25 m/s and what that travels
  for (int i = 0; i < kMasses; ++i) {
    EXPECT_LT(std::fabs(x[i]), 0.1) << i;
    EXPECT_LT(std::fabs(x[kMasses + i]), 0.3) << i;
  }
}

}  // namespace
}  // namespace tiller_test
