// REPS with a log likelihood for a reward and a fixed temperature, against the conjugate posterior of a linear Gaussian
// model: on a grid of quadrature points, where the integrals are exact, and draw by draw.
#include "tools/identify/likelihood.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "problems.hpp"
#include "tools/identify/reps.hpp"

namespace tiller::tools {
namespace {

constexpr double kTwoPi = 6.283185307179586;

double log_density(const Normal2& n, const double* v) {
  const double dx = v[0] - n.mean[0], dy = v[1] - n.mean[1], det = n.determinant();
  const double square = (n.cov[1][1] * dx * dx - 2 * n.cov[0][1] * dx * dy + n.cov[0][0] * dy * dy) / det;
  return -0.5 * square - 0.5 * std::log(det) - std::log(kTwoPi);
}

const Normal2 kPrior{{0.5, 0.5}, {{1, 0}, {0, 1}}};

/// KL divergence of `a` from `b`.
double divergence(const Normal2& a, const Normal2& b) {
  const double det = b.determinant();
  const double inverse[2][2] = {{b.cov[1][1] / det, -b.cov[0][1] / det}, {-b.cov[1][0] / det, b.cov[0][0] / det}};
  double sum = std::log(det / a.determinant()) - 2;
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j)
      sum += inverse[i][j] * (a.cov[j][i] + (a.mean[i] - b.mean[i]) * (a.mean[j] - b.mean[j]));
  return 0.5 * sum;
}

TestLog noisy_log(unsigned seed, double sensor_sd) {
  TestLog log = linear_log(seed);
  for (int i = 0; i < 2; ++i) log.config.measurement_sd[i] = sensor_sd;
  return log;
}

std::vector<double> rewards_of(const TestLog& log, const std::vector<double>& v) {
  const MethodProblem problem = log.problem();
  const Coordinates coordinates(*problem.config);
  std::vector<Episode> episodes;
  std::string error;
  EXPECT_TRUE(make_episodes(problem, episodes, error)) << error;
  return TransitionLikelihood(problem, coordinates, episodes)(v, v.size() / 2);
}

/// The trapezoidal rule over +-9 deviations in steps of an eighth. On a Gaussian its error is about
/// exp(-2 pi^2 8^2): none at all, so what is left is rounding and the tails beyond nine deviations.
struct Quadrature {
  std::vector<double> v, base;  // base: prior density times the area of a point
  explicit Quadrature(const Normal2& about) {
    constexpr int kReach = 72;
    const double h[2] = {std::sqrt(about.cov[0][0]) / 8, std::sqrt(about.cov[1][1]) / 8};
    for (int i = -kReach; i <= kReach; ++i)
      for (int j = -kReach; j <= kReach; ++j) {
        const double point[2] = {about.mean[0] + i * h[0], about.mean[1] + j * h[1]};
        v.insert(v.end(), point, point + 2);
        base.push_back(h[0] * h[1] * std::exp(log_density(kPrior, point)));
      }
  }
};

Normal2 moments(const std::vector<double>& v, const std::vector<double>& weight) {
  Normal2 n;
  for (std::size_t s = 0; s < weight.size(); ++s)
    for (std::size_t i = 0; i < 2; ++i) n.mean[i] += weight[s] * v[2 * s + i];
  for (std::size_t s = 0; s < weight.size(); ++s)
    for (std::size_t i = 0; i < 2; ++i)
      for (std::size_t j = 0; j < 2; ++j)
        n.cov[i][j] += weight[s] * (v[2 * s + i] - n.mean[i]) * (v[2 * s + j] - n.mean[j]);
  return n;
}

TEST(TransitionLikelihood, IsTheSumOfGaussianLogDensities) {
  for (const double sensor_sd : {0.0, 0.2}) {
    const TestLog log = noisy_log(1, sensor_sd);
    const std::vector<double> v = {0.9, -0.3, 0.2, 1.4};
    const std::vector<double> reward = rewards_of(log, v);
    const Grid& g = log.grids[0];
    const double variance = 0.7 * 0.7 * 0.1 + 2 * sensor_sd * sensor_sd;
    for (std::size_t s = 0; s < 2; ++s) {
      double sum = 0;
      for (std::size_t p = 0; p + 1 < g.points(); ++p) {
        const double a = v[2 * s], b = v[2 * s + 1], x = g.input[0][p], y = g.input[1][p];
        const double rate[2] = {a * x + b * y, b * x - a * y};
        for (std::size_t r = 0; r < 2; ++r) {
          const double e = g.state[r][p + 1] - g.state[r][p] - 0.1 * rate[r];
          sum -= 0.5 * (e * e / variance + std::log(kTwoPi * variance));
        }
      }
      EXPECT_NEAR(reward[s], sum, 1e-9 * std::fabs(sum)) << "sensor " << sensor_sd;
    }
  }
}

TEST(RepsAtFixedTemperature, IsTheConjugatePosteriorOnAGrid) {
  for (const unsigned seed : {1u, 2u, 3u})
    for (const double sensor_sd : {0.0, 0.2})
      for (const double eta : {1.0, 0.5, 3.0}) {
        const TestLog log = noisy_log(seed, sensor_sd);
        const Normal2 exact = exact_posterior(log, eta);
        const Quadrature grid(exact);
        RepsWeights found;
        ASSERT_TRUE(reps_weights_at(rewards_of(log, grid.v), grid.base, eta, found));
        const Normal2 n = moments(grid.v, found.weight);
        for (int i = 0; i < 2; ++i) {
          EXPECT_NEAR(n.mean[i], exact.mean[i], 1e-6) << "eta " << eta;
          for (int j = 0; j < 2; ++j) EXPECT_NEAR(n.cov[i][j], exact.cov[i][j], 1e-6) << "eta " << eta;
        }
        // the grid holds a part of the prior: the divergence from that part is less by the part's logarithm
        double part = 0;
        for (const double b : grid.base) part += b;
        EXPECT_NEAR(found.kl - std::log(part), divergence(exact, kPrior), 1e-6) << "eta " << eta;
        EXPECT_EQ(found.temperature, eta);
      }
}

// Draws come from the prior, so each weight is the ratio of posterior to prior density there, up to one constant.
TEST(RepsAtFixedTemperature, EachDrawWeighsPosteriorOverPrior) {
  for (const double eta : {1.0, 2.5}) {
    const TestLog log = noisy_log(4, 0.1);
    MethodProblem problem = log.problem();
    problem.options.simulations = 3000;
    problem.options.eta = eta;
    MethodResult result;
    std::string error;
    ASSERT_TRUE(find_method("reps")->run(problem, result, error)) << error;
    const Normal2 exact = exact_posterior(log, eta);
    double low = INFINITY, high = -INFINITY;
    std::size_t compared = 0;
    for (std::size_t s = 0; s < result.count(); ++s) {
      const double* v = result.params.data() + 2 * s;
      if (result.weight[s] < 1e-200) continue;  // far from the smallest double, whose logarithm is inexact
      const double constant = std::log(result.weight[s]) - log_density(exact, v) + log_density(kPrior, v);
      low = std::min(low, constant);
      high = std::max(high, constant);
      ++compared;
    }
    EXPECT_GT(compared, 2900u);
    EXPECT_LT(high - low, 1e-6) << "eta " << eta;
    EXPECT_EQ(result.history.back().temperature, eta);
  }
}

TEST(RepsAtFixedTemperature, SharesOfTheBaseCountAsSoManyDraws) {
  RepsWeights twice, shared;
  ASSERT_TRUE(reps_weights_at({-1.0, -1.0, -2.5}, {}, 0.7, twice));
  ASSERT_TRUE(reps_weights_at({-1.0, -2.5}, {2.0, 1.0}, 0.7, shared));
  EXPECT_NEAR(twice.weight[0] + twice.weight[1], shared.weight[0], 1e-15);
  EXPECT_NEAR(shared.weight[1] / shared.weight[0], 0.5 * std::exp(-1.5 / 0.7), 1e-15);
  EXPECT_NEAR(twice.kl, shared.kl, 1e-15);
}

TEST(RepsAtFixedTemperature, HugeRewardsNeitherOverflowNorPoison) {
  RepsWeights r;
  ASSERT_TRUE(reps_weights_at({1e308, -INFINITY, NAN, 1e308 * (1 - 1e-15)}, {}, 1.0, r));
  EXPECT_EQ(r.weight[0], 1.0);
  EXPECT_EQ(r.weight[1] + r.weight[2] + r.weight[3], 0.0);
  EXPECT_FALSE(reps_weights_at({-INFINITY, NAN}, {}, 1.0, r));
  EXPECT_FALSE(reps_weights_at({1.0, 2.0}, {}, 0.0, r));
  EXPECT_FALSE(reps_weights_at({1.0, 2.0}, {}, NAN, r));
  EXPECT_FALSE(reps_weights_at({1.0, 2.0}, {0.0, 0.0}, 1.0, r));
}

}  // namespace
}  // namespace tiller::tools
