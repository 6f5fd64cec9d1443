// The planner `policy`: what it reads, what it gives, and when its fallback plans. The references are written out here.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "lander.h"
#include "problem.hpp"
#include "rollout/rollout.hpp"

namespace tiller_test {
namespace {

constexpr std::uint32_t kPolicy = tiller_planner_policy;

/// A linear policy: bias, then a weight for each input, row by row.
struct Linear {
  Linear(std::uint32_t reads, std::vector<float> weights, std::uint32_t outputs = 1) : held(std::move(weights)) {
    const auto count = static_cast<std::uint32_t>(held.size());
    network = {sizeof network,
               TILLER_CONFIG_VERSION,
               tiller_network_tanh,
               count / outputs - 1,
               outputs,
               1,
               {0, 0},
               held.data(),
               count,
               0};
    policy = {sizeof policy, TILLER_CONFIG_VERSION, reads, tiller_policy_cut, &network, nullptr, nullptr};
  }
  Linear(const Linear&) = delete;
  std::vector<float> held;
  tiller_network_t network;
  tiller_policy_t policy;
};

tiller::Config policy_config(const Linear& linear) {
  tiller::Config c = line_config(kPolicy);
  c.priors[0] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.5, 2.0};
  c.planner.fallback = tiller_planner_policy;
  c.policy = &linear.policy;
  return c;
}

TEST(Policy, gives_what_its_network_says_between_the_limits) {
  const Linear linear(tiller_policy_state, {0.1f, -0.5f, 0.25f});
  tiller::Config c = policy_config(linear);
  c.safety.input_low[0] = -2.0;
  c.safety.input_high[0] = 6.0;
  Bench bench(c);
  for (const double x : {-3.0, -0.5, 0.0, 0.7, 4.0}) {
    bench.set_state({x, 0.5});
    const double share = 0.1 - 0.5 * x + 0.125;
    EXPECT_EQ(bench.plan().status, tiller_status_ok);
    EXPECT_NEAR(bench.command[0], 2.0 + 4.0 * std::clamp(share, -1.0, 1.0), 1e-6) << x;
    for (std::uint32_t t = 0; t < c.planner.horizon; ++t)
      EXPECT_FLOAT_EQ(bench.sequence()[t], static_cast<float>(bench.command[0]));
  }
}

TEST(Policy, squashes_by_sines_as_pilco_does) {
  Linear linear(tiller_policy_state, {0.0f, 1.0f, 0.0f});
  linear.policy.squash = tiller_policy_sine;
  Bench bench(policy_config(linear));
  for (const double x : {-2.0, -1.0, 0.3, 1.5}) {
    bench.set_state({x, 0.0});
    bench.plan();
    EXPECT_NEAR(bench.command[0], 5.0 * (9.0 * std::sin(x) + std::sin(3.0 * x)) / 8.0, 1e-5) << x;
  }
}

TEST(Policy, reads_goal_moments_and_last_command_in_that_order) {
  // each input's weight tells it from the others
  const Linear linear(
      tiller_policy_goal | tiller_policy_belief_mean | tiller_policy_belief_spread | tiller_policy_last_command,
      {0.0f, 1e-3f, 1e-2f, 1e-1f, 0.2f, 0.05f});
  tiller::Config c = policy_config(linear);
  c.planner.particles = 2;
  c.cost.target[0] = 0.5;
  Bench bench(c);
  bench.set_state({1.0, -2.0});
  bench.params[0] = 0.8f;
  bench.params[1] = 1.2f;
  bench.last_command[0] = 3.0;
  bench.plan_again();  // no moments in the request: those of the two hypotheses
  EXPECT_NEAR(bench.command[0], 5.0 * (1e-3 * 0.5 - 1e-2 * 2.0 + 0.1 * 1.0 + 0.2 * 0.2 + 0.05 * 3.0), 1e-6);
  const double mean = 1.5, sd = 0.1;
  bench.request.param_mean = &mean;
  bench.request.param_sd = &sd;
  bench.plan_again();
  EXPECT_NEAR(bench.command[0], 5.0 * (1e-3 * 0.5 - 1e-2 * 2.0 + 0.1 * mean + 0.2 * sd + 0.05 * 3.0), 1e-6);
}

TEST(Policy, weighs_hypotheses) {
  const Linear linear(tiller_policy_state | tiller_policy_belief_mean | tiller_policy_belief_spread,
                      {0.0f, 0.1f, 0.0f, 0.3f, 0.2f});
  tiller::Config c = policy_config(linear);
  c.planner.particles = 3;
  Bench bench(c);
  const float weight[3] = {0.5f, 0.25f, 0.25f}, mass[3] = {0.6f, 1.0f, 1.8f}, x[3] = {0.1f, 0.3f, 0.7f};
  std::copy(mass, mass + 3, bench.params.begin());
  std::copy(x, x + 3, bench.state.begin());
  bench.belief.weight = weight;
  bench.plan();
  const double mean = 0.5 * 0.6 + 0.25 * 1.0 + 0.25 * 1.8;
  const double variance =
      0.5 * std::pow(0.6 - mean, 2) + 0.25 * std::pow(1.0 - mean, 2) + 0.25 * std::pow(1.8 - mean, 2);
  EXPECT_NEAR(bench.command[0], 5.0 * (0.1 * 0.3 + 0.3 * mean + 0.2 * std::sqrt(variance)), 1e-5);
}

TEST(Policy, follows_the_references_row) {
  const Linear linear(tiller_policy_goal, {0.0f, 0.5f, 0.0f});
  tiller::Config c = policy_config(linear);
  const double rows[] = {0.0, 0.0, 1.0, 0.0, 2.0, 0.0};
  c.cost.reference = rows;
  c.cost.reference_steps = 3;
  Bench bench(c);
  bench.set_state({1.0, 0.0});
  for (const std::uint64_t step : {0u, 1u, 2u, 9u}) {
    bench.request.task_step = step;
    bench.plan();
    EXPECT_NEAR(bench.command[0], 2.5 * (1.0 - rows[2 * std::min<std::uint64_t>(step, 2)]), 1e-6) << step;
  }
}

/// Whoever plans under these circumstances, against the fallback alone in the same place.
struct Beside {
  explicit Beside(const tiller::Config& c) : policy(c), alone(fallback_of(c)) {}
  static tiller::Config fallback_of(tiller::Config c) {
    c.planner.kind = c.planner.fallback;
    return c;
  }
  bool falls_back() {
    alone.plan();
    policy.plan();
    return policy.command[0] == alone.command[0] &&
           std::equal(policy.sequence(), policy.sequence() + policy.config().planner.horizon, alone.sequence());
  }
  void place(double x, double v) {
    policy.set_state({x, v});
    alone.set_state({x, v});
  }
  Bench policy, alone;
};

struct Watched : Linear {
  Watched() : Linear(tiller_policy_state, {0.0f, -0.1f, 0.0f}) {
    policy.input_low = low;
    policy.input_high = high;
  }
  const float low[2] = {-1.0f, -1.0f}, high[2] = {1.0f, 1.0f};
};

TEST(Policy, falls_back_where_it_was_not_trained) {
  const Watched watched;
  tiller::Config c = policy_config(watched);
  c.planner.fallback = tiller_planner_ilqr;
  for (const auto& [x, knows] : {std::pair{0.9, true}, {1.19, true}, {1.21, false}, {-1.21, false}}) {
    Beside b(c);
    b.place(x, 0.0);
    EXPECT_EQ(b.falls_back(), !knows) << x;
  }
  c.planner.fallback = tiller_planner_policy;
  Bench none(c);
  none.set_state({3.0, 0.0});
  EXPECT_EQ(none.plan().status, tiller_status_ok) << "nobody else is there";
  EXPECT_NEAR(none.command[0], -1.5, 1e-6);
}

TEST(Policy, falls_back_from_a_doubted_model_and_from_no_number) {
  const Watched watched;
  tiller::Config c = policy_config(watched);
  c.planner.fallback = tiller_planner_ilqr;
  Beside doubted(c);
  doubted.place(0.5, 0.0);
  EXPECT_FALSE(doubted.falls_back());
  doubted.policy.request.doubted = true;
  Beside fresh(c);  // whose fallback has not planned at the tick before, either
  fresh.place(0.5, 0.0);
  fresh.policy.request.doubted = true;
  EXPECT_TRUE(fresh.falls_back());
  Linear endless(tiller_policy_state, {1e9f, 1e9f, 0.0f});
  endless.network.hidden[0] = 0;
  tiller::Config d = policy_config(endless);
  Bench bench(d);
  bench.set_state({std::nan(""), 0.0});
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
  EXPECT_EQ(bench.command[0], 0.0) << "the safe command";
  bench.request.belief = nullptr;
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
}

TEST(Policy, a_fallback_begins_anew_after_a_pause_and_goes_on_otherwise) {
  const Watched watched;
  tiller::Config c = policy_config(watched);
  c.planner.fallback = tiller_planner_ilqr;
  Beside b(c);
  for (int i = 0; i < 4; ++i) {
    b.place(3.0, 0.1 * i);
    EXPECT_TRUE(b.falls_back()) << "its warm start is the last tick's, " << i;
  }
  b.policy.set_state({0.1, 0.0});  // one tick by the policy
  b.policy.plan();
  b.alone.reset();
  b.alone.request.tick = b.policy.request.tick;
  b.alone.last_command[0] = b.policy.last_command[0];
  b.place(3.0, 0.0);
  EXPECT_TRUE(b.falls_back());
}

TEST(Policy, a_fallback_begins_anew_where_ticks_are_missing) {
  const Watched watched;
  tiller::Config c = policy_config(watched);
  c.planner.fallback = tiller_planner_ilqr;
  c.planner.iterations = 2;
  Beside b(c);
  b.place(3.0, 0.0);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(b.falls_back()) << i;
  b.policy.request.tick += 5;
  b.alone.reset();
  b.alone.request.tick = b.policy.request.tick;
  EXPECT_TRUE(b.falls_back()) << "as a planner that has not planned yet";
  b.policy.reset();
  b.alone.reset();
  EXPECT_TRUE(b.falls_back());
}

/// A replay stops a planner by count where its clock stopped it: one that always does all of its iterations does not
/// notice, so the policy says it.
TEST(Policy, says_that_its_fallback_was_cut_short) {
  const Watched watched;
  for (const std::uint32_t fallback : {tiller_planner_cem, tiller_planner_ilqr}) {
    tiller::Config c = policy_config(watched);
    c.planner.fallback = fallback;
    c.planner.iterations = 3;
    Bench bench(c);
    bench.set_state({3.0, 0.0});
    EXPECT_EQ(bench.plan().status, tiller_status_ok) << fallback;
    bench.request.deadline.iterations = 1;
    bench.reset();
    EXPECT_EQ(bench.plan().status, tiller_status_iteration_capped) << fallback;
    bench.params[0] = std::nanf("");
    EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite) << "the worse of the two, " << fallback;
  }
}

TEST(Policy, reads_whole_turns_and_leaves_out_what_is_known) {
  const Linear linear(tiller_policy_state | tiller_policy_belief_mean | tiller_policy_belief_spread,
                      {0.0f, 0.1f, 0.0f});
  tiller::Config c = policy_config(linear);
  c.priors[0].kind = tiller_prior_fixed;  // a parameter that nobody asks about: no input of the network
  Bench bench(c);
  bench.set_state({1.0, 0.0});
  const double origin[2] = {2.0, 0.0};
  bench.plan_again();
  EXPECT_NEAR(bench.command[0], 0.5, 1e-6);
  bench.request.origin = origin;
  bench.plan_again();
  EXPECT_NEAR(bench.command[0], 1.5, 1e-6) << "the belief's angles come less the origin";
}

TEST(Policy, a_belief_without_hypotheses_is_none) {
  const Linear linear(tiller_policy_state, {0.5f, 0.0f, 0.0f});
  tiller::Config c = policy_config(linear);
  c.safety.safe_command[0] = -1.0;
  Bench bench(c);
  bench.belief.count = 0;
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
  EXPECT_EQ(bench.command[0], -1.0) << "the safe command";
  bench.reset();
  bench.belief.count = 1;
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
}

TEST(Policy, keeps_limits_and_rates_whatever_it_is_told) {
  std::mt19937_64 random(7);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1p-53);
  };
  const double kNan = std::nan(""), kInfinity = std::numeric_limits<double>::infinity();
  int at_limit = 0, at_rate = 0, no_number = 0;
  constexpr int kTrials = 3000;
  for (int i = 0; i < kTrials; ++i) {
    const Linear linear(tiller_policy_state, {static_cast<float>(uniform(-1, 1)), static_cast<float>(uniform(-2, 2)),
                                              static_cast<float>(uniform(-2, 2))});
    tiller::Config c = policy_config(linear);
    const double a = uniform(-20, 20), b = uniform(-20, 20);
    c.safety.input_low[0] = c.safety.safe_command[0] = std::min(a, b);
    c.safety.input_high[0] = std::max(a, b);
    c.safety.input_rate_per_s[0] = random() % 3 == 0 ? kInfinity : uniform(0, 300);
    Bench bench(c);
    bench.set_state({random() % 16 == 0 ? kNan : uniform(-3, 3), uniform(-3, 3)});
    bench.last_command[0] = random() % 8 == 0 ? kNan : uniform(-30, 30);
    const double from = std::clamp(bench.last_command[0], c.safety.input_low[0], c.safety.input_high[0]);
    const bool given = !std::isnan(bench.last_command[0]);
    no_number += bench.plan().status == tiller_status_plan_not_finite;
    const double u = bench.command[0];
    ASSERT_GE(u, c.safety.input_low[0]) << i;
    ASSERT_LE(u, c.safety.input_high[0]) << i;
    const double moved = given ? std::fabs(u - from) : 0.0;
    ASSERT_LE(moved, c.safety.input_rate_per_s[0] * c.period_s * (1 + 1e-12)) << i;
    at_limit += u == c.safety.input_low[0] || u == c.safety.input_high[0];
    at_rate += given && std::fabs(u - from) >= 0.999 * c.safety.input_rate_per_s[0] * c.period_s;
  }
  EXPECT_GT(at_limit, kTrials / 100);
  EXPECT_GT(at_rate, kTrials / 100);
  EXPECT_GT(no_number, kTrials / 100);
}

TEST(Policy, keeps_cones) {
  const Linear linear(tiller_policy_state,
                      {0.0f, 1.0f, 0, 0, 0, 0, 0, 0.0f, 0, 1.0f, 0, 0, 0, 0, 0.5f, 0, 0, 0, 0, 0, 0}, 3);
  tiller::Config c = policy_config(linear);
  c.model = &lander;
  c.safety.cone_count = 1;
  c.cones[0] = {0b011, 0, 0.0, 2.0};
  Bench bench(c, nullptr, tiller::select_rollout(lander));
  const tiller::InputCones cones = tiller::make_input_cones(c.safety.cones, 1);
  int on_cone = 0;
  for (int i = 0; i < 40; ++i) {
    bench.set_state({std::sin(i), std::cos(0.7 * i), 0, 0, 0, 0});
    bench.plan();
    ASSERT_TRUE(tiller::within_cones(cones, bench.command)) << i;
    on_cone += tiller::cone_norm(cones.cone[0], bench.command) > 0.999 * 2.0;
  }
  EXPECT_GT(on_cone, 20);
}

}  // namespace
}  // namespace tiller_test
