// The mixture that stands for a cloud of particles: that it is the cloud's, and never narrower.

#include "tools/robot/mixture_fit.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>

#include "tiller/config.hpp"
#include "tools/robot/joint_prior.hpp"

namespace tiller::tools {
namespace {

using Matrix = Eigen::MatrixXd;
using Row = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Vector = Eigen::VectorXd;

PointCloud cloud_of(std::uint32_t d, const std::vector<double>& values) {
  PointCloud c;
  c.dimension = d;
  c.value = values;
  c.weight.assign(values.size() / d, static_cast<double>(d) / static_cast<double>(values.size()));
  c.low.assign(d, -INFINITY);
  c.high.assign(d, INFINITY);
  c.spread.assign(d, 1.0);
  return c;
}

/// n draws of a correlated normal around `centre`, appended.
void add_normal(std::vector<double>& values, int n, double x, double y, double sd, double correlation, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  for (int k = 0; k < n; ++k) {
    const double a = normal(random), b = normal(random);
    values.push_back(x + sd * a);
    values.push_back(y + sd * (correlation * a + std::sqrt(1.0 - correlation * correlation) * b));
  }
}

struct Moments {
  Vector mean;
  Matrix covariance;
};
Moments moments_of(const PointCloud& c) {
  const Eigen::Map<const Row> points(c.value.data(), static_cast<Eigen::Index>(c.size()), c.dimension);
  const Eigen::Map<const Vector> weight(c.weight.data(), static_cast<Eigen::Index>(c.size()));
  Moments m;
  m.mean = points.transpose() * weight;
  const Matrix off = points.rowwise() - m.mean.transpose();
  m.covariance = off.transpose() * weight.asDiagonal() * off;
  return m;
}
Moments moments_of(const GaussianMixture& g) {
  const Eigen::Index d = g.dimension;
  Moments m{Vector::Zero(d), Matrix::Zero(d, d)};
  for (std::size_t c = 0; c < g.components(); ++c)
    m.mean += g.weight[c] * Eigen::Map<const Vector>(&g.mean[c * g.dimension], d);
  for (std::size_t c = 0; c < g.components(); ++c) {
    const Vector off = Eigen::Map<const Vector>(&g.mean[c * g.dimension], d) - m.mean;
    m.covariance += g.weight[c] * (Eigen::Map<const Row>(&g.covariance[c * g.dimension * g.dimension], d, d) +
                                   Row(off * off.transpose()));
  }
  return m;
}

/// Least eigenvalue of (mixture - points) covariance, in units of the points' own.
double least_excess(const GaussianMixture& g, const PointCloud& c) {
  const Matrix points = moments_of(c).covariance;
  const Eigen::LLT<Matrix> root(points);
  Matrix excess = root.matrixL().solve(moments_of(g).covariance - points);
  excess = root.matrixL().solve(Matrix(excess.transpose()));
  return Eigen::SelfAdjointEigenSolver<Matrix>(Matrix(0.5 * (excess + excess.transpose()))).eigenvalues().minCoeff();
}

TEST(MixtureFit, OneNormalIsOneComponentWithTheMomentsOfThePoints) {
  for (unsigned seed = 100001; seed < 100021; ++seed) {
    std::vector<double> values;
    add_normal(values, 256, 3.0, -2.0, 0.1, 0.9, seed);
    const PointCloud c = cloud_of(2, values);
    const GaussianMixture g = fit_mixture(c);
    EXPECT_EQ(g.components(), 1u) << seed;
    const Moments points = moments_of(c), fitted = moments_of(g);
    EXPECT_LT((points.mean - fitted.mean).norm(), 1e-9);
    // wider by 257/255 for 256 points, and by the floor of a millionth
    EXPECT_LT((fitted.covariance - 257.0 / 255.0 * points.covariance).norm(), 1e-5 * points.covariance.norm());
    EXPECT_GT(least_excess(g, c), 0.0);
  }
}

TEST(MixtureFit, SeparateModesAreComponentsOfTheirOwn) {
  for (unsigned seed = 100001; seed < 100011; ++seed) {
    std::vector<double> values;
    add_normal(values, 300, 0.0, 0.0, 0.1, 0.0, seed);
    add_normal(values, 100, 1.0, 0.0, 0.05, 0.5, seed + 1000);
    add_normal(values, 200, 0.0, 2.0, 0.2, -0.8, seed + 2000);
    const PointCloud c = cloud_of(2, values);
    const GaussianMixture g = fit_mixture(c);
    ASSERT_EQ(g.components(), 3u) << seed;
    EXPECT_GE(least_excess(g, c), -1e-9);
    std::vector<double> weight = g.weight;
    std::sort(weight.begin(), weight.end());
    EXPECT_NEAR(weight[0], 100.0 / 600, 1e-3);
    EXPECT_NEAR(weight[1], 200.0 / 600, 1e-3);
  }
}

/// A banana (y = x^2): more than one component, still not narrower, and each covariance has a root.
TEST(MixtureFit, CurvedCloudIsNotNarrower) {
  std::mt19937_64 random(100001);
  std::normal_distribution<double> normal;
  std::vector<double> values;
  for (int k = 0; k < 512; ++k) {
    const double x = normal(random);
    values.push_back(x);
    values.push_back(x * x + 0.1 * normal(random));
  }
  const PointCloud c = cloud_of(2, values);
  const GaussianMixture g = fit_mixture(c);
  EXPECT_GT(g.components(), 1u);
  EXPECT_GE(least_excess(g, c), -1e-9);
  EXPECT_EQ(roots_of(g).size(), g.components() * 4);
}

TEST(MixtureFit, WeightsAndCopiesCount) {
  // the same cloud as 64 points with weights and as 256 with copies
  std::vector<double> values, copies, weight;
  add_normal(values, 64, 0.0, 0.0, 1.0, 0.3, 100001);
  for (std::size_t k = 0; k < 64; ++k) {
    const int times = 1 + static_cast<int>(k % 7);
    weight.push_back(times);
    for (int i = 0; i < times; ++i) copies.insert(copies.end(), {values[2 * k], values[2 * k + 1]});
  }
  PointCloud weighted = cloud_of(2, values);
  double sum = 0.0;
  for (const double w : weight) sum += w;
  for (std::size_t k = 0; k < 64; ++k) weighted.weight[k] = weight[k] / sum;
  const GaussianMixture a = fit_mixture(weighted), b = fit_mixture(cloud_of(2, copies));
  ASSERT_EQ(a.components(), b.components());
  for (std::size_t i = 0; i < a.covariance.size(); ++i) EXPECT_NEAR(a.covariance[i], b.covariance[i], 1e-12);
}

TEST(MixtureFit, FewPointsAreWidenedAndOnePointIsNoCollapse) {
  const PointCloud two = cloud_of(1, {0.0, 1.0, 0.0, 1.0, 0.0, 1.0});
  const GaussianMixture g = fit_mixture(two);
  EXPECT_EQ(g.components(), 1u);
  EXPECT_NEAR(g.covariance[0], 0.25 * 3.0, 1e-5);  // two distinct points: (2 + 1) / (2 - 1)
  PointCloud one = cloud_of(2, {0.5, 0.7, 0.5, 0.7});
  one.spread = {2.0, 3.0};
  const GaussianMixture single = fit_mixture(one);
  EXPECT_EQ(roots_of(single).size(), 4u);
  EXPECT_GE(std::sqrt(single.covariance[0]), 2.0e-4);
}

/// Deviations of 512 points of `prior` after `rounds` of fitting and drawing again from the fit, without any data, over
/// those before: (d), geometric mean of six series. What is drawn is random: the deviation of 512 points is off by some
/// 2 % in each round (cut draws are not stratified), 6 % after ten, and the mean of six series by 2.6 %.
std::vector<double> carried_over(const std::vector<tiller_prior_t>& prior, int rounds) {
  constexpr std::uint32_t kPoints = 512, kSeries = 6;
  const auto d = static_cast<std::uint32_t>(prior.size());
  std::vector<double> log_ratio(d, 0.0);
  for (std::uint32_t series = 0; series < kSeries; ++series) {
    tiller::Config config{};
    config.param_count = d;
    std::copy(prior.begin(), prior.end(), config.priors);
    PointCloud cloud = cloud_of(d, std::vector<double>(std::size_t{d} * kPoints));
    for (std::uint32_t j = 0; j < d; ++j) {
      cloud.low[j] = prior[j].low;
      cloud.high[j] = prior[j].high;
      cloud.spread[j] = prior_spread(prior[j]);
    }
    Moments before;
    std::unique_ptr<JointPrior> joint;
    for (int round = 0; round <= rounds; ++round) {
      std::vector<double> v(std::size_t{d} * kPoints);
      std::vector<std::uint32_t> index(kPoints);
      PriorDistribution(config).draw(100001 + 1000 * series + static_cast<std::uint64_t>(round), kPoints, v.data(),
                                     index.data());
      for (std::size_t k = 0; k < kPoints; ++k)
        for (std::size_t j = 0; j < d; ++j) cloud.value[d * k + j] = v[kPoints * j + k];
      if (round == 0) before = moments_of(cloud);
      if (round == rounds) break;
      joint = std::make_unique<JointPrior>(fit_mixture(cloud));
      config.prior_mixture = &joint->mixture;
    }
    const Moments after = moments_of(cloud);
    for (Eigen::Index j = 0; j < d; ++j)
      log_ratio[static_cast<std::size_t>(j)] +=
          0.5 * std::log(after.covariance(j, j) / before.covariance(j, j)) / kSeries;
  }
  for (double& r : log_ratio) {
    r = std::exp(r);
    std::printf("deviation after %d rounds over that before: %.3f\n", rounds, r);
  }
  return log_ratio;
}

/// What is not known stays unknown. A fit that knows nothing of the cut ends at a tenth: .82 a round.
TEST(MixtureFit, WhatIsNotLearntStaysAsWideAsItWas) {
  const auto ratio = carried_over(
      {{tiller_prior_uniform, 0, 0, 0, 0.2, 1.2}, {tiller_prior_normal, 0, 0, 1, -INFINITY, INFINITY}}, 10);
  for (const double r : ratio) {
    EXPECT_GT(r, 0.92);
    EXPECT_LT(r, 1.12);  // wider by (n + 1) / (n - 1) in each round
  }
}

/// Four parameters of which nothing is learnt: hardly a draw of so wide a normal lies within all bounds at once.
TEST(MixtureFit, NothingLearntOfFourParameters) {
  for (const double r : carried_over(std::vector<tiller_prior_t>(4, {tiller_prior_uniform, 0, 0, 0, 0.0, 1.0}), 5)) {
    EXPECT_GT(r, 0.92);
    EXPECT_LT(r, 1.12);
  }
}

/// A friction that is near zero: half a normal at its bound. What is drawn from the fit has the cloud's mean and
/// deviation (to 3 %), though a normal with those moments, cut at the bound, has not.
TEST(MixtureFit, CloudAtABoundKeepsItsMoments) {
  PointCloud c = cloud_of(1, {});
  c.low = {0.0};
  c.spread = {1.0};
  std::mt19937_64 random(100001);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 512; ++k) c.value.push_back(std::fabs(normal(random)));
  c.weight.assign(512, 1.0 / 512);
  const Moments points = moments_of(c);
  const double sd = std::sqrt(points.covariance(0, 0));
  const JointPrior joint(fit_mixture(c));
  tiller::Config config{};
  config.param_count = 1;
  config.prior_mixture = &joint.mixture;
  config.priors[0] = {tiller_prior_normal, 0, 0, 1, 0.0, INFINITY};
  PointCloud drawn = cloud_of(1, std::vector<double>(4096));
  std::vector<std::uint32_t> index(4096);
  PriorDistribution(config).draw(1, 4096, drawn.value.data(), index.data());
  const Moments again = moments_of(drawn);
  EXPECT_NEAR(again.mean(0), points.mean(0), 0.03 * sd);
  EXPECT_NEAR(std::sqrt(again.covariance(0, 0)) / sd, 1.0, 0.03);
}

TEST(MixtureFit, SamePointsSameBits) {
  std::vector<double> values;
  add_normal(values, 200, 0.0, 0.0, 0.1, 0.0, 100001);
  add_normal(values, 100, 1.0, 0.0, 0.05, 0.5, 100002);
  const GaussianMixture a = fit_mixture(cloud_of(2, values)), b = fit_mixture(cloud_of(2, values));
  EXPECT_EQ(a.weight, b.weight);
  EXPECT_EQ(a.mean, b.mean);
  EXPECT_EQ(a.covariance, b.covariance);
}

}  // namespace
}  // namespace tiller::tools
