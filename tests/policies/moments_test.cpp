// Moments against samples, and every derivative against differences.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "core/rng.hpp"
#include "tools/policy_search/gaussian_process.hpp"
#include "tools/policy_search/long_term_cost.hpp"

namespace tiller::tools::policy {
namespace {

Matrix draws(Eigen::Index rows, Eigen::Index cols, std::uint64_t seed) {
  Rng rng(seed, 1, 0);
  Matrix out(rows, cols);
  for (Eigen::Index j = 0; j < cols; ++j)
    for (Eigen::Index i = 0; i < rows; ++i) out(i, j) = rng.normal();
  return out;
}

Matrix covariance(Eigen::Index n, double scale, std::uint64_t seed) {
  const Matrix a = draws(n, n + 2, seed);
  return scale / static_cast<double>(n + 2) * a * a.transpose();
}

/// A process conditioned on a smooth function of `inputs` numbers, with two outputs.
Bumps process(int inputs, int points) {
  const Matrix x = 1.5 * draws(inputs, points, 3);
  Matrix y(2, points);
  y.row(0) = x.row(0).array().sin() + 0.3 * x.row(inputs - 1).array();
  y.row(1) = x.row(0).array() * x.row(1).array() * 0.4;
  GpShape shape;
  shape.log_length = Matrix::Zero(inputs, 2);
  shape.log_length.col(1).setConstant(0.3);
  shape.log_signal = Vector::Constant(2, 0.1);
  shape.log_noise = Vector::Constant(2, -2.5);
  return condition(x, y, shape, {});
}

TEST(Moments, AreThoseOfSamples) {
  const Bumps bumps = process(3, 25);
  const Vector m = Vector::LinSpaced(3, -0.4, 0.7);
  const Matrix s = covariance(3, 0.5, 5), root = s.llt().matrixL();
  const Moments exact = bump_moments(bumps, m, s);
  constexpr int kSamples = 100000;
  const Matrix z = draws(3, kSamples, 9);
  Matrix y(2, kSamples), x = (root * z).colwise() + m;
  Vector at, variance, inner = Vector::Zero(2);
  for (int i = 0; i < kSamples; ++i) {
    bump_values(bumps, x.col(i), at, &variance);
    y.col(i) = at;
    inner += variance / kSamples;
  }
  const Vector mean = y.rowwise().mean();
  const Matrix dy = y.colwise() - mean, dx = x.colwise() - m;
  Matrix sampled = dy * dy.transpose() / kSamples;
  sampled.diagonal() += inner;
  // four standard errors of a mean of 1e5 numbers of order one
  EXPECT_LT((exact.mean - mean).cwiseAbs().maxCoeff(), 0.013);
  EXPECT_LT((exact.covariance - sampled).cwiseAbs().maxCoeff(), 0.013);
  EXPECT_LT((s * exact.gain - dx * dy.transpose() / kSamples).cwiseAbs().maxCoeff(), 0.013);
  EXPECT_GT(sampled.cwiseAbs().maxCoeff(), 0.1);  // nothing above passes because it is zero
}

TEST(Moments, AtACertainInputAreTheValues) {
  const Bumps bumps = process(3, 25);
  const Vector m = Vector::LinSpaced(3, -0.4, 0.7);
  const Moments moments = bump_moments(bumps, m, Matrix::Zero(3, 3));
  Vector mean, variance;
  bump_values(bumps, m, mean, &variance);
  EXPECT_LT((moments.mean - mean).norm(), 1e-10);
  EXPECT_LT((moments.covariance.diagonal() - variance).norm(), 1e-10);
  EXPECT_NEAR(moments.covariance(0, 1), 0.0, 1e-10);
}

double weighed(const Bumps& bumps, const Vector& m, const Matrix& s, const Moments& by) {
  const Moments f = bump_moments(bumps, m, s);
  return f.mean.dot(by.mean) + f.covariance.cwiseProduct(by.covariance).sum() + f.gain.cwiseProduct(by.gain).sum();
}

TEST(Moments, DerivativesAreThoseOfDifferences) {
  for (const bool uncertain : {true, false}) {
    Bumps bumps = process(3, 8);
    if (!uncertain) bumps.w.clear();
    Vector m = Vector::LinSpaced(3, -0.4, 0.7);
    Matrix s = covariance(3, 0.5, 5);
    const Moments by{draws(2, 1, 20), covariance(2, 1.0, 21), draws(3, 2, 22)};
    BumpsDerivative own(bumps);
    const InputDerivative back = bump_adjoint(bumps, m, s, by, &own);
    constexpr double h = 1e-6;
    const auto slope = [&](double& number) {
      const double at = number;
      number = at + h;
      const double above = weighed(bumps, m, s, by);
      number = at - h;
      const double below = weighed(bumps, m, s, by);
      number = at;
      return (above - below) / (2 * h);
    };
    for (Eigen::Index i = 0; i < 3; ++i) EXPECT_NEAR(back.mean(i), slope(m(i)), 1e-6);
    for (Eigen::Index i = 0; i < 3; ++i)
      for (Eigen::Index j = 0; j <= i; ++j) {
        const auto moved = [&](double d) {
          Matrix t = s;
          t(i, j) += d;
          if (i != j) t(j, i) += d;
          return weighed(bumps, m, t, by);
        };
        const double both = i == j ? back.covariance(i, i) : back.covariance(i, j) + back.covariance(j, i);
        EXPECT_NEAR(both, (moved(h) - moved(-h)) / (2 * h), 1e-6) << i << j;
      }
    for (Eigen::Index i = 0; i < bumps.x.size(); ++i) EXPECT_NEAR(own.x(i), slope(bumps.x(i)), 1e-6) << i;
    for (Eigen::Index i = 0; i < bumps.log_length.size(); ++i)
      EXPECT_NEAR(own.log_length(i), slope(bumps.log_length(i)), 1e-6) << i;
    for (Eigen::Index i = 0; i < bumps.beta.size(); ++i) EXPECT_NEAR(own.beta(i), slope(bumps.beta(i)), 1e-6) << i;
  }
}

TEST(GaussianProcess, EvidenceHasItsGradient) {
  const Matrix x = draws(2, 30, 1);
  const Vector y = x.row(0).array().sin().transpose().matrix() + 0.1 * draws(30, 1, 2);
  Vector p(4), gradient;
  p << 0.2, 0.5, -0.1, -1.5;
  gp_evidence(x, y, p, &gradient);
  for (Eigen::Index i = 0; i < 4; ++i) {
    Vector above = p, below = p;
    above(i) += 1e-5;
    below(i) -= 1e-5;
    EXPECT_NEAR(gradient(i), (gp_evidence(x, y, above, nullptr) - gp_evidence(x, y, below, nullptr)) / 2e-5, 1e-5) << i;
  }
}

TEST(GaussianProcess, FitsAFunctionAndFewPointsDoNearlyAsWell) {
  const Matrix x = 2.0 * draws(2, 200, 1), fresh = 1.5 * draws(2, 100, 7);
  const auto truth = [](const Matrix& at) { return Matrix(at.row(0).array().sin() + 0.5 * at.row(1).array()); };
  const Matrix y = truth(x) + 0.05 * draws(1, 200, 2);
  GpShape shape;
  fit_shape(x, y, {}, 1, shape);
  EXPECT_NEAR(std::exp(shape.log_noise(0)), 0.05, 0.01);
  GpOptions full, sparse;
  full.most_points = 200;
  sparse.most_points = 40;
  const Bumps all = condition(x, y, shape, full), few = condition(x, y, shape, sparse);
  EXPECT_LE(few.x.cols(), 40);  // fewer where nothing is left to tell
  const Matrix wanted = truth(fresh);
  double error_all = 0, error_few = 0;
  Vector mean, variance;
  for (Eigen::Index i = 0; i < fresh.cols(); ++i) {
    bump_values(all, fresh.col(i), mean, &variance);
    error_all += std::pow(mean(0) - wanted(0, i), 2) / 100;
    EXPECT_GT(variance(0), 0.0);
    bump_values(few, fresh.col(i), mean, &variance);
    error_few += std::pow(mean(0) - wanted(0, i), 2) / 100;
    EXPECT_GT(variance(0), 0.0);
  }
  EXPECT_LT(std::sqrt(error_all), 0.04);  // the noise of a datum is 0.05, the targets' deviation about one
  EXPECT_LT(std::sqrt(error_few), 0.06);
}

TEST(NormalSteps, SinesAndSquashAreThoseOfSamples) {
  Tape tape;
  VarNormal x(3);
  const Vector m = (Vector(3) << 0.3, 2.0, -0.5).finished();
  const Matrix s = covariance(3, 0.8, 4);
  x.mean = VarMatrix(tape, m);
  x.covariance = VarMatrix(tape, s);
  const VarNormal all = with_sines(x, {1, 2});
  const Vector low = Vector::Constant(2, -3.0), high = (Vector(2) << 1.0, 5.0).finished();
  const VarMoments u = squashed(x.mean.part({0, 2}, {0}), x.covariance.part({0, 2}, {0, 2}), low, high);
  constexpr int kSamples = 100000;
  const Matrix root = s.llt().matrixL();
  const Matrix at = (root * draws(3, kSamples, 11)).colwise() + m;
  Matrix z(9, kSamples);
  for (int i = 0; i < kSamples; ++i) {
    const Vector v = at.col(i);
    z.col(i) << v, std::sin(v(1)), std::cos(v(1)), std::sin(v(2)), std::cos(v(2)), squash(v(0), low(0), high(0)),
        squash(v(2), low(1), high(1));
  }
  const Vector mean = z.rowwise().mean();
  const Matrix dz = z.colwise() - mean, sampled = dz * dz.transpose() / kSamples;
  EXPECT_LT((all.mean.values() - mean.head(7)).cwiseAbs().maxCoeff(), 0.012);
  EXPECT_LT((all.covariance.values() - sampled.topLeftCorner(7, 7)).cwiseAbs().maxCoeff(), 0.015);
  EXPECT_LT((u.mean.values() - mean.tail(2)).cwiseAbs().maxCoeff(), 0.04);  // of a deviation of two
  EXPECT_LT((u.covariance.values() - sampled.bottomRightCorner(2, 2)).cwiseAbs().maxCoeff(), 0.08);
  const Matrix across = s(Eigen::all, {0, 2}) * u.gain.values();
  EXPECT_LT((across - sampled.topRightCorner(3, 2)).cwiseAbs().maxCoeff(), 0.04);
}

TEST(NormalSteps, SaturatingCostIsThatOfSamples) {
  Tape tape;
  VarNormal x(2);
  const Vector m = (Vector(2) << 0.5, -0.2).finished(), target = (Vector(2) << 0.0, 0.3).finished();
  const Matrix s = covariance(2, 0.6, 4), weight = covariance(2, 3.0, 6), root = s.llt().matrixL();
  x.mean = VarMatrix(tape, m);
  x.covariance = VarMatrix(tape, s);
  double sum = 0;
  const Matrix at = (root * draws(2, 100000, 12)).colwise() + m;
  for (Eigen::Index i = 0; i < at.cols(); ++i) sum += saturating_cost(at.col(i), target, weight);
  EXPECT_NEAR(saturating_cost(tape, x, target, weight).value, sum / 1e5, 0.005);
}

SearchTask small_task() {
  SearchTask task;
  task.states = 2;
  task.angles = {1};
  task.policy_inputs = {0, 2, 3};
  task.model_inputs = {0, 2, 3};
  task.low = Vector::Constant(1, -2.0);
  task.high = Vector::Constant(1, 1.5);
  task.start_mean = (Vector(2) << 0.1, 0.2).finished();
  task.start_covariance = 0.05 * Matrix::Identity(2, 2);
  task.horizon = 6;
  task.target = Vector::Zero(4);
  task.target(3) = -1.0;
  task.weight = Vector((Vector(4) << 0.1, 0.0, 1.0, 1.0).finished()).asDiagonal();
  return task;
}

void expect_gradient(const SearchTask& task, Trainable& trainable) {
  const Bumps dynamics = process(4, 20);
  Vector p = first_parameters(trainable, Vector::Zero(3), Matrix::Identity(3, 3), Vector::Ones(3), 0.1, 4), gradient;
  for (Eigen::Index i = 0; i < p.size(); ++i) p(i) += 0.1 * std::sin(3.0 * static_cast<double>(i));
  long_term_cost(task, dynamics, trainable, p, &gradient);
  ASSERT_GT(gradient.norm(), 1e-3);
  for (Eigen::Index i = 0; i < p.size(); ++i) {
    Vector above = p, below = p;
    above(i) += 1e-5;
    below(i) -= 1e-5;
    const double slope = (long_term_cost(task, dynamics, trainable, above, nullptr) -
                          long_term_cost(task, dynamics, trainable, below, nullptr)) /
                         2e-5;
    EXPECT_NEAR(gradient(i), slope, 1e-6) << i;
  }
}

TEST(LongTermCost, HasItsGradientForEachPolicy) {
  expect_gradient(small_task(), *make_linear(3, 1));
  expect_gradient(small_task(), *make_rbf(3, 1, 5));
}

TEST(LongTermCost, HasItsGradientOverPhysics) {
  SearchTask task = small_task();
  task.physics = [](const Vector& x, const Vector& u, Vector& next, Matrix& slope) {
    next.resize(2);
    next << x(0) + 0.1 * (u(0) - std::sin(x(1))), x(1) + 0.1 * x(0);
    slope.resize(2, 3);
    slope << 1.0, -0.1 * std::cos(x(1)), 0.1, 0.1, 1.0, 0.0;
  };
  expect_gradient(task, *make_rbf(3, 1, 5));
}

}  // namespace
}  // namespace tiller::tools::policy
