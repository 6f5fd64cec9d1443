// Predicted spreads against simulations of what they stand for: a Kalman filter and a feedback that run, a grid of
// integrals, and costs averaged over many draws.

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "planners/predicted_spread.hpp"
#include "problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using tiller::StateSpread;

constexpr double kStep_s = 0.1;
constexpr double kA[4] = {1.0, kStep_s, 0.35, 1.0};  // an unstable axis
constexpr double kB[2] = {0.005, 0.1};
constexpr double kGain[2] = {-8.0, -4.0};
constexpr double kRevision[1] = {0.8};  // variance of what planning again adds to the input

StateSpread axis_spread() {
  StateSpread s;
  s.states = 2;
  const double start[4] = {0.04, 0.01, 0.01, 0.09}, process[4] = {1e-3, 2e-3, 2e-3, 9e-3};
  std::copy(start, start + 4, s.covariance);
  std::copy(process, process + 4, s.process);
  s.sensor_variance[0] = 0.0025;
  s.sensor_variance[1] = HUGE_VAL;
  return s;
}

tiller::SpreadStage axis_stage(bool answers) {
  tiller::SpreadStage stage;
  stage.size = 2;
  stage.inputs = 1;
  stage.a = kA;
  stage.stride = 2;
  stage.b = kB;
  stage.gain = answers ? kGain : nullptr;
  stage.gain_stride = 2;
  stage.input_variance = answers ? kRevision : nullptr;
  return stage;
}

/// Lower factor of a 2 x 2 covariance.
struct Factor {
  double a, b, c;
  explicit Factor(const double* p) : a(std::sqrt(p[0])), b(p[1] / a), c(std::sqrt(p[3] - b * b)) {}
};

/// Second moments of the true state over `runs` simulations in which a filter estimates and the feedback answers.
std::vector<double> simulate(const StateSpread& s, bool answers, int steps, int runs) {
  std::mt19937_64 engine(1);
  std::normal_distribution<double> normal;
  const Factor start(s.covariance), process(s.process);
  std::vector<double> sum(std::size_t(steps + 1) * 3, 0.0);
  for (int run = 0; run < runs; ++run) {
    const auto draw = [&](const Factor& f, double* x) {
      const double n0 = normal(engine), n1 = normal(engine);
      x[0] += f.a * n0;
      x[1] += f.b * n0 + f.c * n1;
    };
    double x[2] = {}, estimate[2] = {}, p[4];
    std::copy(s.covariance, s.covariance + 4, p);
    draw(start, x);
    for (int k = 0; k <= steps; ++k) {
      double* at = &sum[std::size_t(k) * 3];
      at[0] += x[0] * x[0] / runs;
      at[1] += x[0] * x[1] / runs;
      at[2] += x[1] * x[1] / runs;
      const double answer = kGain[0] * estimate[0] + kGain[1] * estimate[1];
      const double u = answers ? answer + std::sqrt(kRevision[0]) * normal(engine) : 0.0;
      const auto move = [&](double* z) {
        const double z0 = kA[0] * z[0] + kA[1] * z[1] + kB[0] * u, z1 = kA[2] * z[0] + kA[3] * z[1] + kB[1] * u;
        z[0] = z0;
        z[1] = z1;
      };
      move(x);
      draw(process, x);
      move(estimate);
      double ap[4], next[4];
      for (int r = 0; r < 2; ++r)
        for (int c = 0; c < 2; ++c) ap[2 * r + c] = kA[2 * r] * p[c] + kA[2 * r + 1] * p[2 + c];
      for (int r = 0; r < 2; ++r)
        for (int c = 0; c < 2; ++c)
          next[2 * r + c] = ap[2 * r] * kA[2 * c] + ap[2 * r + 1] * kA[2 * c + 1] + s.process[2 * r + c];
      const double y = x[0] + std::sqrt(s.sensor_variance[0]) * normal(engine);
      const double innovation = next[0] + s.sensor_variance[0], g0 = next[0] / innovation, g1 = next[2] / innovation;
      const double off = y - estimate[0];
      estimate[0] += g0 * off;
      estimate[1] += g1 * off;
      p[0] = (1.0 - g0) * next[0];
      p[1] = (1.0 - g0) * next[1];
      p[2] = next[2] - g1 * next[0];
      p[3] = next[3] - g1 * next[1];
    }
  }
  return sum;
}

TEST(Spread, is_that_of_a_robot_that_is_measured_and_steered) {
  constexpr int kSteps = 25, kRuns = 160000;
  const StateSpread s = axis_spread();
  for (const bool answers : {false, true}) {
    const std::vector<double> want = simulate(s, answers, kSteps, kRuns);
    double error[4], estimate[4], scratch[64];
    ASSERT_LE(tiller::spread_scratch_size(2), 64u);
    tiller::begin_spread(s, 2, error, estimate);
    for (int k = 0; k <= kSteps; ++k) {
      const double p[3] = {error[0] + estimate[0], error[1] + estimate[1], error[3] + estimate[3]};
      const double* w = &want[std::size_t(k) * 3];
      // a second moment of 160000 runs is off by 0.35 %; four and a half of that, for 156 comparisons
      for (int i = 0; i < 3; ++i) EXPECT_NEAR(p[i], w[i], 0.016 * std::sqrt(w[0] * w[2])) << k << " " << i << answers;
      tiller::step_spread(s, axis_stage(answers), error, estimate, scratch);
    }
    if (answers) {
      EXPECT_LT(want[std::size_t(kSteps) * 3], 0.2) << "the feedback holds the axis";
    } else {
      EXPECT_GT(want[std::size_t(kSteps) * 3], 2.0) << "open loop it runs away";
    }
  }
}

TEST(Spread, quantiles_are_the_normal_distribution_s) {
  for (const double risk : {0.5, 0.4, 0.2, 0.07, 0.05, 0.01, 1e-3, 1e-6, 1e-9, 1e-12}) {
    const double z = tiller::gaussian_quantile_above(risk);
    EXPECT_NEAR(0.5 * std::erfc(z / std::sqrt(2.0)) / risk, 1.0, 5e-6) << risk;
  }
}

TEST(Spread, expected_saturating_cost_is_the_integral) {
  const double p[9] = {0.5, 0.2, 0.1, 0.2, 0.3, -0.05, 0.1, -0.05, 0.4};
  const double d[3] = {0.4, -0.7, 5.0}, width[3] = {0.8, 1.5, INFINITY};
  // the third state has no say: a grid over the first two's Gaussian
  const double det = p[0] * p[4] - p[1] * p[1];
  double sum = 0.0;
  constexpr double kCell = 0.01;
  for (double x = -6.0; x < 6.0; x += kCell)
    for (double y = -6.0; y < 6.0; y += kCell) {
      const double q = (p[4] * x * x - 2.0 * p[1] * x * y + p[0] * y * y) / det;
      const double a = (x + d[0]) / width[0], b = (y + d[1]) / width[1];
      sum += std::exp(-0.5 * q) * (1.0 - std::exp(-0.5 * (a * a + b * b)));
    }
  sum *= kCell * kCell / (2.0 * 3.14159265358979 * std::sqrt(det));
  EXPECT_NEAR(tiller::expected_saturating_cost(3, d, p, width), sum, 1e-6);
  const double none[9] = {};
  EXPECT_NEAR(tiller::expected_saturating_cost(3, d, none, width),
              1.0 - std::exp(-0.5 * (0.25 + (0.7 / 1.5) * (0.7 / 1.5))), 1e-12);
  const double broken[9] = {-2.0, 0, 0, 0, 1, 0, 0, 0, 1};
  EXPECT_TRUE(std::isnan(tiller::expected_saturating_cost(3, d, broken, width)));
}

// ---- rollouts that carry noise ------------------------------------------------------------------

StateSpread line_spread() {
  StateSpread s;
  s.states = 2;
  const double start[4] = {0.02, 0.005, 0.005, 0.04}, process[4] = {1e-4, 5e-4, 5e-4, 1e-2};
  std::copy(start, start + 4, s.covariance);
  std::copy(process, process + 4, s.process);
  s.sensor_variance[0] = s.sensor_variance[1] = HUGE_VAL;
  return s;
}

TEST(NoisyRollouts, cost_what_the_spread_makes_them_cost) {
  tiller::Config c = line_config(tiller_planner_random_shooting);
  c.planner.particles = 64;
  c.planner.rollouts = 16;
  c.planner.noisy_rollouts = 1;
  c.planner.noise_sd[0] = 1e-9;  // the plan stays at rest: the noise alone moves the mass
  Bench bench(c, nullptr, tiller::select_rollout(double_integrator));
  const StateSpread spread = line_spread();
  bench.belief.spread = &spread;
  double sum = 0.0, squares = 0.0;
  constexpr int kTicks = 200;
  for (int tick = 0; tick < kTicks; ++tick) {
    const double cost = bench.plan().cost;
    sum += cost / kTicks;
    squares += cost * cost / kTicks;
  }
  // E sum x'Qx along A P A' + Q
  double p[3] = {spread.covariance[0], spread.covariance[1], spread.covariance[3]}, want = 0.0;
  const double h = c.period_s;
  for (std::uint32_t k = 0; k < c.planner.horizon; ++k) {
    want += c.cost.state_weight[0] * p[0] + c.cost.state_weight[1] * p[2];
    p[0] += 2.0 * h * p[1] + h * h * p[2] + spread.process[0];
    p[1] += h * p[2] + spread.process[1];
    p[2] += spread.process[3];
  }
  want += c.cost.terminal_weight[0] * p[0] + c.cost.terminal_weight[1] * p[2];
  const double error = std::sqrt((squares - sum * sum) / kTicks);
  EXPECT_NEAR(sum, want, 4.0 * error);
  EXPECT_LT(error, 0.05 * want) << "or the comparison says nothing";
}

TEST(NoisyRollouts, are_the_same_for_every_sample_and_change_with_the_tick) {
  tiller::Config c = line_config(tiller_planner_mppi);
  c.planner.noisy_rollouts = 1;
  c.planner.particles = 3;
  c.planner.noise_sd[0] = 1e-9;
  Bench a(c, nullptr, tiller::select_rollout(double_integrator)),
      b(c, nullptr, tiller::select_rollout(double_integrator));
  const StateSpread spread = line_spread();
  a.belief.spread = b.belief.spread = &spread;
  const double first = a.plan().cost;
  EXPECT_EQ(b.plan().cost, first);
  // all samples are the same sequence here: so are their costs
  EXPECT_NE(a.plan().cost, first);
  b.belief.spread = nullptr;
  EXPECT_LT(b.plan().cost, 1e-12) << "nothing is known to disturb the mass at its target";
}

// ---- chance constraints -------------------------------------------------------------------------

TEST(ChanceConstraints, keep_the_bound_away_by_the_quantile_of_shared_risk) {
  tiller::Config c = line_config(tiller_planner_sqp);
  c.planner.horizon = 60;
  c.planner.iterations = 10;
  c.cost.target[0] = 2.0;
  c.cost.state_weight[0] = 10.0;
  c.state_high[0] = 0.8;  // the target lies behind the bound
  c.cost.hard_bounds = 1;
  c.cost.bound_risk = 0.05;
  tiller::Config plain = c;
  plain.cost.bound_risk = 0.0;
  Bench bench(c), without(plain);
  StateSpread spread = line_spread();
  spread.sensor_variance[0] = 1e-4;
  for (double& p : spread.covariance) p *= 0.01;
  for (double& p : spread.process) p *= 0.01;
  bench.belief.spread = &spread;
  ASSERT_EQ(bench.plan_again().status, tiller_status_ok);
  ASSERT_EQ(without.plan_again().status, tiller_status_ok);
  // the plan's motion, and the spread under the gains that it gives out
  const tiller::PlannerTable& table = *tiller::find_planner(tiller_planner_sqp);
  double x = 0.0, v = 0.0, far = 0.0, w = 0.0, farthest = 0.0;
  double error[4], estimate[4], scratch[64];
  tiller::begin_spread(spread, 2, error, estimate);
  const double h = c.period_s, a[4] = {1.0, h, 0.0, 1.0}, b[2] = {0.0, h};
  std::vector<double> left, sd;
  for (std::uint32_t k = 0; k < c.planner.horizon; ++k) {
    double gain[2], state[2], input;
    ASSERT_TRUE(table.feedback(bench.planner(), k, gain, state, &input));
    x += h * v;
    v += h * static_cast<double>(bench.sequence()[k]);
    far += h * w;
    w += h * static_cast<double>(without.sequence()[k]);
    farthest = std::max(farthest, far);
    tiller::SpreadStage stage;
    stage.size = 2;
    stage.inputs = 1;
    stage.a = a;
    stage.stride = 2;
    stage.b = b;
    stage.gain = gain;
    stage.gain_stride = 2;
    tiller::step_spread(spread, stage, error, estimate, scratch);
    left.push_back(0.8 - x);
    sd.push_back(std::sqrt(error[0] + estimate[0]));
  }
  // the risk that the Gaussians leave is what was asked for: no more, and much of it is used
  double risk = 0.0;
  for (std::size_t k = 0; k < left.size(); ++k) risk += 0.5 * std::erfc(left[k] / sd[k] / std::sqrt(2.0));
  EXPECT_LE(risk, 0.05 * 1.02);
  EXPECT_GE(risk, 0.05 * 0.3);
  EXPECT_NEAR(farthest, 0.8, 1e-3) << "the means alone touch the bound";
}

TEST(ChanceConstraints, between_bounds_closer_than_the_spread_leave_the_middle) {
  tiller::Config c = line_config(tiller_planner_sqp);
  c.state_low[0] = -0.1;
  c.state_high[0] = 0.1;
  c.cost.hard_bounds = 1;
  c.cost.bound_risk = 0.01;
  Bench bench(c);
  StateSpread spread = line_spread();
  for (double& p : spread.process) p *= 1e4;
  bench.belief.spread = &spread;
  const tiller::PlanResult result = bench.plan_again();
  EXPECT_TRUE(std::isfinite(result.cost));
  EXPECT_TRUE(std::isfinite(bench.command[0]));
}

}  // namespace
}  // namespace tiller_test
