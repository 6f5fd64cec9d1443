// Closed-loop plans of the sampling planners: the cost they report and the feedback they give out, against a
// brute-force simulation in double and a Riccati recursion written out here.

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "planner_matrix.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

constexpr std::uint32_t kSampling[] = {tiller_planner_random_shooting, tiller_planner_cem, tiller_planner_mppi};

class ClosedLoop : public ::testing::TestWithParam<std::uint32_t> {};
INSTANTIATE_TEST_SUITE_P(Sampling, ClosedLoop, ::testing::ValuesIn(kSampling),
                         [](const auto& planner) { return std::string(tiller::find_planner(planner.param)->name); });

/// Five masses that move apart: what one sequence cannot hold together.
tiller::Config five_masses(std::uint32_t planner) {
  tiller::Config c = line_config(planner);
  c.planner.particles = 5;
  c.planner.horizon = 40;
  c.planner.iterations = 3;
  c.planner.closed_loop = 1;
  c.cost.input_weight[0] = 0.02;
  return c;
}

void spread_out(Bench& bench) {
  for (std::uint32_t m = 0; m < 5; ++m) {
    bench.params[m] = 0.6f + 0.25f * static_cast<float>(m);
    bench.state[m] = 1.0f + 0.1f * static_cast<float>(m);
    bench.state[5 + m] = -0.4f + 0.2f * static_cast<float>(m);
  }
}

struct Feedback {
  double gain[2], state[2], input;
};

Feedback feedback_of(const Bench& bench, std::uint32_t step) {
  Feedback f{};
  const tiller::PlannerTable& table = *tiller::find_planner(bench.config().planner.kind);
  EXPECT_TRUE(table.feedback(bench.planner(), step, f.gain, f.state, &f.input)) << step;
  return f;
}

/// Cost of mass `m` that follows the plan: open loop, or with the plan's feedback from step `from` on.
double cost_of(const Bench& bench, std::uint32_t m, std::uint32_t from, bool answers) {
  const tiller_config_t& c = bench.config();
  double x = static_cast<double>(bench.state[m]), v = static_cast<double>(bench.state[5 + m]), cost = 0.0, last = 0.0;
  for (std::uint32_t k = 0; k < c.planner.horizon; ++k) {
    const Feedback f = feedback_of(bench, k);
    double u = f.input;
    if (answers && k >= from) {
      const double step = c.safety.input_rate_per_s[0] * c.period_s;
      u += f.gain[0] * (x - f.state[0]) + f.gain[1] * (v - f.state[1]);
      u = std::min(std::max(u, std::max(c.safety.input_low[0], last - step)),
                   std::min(c.safety.input_high[0], last + step));
    }
    last = u;
    cost += c.cost.state_weight[0] * x * x + c.cost.state_weight[1] * v * v + c.cost.input_weight[0] * u * u;
    x += c.period_s * v;
    v += c.period_s * u / static_cast<double>(bench.params[m]);
  }
  return cost + c.cost.terminal_weight[0] * x * x + c.cost.terminal_weight[1] * v * v;
}

double mean_cost(const Bench& bench, std::uint32_t from, bool answers) {
  double sum = 0.0;
  for (std::uint32_t m = 0; m < 5; ++m) sum += cost_of(bench, m, from, answers) / 5.0;
  return sum;
}

TEST_P(ClosedLoop, the_reported_cost_is_that_of_masses_that_answer) {
  for (const std::uint32_t shared : {1u, 4u, 40u})
    for (const double rate_per_s : {std::numeric_limits<double>::infinity(), 60.0}) {
      tiller::Config c = five_masses(GetParam());
      c.planner.shared_steps = shared;
      c.safety.input_rate_per_s[0] = rate_per_s;
      Bench bench(c);
      spread_out(bench);
      const tiller::PlanResult result = bench.plan_again();
      ASSERT_EQ(result.status, tiller_status_ok);
      const double cost = mean_cost(bench, shared, true);
      EXPECT_NEAR(result.cost, cost, 1e-4 * cost) << shared << " shared, " << rate_per_s;
      // the answers are worth something, and none are given where all steps are shared
      const double open = mean_cost(bench, shared, false);
      if (shared < 40)
        EXPECT_LT(cost, 0.98 * open) << shared;
      else
        EXPECT_EQ(cost, open);
    }
}

// With all steps shared the plan is the open-loop one: same samples, same costs, same choice.
TEST_P(ClosedLoop, with_every_step_shared_it_is_the_open_loop_plan) {
  tiller::Config c = five_masses(GetParam());
  c.planner.shared_steps = 512;
  tiller::Config open = c;
  open.planner.closed_loop = 0;
  Bench a(c), b(open);
  spread_out(a);
  spread_out(b);
  for (int tick = 0; tick < 5; ++tick) {
    a.plan();
    b.plan();
    EXPECT_EQ(a.command[0], b.command[0]) << tick;
  }
}

// One hypothesis alone has nothing to answer.
TEST_P(ClosedLoop, of_one_particle_is_the_open_loop_plan) {
  tiller::Config c = five_masses(GetParam());
  c.planner.particles = 1;
  tiller::Config open = c;
  open.planner.closed_loop = 0;
  Bench a(c), b(open);
  a.set_state({1.0, 0.3});
  b.set_state({1.0, 0.3});
  for (int tick = 0; tick < 5; ++tick) {
    a.plan();
    b.plan();
    EXPECT_EQ(a.command[0], b.command[0]) << tick;
  }
}

// The mean mass is a linear system: its gains are those of a Riccati recursion, whatever the plan.
TEST_P(ClosedLoop, gains_are_those_of_the_riccati_recursion) {
  const tiller::Config c = five_masses(GetParam());
  Bench bench(c);
  spread_out(bench);
  bench.plan_again();
  const double h = c.period_s, b = h / 1.1;  // the mean mass is 1.1 kg
  double p[2][2] = {{c.cost.terminal_weight[0], 0.0}, {0.0, c.cost.terminal_weight[1]}};
  for (std::uint32_t k = c.planner.horizon; k-- > 0;) {
    // x' = x + h v, v' = v + b u; cost to go p, without its factor of two
    const double curvature = c.cost.input_weight[0] + b * b * p[1][1];
    const double carry[2] = {b * p[1][0], b * (p[1][0] * h + p[1][1])};
    const double gain[2] = {-carry[0] / curvature, -carry[1] / curvature};
    const Feedback f = feedback_of(bench, k);
    for (int i = 0; i < 2; ++i) EXPECT_NEAR(f.gain[i], gain[i], 1e-5 * (1.0 + std::fabs(gain[i]))) << k;
    const double pa[2][2] = {{p[0][0], p[0][0] * h + p[0][1]}, {p[1][0], p[1][0] * h + p[1][1]}};
    double next[2][2];
    for (int r = 0; r < 2; ++r)
      for (int s = 0; s < 2; ++s)
        next[r][s] = (r == 0 ? pa[0][s] : h * pa[0][s] + pa[1][s]) - carry[r] * carry[s] / curvature +
                     (r == s ? c.cost.state_weight[r] : 0.0);
    for (int r = 0; r < 2; ++r)
      for (int s = 0; s < 2; ++s) p[r][s] = next[r][s];
  }
}

// The reference is the mean mass's motion under the plan's inputs.
TEST_P(ClosedLoop, the_reference_is_the_mean_hypothesis_motion) {
  const tiller::Config c = five_masses(GetParam());
  Bench bench(c);
  spread_out(bench);
  bench.plan_again();
  double x = 1.2, v = 0.0;
  for (std::uint32_t k = 0; k < c.planner.horizon; ++k) {
    const Feedback f = feedback_of(bench, k);
    EXPECT_NEAR(f.state[0], x, 2e-5);
    EXPECT_NEAR(f.state[1], v, 2e-5);
    EXPECT_EQ(f.input, static_cast<double>(bench.sequence()[k]));
    x += c.period_s * v;
    v += c.period_s * f.input / 1.1;
  }
  double unused[2];
  EXPECT_FALSE(tiller::find_planner(GetParam())->feedback(bench.planner(), c.planner.horizon, unused, unused, unused));
}

TEST_P(ClosedLoop, a_hypothesis_that_is_not_a_number_leaves_the_shifted_plan) {
  Bench bench(five_masses(GetParam()));
  spread_out(bench);
  bench.plan();
  const double next = static_cast<double>(bench.sequence()[1]);
  bench.params[3] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(bench.plan_again().status, tiller_status_plan_not_finite);
  EXPECT_TRUE(std::isfinite(bench.command[0]));
  EXPECT_NEAR(bench.command[0], next, 1e-5);
  double unused[2];
  EXPECT_FALSE(tiller::find_planner(GetParam())->feedback(bench.planner(), 0, unused, unused, unused));
  bench.params[3] = 1.0f;
  EXPECT_EQ(bench.plan_again().status, tiller_status_ok);
}

}  // namespace
}  // namespace tiller_test
