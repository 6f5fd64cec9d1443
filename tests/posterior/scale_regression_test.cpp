// The regression behind the conjugate engine against answers from formulas and from brute force.

#include "posterior/conjugate/scale_regression.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

namespace tiller {
namespace {

using Row = std::vector<double>;
using Matrix = std::vector<std::vector<long double>>;

struct Data {
  std::uint32_t d;
  std::vector<Row> x;
  Row y;
};

/// y = x' w + noise, regressors with unequal scales and correlated.
Data make_data(std::uint32_t d, int n, double noise, double size, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Data data{d, {}, {}};
  Row w(d);
  for (double& value : w) value = normal(random);
  for (int k = 0; k < n; ++k) {
    Row x(d);
    for (std::uint32_t j = 0; j < d; ++j)
      x[j] = size * (normal(random) + (j ? 0.5 * x[j - 1] / size : 0.0)) / (1.0 + j);
    double y = noise * normal(random);
    for (std::uint32_t j = 0; j < d; ++j) y += x[j] * w[j];
    data.x.push_back(x);
    data.y.push_back(y);
  }
  return data;
}

/// Inverse and log determinant by Gauss-Jordan elimination with extended precision; the matrix is positive definite.
Matrix inverse(Matrix a, long double* log_determinant) {
  const std::size_t n = a.size();
  Matrix b(n, std::vector<long double>(n));
  *log_determinant = 0.0L;
  for (std::size_t i = 0; i < n; ++i) b[i][i] = 1.0L;
  for (std::size_t k = 0; k < n; ++k) {
    const long double pivot = a[k][k];
    *log_determinant += std::log(pivot);
    for (std::size_t c = 0; c < n; ++c) a[k][c] /= pivot, b[k][c] /= pivot;
    for (std::size_t r = 0; r < n; ++r) {
      if (r == k) continue;
      const long double factor = a[r][k];
      for (std::size_t c = 0; c < n; ++c) a[r][c] -= factor * a[k][c], b[r][c] -= factor * b[k][c];
    }
  }
  return b;
}

/// Moments by the normal equations at 6,000 noise scales.
struct BruteForce {
  std::vector<long double> mean;
  Matrix covariance;
  long double variance = 0.0L;

  BruteForce(const Data& data, double a0, double rate = 1.0) : mean(data.d), covariance(data.d, mean) {
    const std::size_t d = data.d;
    Matrix gram(d, std::vector<long double>(d));
    std::vector<long double> side(d);
    long double squares = 0.0L, count = 0.0L;
    for (std::size_t k = 0; k < data.y.size(); ++k) {
      for (std::size_t r = 0; r < d; ++r) {
        for (std::size_t c = 0; c < d; ++c)
          gram[r][c] = rate * gram[r][c] + static_cast<long double>(data.x[k][r]) * data.x[k][c];
        side[r] = rate * side[r] + static_cast<long double>(data.x[k][r]) * data.y[k];
      }
      squares = rate * squares + static_cast<long double>(data.y[k]) * data.y[k];
      count = rate * count + 1.0L;
    }
    struct Node {
      long double log_weight, s2;
      std::vector<long double> mean;
      Matrix covariance;
    };
    std::vector<Node> nodes;
    long double top = -HUGE_VALL;
    for (int k = 0; k <= 6000; ++k) {
      const long double t = -15.0L + 60.0L * k / 6000, s2 = std::exp(t);
      Matrix a(d, std::vector<long double>(d));
      for (std::size_t r = 0; r < d; ++r)
        for (std::size_t c = 0; c < d; ++c) a[r][c] = gram[r][c] / s2 + (r == c ? 1.0L : 0.0L);
      Node node{0.0L, s2, std::vector<long double>(d), {}};
      long double log_determinant, explained = 0.0L;
      node.covariance = inverse(a, &log_determinant);
      for (std::size_t r = 0; r < d; ++r) {
        for (std::size_t c = 0; c < d; ++c) node.mean[r] += node.covariance[r][c] * side[c] / s2;
        explained += node.mean[r] * side[r] / s2;
      }
      node.log_weight = -(a0 + 0.5L * count) * t - a0 / s2 - 0.5L * (log_determinant + squares / s2 - explained);
      top = std::fmax(top, node.log_weight);
      nodes.push_back(node);
    }
    long double sum = 0.0L;
    for (Node& node : nodes) sum += node.log_weight = std::exp(node.log_weight - top);
    for (Node& node : nodes) {
      node.log_weight /= sum;
      variance += node.log_weight * node.s2;
      for (std::size_t r = 0; r < d; ++r) mean[r] += node.log_weight * node.mean[r];
    }
    for (const Node& node : nodes)
      for (std::size_t r = 0; r < d; ++r)
        for (std::size_t c = 0; c < d; ++c)
          covariance[r][c] +=
              node.log_weight * (node.covariance[r][c] + (node.mean[r] - mean[r]) * (node.mean[c] - mean[c]));
  }
};

double worst_difference(const ScaleRegression& got, const BruteForce& want) {
  double worst = std::fabs(got.variance() / static_cast<double>(want.variance) - 1.0);
  for (std::uint32_t r = 0; r < got.dimension(); ++r) {
    const double sd = std::sqrt(static_cast<double>(want.covariance[r][r]));
    worst = std::fmax(worst, std::fabs(got.mean()[r] - static_cast<double>(want.mean[r])) / sd);
    for (std::uint32_t c = 0; c < got.dimension(); ++c)
      worst = std::fmax(worst, std::fabs(got.covariance(r, c) - static_cast<double>(want.covariance[r][c])) /
                                   (sd * std::sqrt(static_cast<double>(want.covariance[c][c]))));
  }
  return worst;
}

// In deviations: 48 nodes against 6,000 with extended precision.
TEST(ScaleRegression, IsTheIntegralOverTheNoise) {
  double worst = 0.0;
  for (std::uint32_t d : {1u, 2u, 4u})
    for (int n : {3, 10, 100})
      for (double noise : {0.2, 1.0, 4.0})
        for (double size : {0.01, 1.0, 30.0})
          for (double a0 : {2.0, 20.0}) {
            const Data data = make_data(d, n, noise, size, d * 100 + static_cast<unsigned>(n));
            ScaleRegression got;
            got.reset(d, a0);
            for (int k = 0; k < n; ++k)
              got.add(data.x[static_cast<std::size_t>(k)].data(), data.y[static_cast<std::size_t>(k)]);
            got.solve();
            const double difference = worst_difference(got, BruteForce(data, a0));
            // three data leave tails of the noise that the nodes resolve less well
            EXPECT_LT(difference, n == 3 ? 1e-7 : 1e-9) << d << " " << n << " " << noise << " " << size << " " << a0;
            if (n > 3) worst = std::fmax(worst, difference);
          }
  std::printf("largest difference from brute force, in deviations, from ten data on: %.2g\n", worst);
}

// Where the prior has no say left the law is the normal-inverse-gamma's: mean by least squares, variance that of a
// Student t. Its share here is (posterior / prior deviation)^2 < 1e-11.
TEST(ScaleRegression, IsLeastSquaresWhereTheDataAreSharp) {
  for (std::uint32_t d : {1u, 3u, 8u}) {
    const int n = 400;
    const double a0 = 3.0;
    const Data data = make_data(d, n, 1.0, 1e6, 77 + d);
    ScaleRegression got;
    got.reset(d, a0);
    for (int k = 0; k < n; ++k)
      got.add(data.x[static_cast<std::size_t>(k)].data(), data.y[static_cast<std::size_t>(k)]);
    got.solve();
    Matrix gram(d, std::vector<long double>(d));
    std::vector<long double> side(d), w(d);
    for (int k = 0; k < n; ++k)
      for (std::uint32_t r = 0; r < d; ++r) {
        const Row& x = data.x[static_cast<std::size_t>(k)];
        for (std::uint32_t c = 0; c < d; ++c) gram[r][c] += static_cast<long double>(x[r]) * x[c];
        side[r] += static_cast<long double>(x[r]) * data.y[static_cast<std::size_t>(k)];
      }
    long double log_determinant, squares = 0.0L;
    const Matrix inverse_gram = inverse(gram, &log_determinant);
    for (std::uint32_t r = 0; r < d; ++r)
      for (std::uint32_t c = 0; c < d; ++c) w[r] += inverse_gram[r][c] * side[c];
    for (int k = 0; k < n; ++k) {
      long double e = data.y[static_cast<std::size_t>(k)];
      for (std::uint32_t r = 0; r < d; ++r) e -= data.x[static_cast<std::size_t>(k)][r] * w[r];
      squares += e * e;
    }
    // s^2 | data ~ InvGamma(a0 + (n - d) / 2, a0 + squares / 2)
    const double variance = static_cast<double>((a0 + 0.5L * squares) / (a0 + 0.5L * (n - d) - 1.0L));
    EXPECT_NEAR(got.variance() / variance, 1.0, 1e-9);
    for (std::uint32_t r = 0; r < d; ++r) {
      const double sd = std::sqrt(variance * static_cast<double>(inverse_gram[r][r]));
      EXPECT_NEAR(got.mean()[r], static_cast<double>(w[r]), 1e-9 * std::fabs(static_cast<double>(w[r])) + 1e-6 * sd);
      for (std::uint32_t c = 0; c < d; ++c)
        EXPECT_NEAR(got.covariance(r, c) / variance, static_cast<double>(inverse_gram[r][c]),
                    1e-9 * static_cast<double>(std::sqrt(inverse_gram[r][r] * inverse_gram[c][c])));
    }
  }
}

// A million data, two regressors that are almost the same: the sums' own conditioning is 1e12, and nothing may turn
// negative or not a number. Against the same sums with extended precision.
TEST(ScaleRegression, StaysDefiniteForAMillionData) {
  ScaleRegression got;
  got.reset(2, 5.0);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  Matrix gram(2, std::vector<long double>(2));
  std::vector<long double> side(2);
  const int n = 1000000;
  for (int k = 0; k < n; ++k) {
    const double a = normal(random), b = a + 1e-6 * normal(random);
    const double x[2] = {a, b}, y = 0.5 * a - 0.2 * b + normal(random);
    got.add(x, y);
    for (int r = 0; r < 2; ++r) {
      for (int c = 0; c < 2; ++c) gram[r][c] += static_cast<long double>(x[r]) * x[c];
      side[r] += static_cast<long double>(x[r]) * y;
    }
  }
  got.solve();
  // with the noise known by now to 1e-3 (s^2 = 1): the mean given s is exact
  Matrix a(2, std::vector<long double>(2));
  const long double s2 = got.variance();
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 2; ++c) a[r][c] = gram[r][c] / s2 + (r == c ? 1.0L : 0.0L);
  long double log_determinant;
  const Matrix covariance = inverse(a, &log_determinant);
  for (int r = 0; r < 2; ++r) {
    const long double mean = (covariance[r][0] * side[0] + covariance[r][1] * side[1]) / s2;
    const double sd = std::sqrt(static_cast<double>(covariance[r][r]));
    // the variance's own uncertainty (1.4e-3) enters the mean through the prior's share alone
    EXPECT_NEAR(got.mean()[r], static_cast<double>(mean), 1e-3 * sd);
    EXPECT_NEAR(std::sqrt(got.covariance(static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(r))) / sd, 1.0,
                1e-3);
  }
  const double sum = got.covariance(0, 0) + got.covariance(1, 1) + 2.0 * got.covariance(0, 1);
  // the sum of both weights is known to 1 / sqrt(n), a million times better than their difference
  EXPECT_NEAR(std::sqrt(sum) * std::sqrt(double(n)), 1.0, 0.01);
}

TEST(ScaleRegression, ForgetsTheDataAndNotThePrior) {
  const Data data = make_data(3, 300, 0.7, 1.0, 9);
  ScaleRegression got;
  got.reset(3, 4.0);
  for (std::size_t k = 0; k < 300; ++k) {
    got.forget(0.97);
    got.add(data.x[k].data(), data.y[k]);
  }
  got.solve();
  EXPECT_LT(worst_difference(got, BruteForce(data, 4.0, 0.97)), 1e-9);
  for (int k = 0; k < 3000; ++k) got.forget(0.97);
  got.solve();
  for (std::uint32_t r = 0; r < 3; ++r) {
    EXPECT_NEAR(got.mean()[r], 0.0, 1e-9);
    EXPECT_NEAR(got.covariance(r, r), 1.0, 1e-9);
  }
}

// Placed by 20,000 standard draws the particles have the law's moments.
TEST(ScaleRegression, PlacesDrawsFromTheLaw) {
  const Data data = make_data(2, 12, 1.5, 0.6, 21);
  ScaleRegression r;
  r.reset(2, 2.0);
  for (std::size_t k = 0; k < data.y.size(); ++k) r.add(data.x[k].data(), data.y[k]);
  r.solve();
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  const int n = 20000;
  constexpr int kStride = static_cast<int>(ScaleRegression::kMax);
  double mean[2] = {}, square[2][2] = {};
  for (int k = 0; k < n; ++k) {
    const double z[2] = {normal(random), normal(random)};
    double w[2];
    std::uint32_t node = 0;
    for (double below = r.node_weight(0); node + 1 < ScaleRegression::kNodes && below < (k + 0.5) / n;)
      below += r.node_weight(++node);
    double centre[ScaleRegression::kMax], root[ScaleRegression::kMax * ScaleRegression::kMax];
    r.law(node, centre, root);
    for (int i = 0; i < 2; ++i) w[i] = centre[i] + root[i * kStride] * z[0] + root[i * kStride + 1] * z[1];
    for (int i = 0; i < 2; ++i) mean[i] += w[i] / n;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j) square[i][j] += w[i] * w[j] / n;
  }
  for (std::uint32_t i = 0; i < 2; ++i) {
    // five standard errors of a mean and of a variance
    EXPECT_NEAR(mean[i], r.mean()[i], 5.0 * std::sqrt(r.covariance(i, i) / n));
    for (std::uint32_t j = 0; j < 2; ++j)
      EXPECT_NEAR(square[i][j] - mean[i] * mean[j], r.covariance(i, j),
                  5.0 * std::sqrt(2.0 / n * r.covariance(i, i) * r.covariance(j, j)));
  }
}

}  // namespace
}  // namespace tiller
