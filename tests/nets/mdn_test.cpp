// The mixture's density against its definition, gradients against differences, and a density that a single normal
// cannot have.

#include "tools/nets/mdn.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "tools/nets/adam.hpp"

namespace tiller::tools::nets {
namespace {

Matrix numbers(int rows, int columns, double shift) {
  Matrix x(rows, columns);
  for (int i = 0; i < x.size(); ++i) x(i) = std::sin(1.7 * i + shift);
  return x;
}

TEST(MixtureHead, DensityIsThatOfItsMixture) {
  const MixtureHead head{3, 2};
  const Matrix output = numbers(head.outputs(), 1, 0.3), target = numbers(3, 1, 1.0);
  const NormalMixture mixture = head.mixture(output.col(0));
  double density = 0.0;
  for (int k = 0; k < 2; ++k) {
    const Matrix& c = mixture.covariance[static_cast<std::size_t>(k)];
    const Vector off = target.col(0) - mixture.mean.col(k);
    density += mixture.weight(k) * std::exp(-0.5 * off.dot(c.inverse() * off)) /
               std::sqrt(std::pow(2.0 * 3.14159265358979323846, 3) * c.determinant());
  }
  EXPECT_NEAR(head.loss(output, target), -std::log(density), 1e-10);
  EXPECT_NEAR(log_density(mixture, target.col(0)), std::log(density), 1e-10);
  EXPECT_NEAR(mixture.weight.sum(), 1.0, 1e-14);
}

TEST(MixtureHead, GradientsAreThoseOfDifferences) {
  for (const MixtureHead head : {MixtureHead{1, 1}, MixtureHead{2, 3}, MixtureHead{3, 2}}) {
    Matrix output = numbers(head.outputs(), 4, 0.1);
    const Matrix target = numbers(head.dimension, 4, 2.0);
    Matrix by;
    head.loss(output, target, &by);
    constexpr double kStep = 1e-6;
    for (Eigen::Index i = 0; i < output.size(); ++i) {
      const double at = output(i);
      output(i) = at + kStep;
      const double above = head.loss(output, target);
      output(i) = at - kStep;
      const double below = head.loss(output, target);
      output(i) = at;
      EXPECT_NEAR(by(i), (above - below) / (2.0 * kStep), 1e-7) << head.dimension << " " << i;
    }
  }
}

// y = +-x: two narrow branches, whose single normal would have a deviation of |x|.
TEST(MixtureHead, LearnsTwoBranches) {
  constexpr int kSamples = 400;
  Matrix x(1, kSamples), y(1, kSamples);
  for (int s = 0; s < kSamples; ++s) {
    x(0, s) = 1.0 + static_cast<double>(s) / kSamples;
    y(0, s) = (s % 2 == 0 ? x(0, s) : -x(0, s)) + 0.05 * std::sin(37.0 * s);
  }
  const MixtureHead head{1, 2};
  Mlp mlp({1, 12, head.outputs()});
  mlp.randomise(3);
  Adam adam;
  adam.rate = 1e-2;
  for (int step = 0; step < 600; ++step) {
    Mlp::Tape tape;
    mlp.forward(x, tape);
    Matrix by;
    head.loss(tape.output(), y, &by);
    Vector gradient = Vector::Zero(mlp.weights.size());
    mlp.backward(tape, by, gradient);
    adam.step(mlp.weights, gradient);
  }
  Matrix at(1, 1);
  at << 1.5;
  const NormalMixture mixture = head.mixture(mlp.evaluate(at).col(0));
  EXPECT_NEAR(mixture.weight(0), 0.5, 0.1);
  EXPECT_NEAR(std::fabs(mixture.mean(0, 0)), 1.5, 0.05);
  EXPECT_NEAR(mixture.mean(0, 0), -mixture.mean(0, 1), 0.1);
  for (const Matrix& c : mixture.covariance) EXPECT_LT(std::sqrt(c(0, 0)), 0.1);
}

// A network far outside of its data says anything: what it says stays a number.
TEST(MixtureHead, StaysFiniteForAnyOutput) {
  const MixtureHead head{2, 2};
  Matrix output = Matrix::Constant(head.outputs(), 1, 800.0), by;
  EXPECT_TRUE(std::isfinite(head.loss(output, Matrix::Zero(2, 1), &by)));
  EXPECT_TRUE(head.mixture(Matrix::Constant(head.outputs(), 1, -800.0).col(0)).covariance[0].allFinite());
}

}  // namespace
}  // namespace tiller::tools::nets
