// Gradients against differences, scales that fold into the weights, and a regression that must succeed.

#include "tools/nets/mlp.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tools/nets/adam.hpp"
#include "tools/nets/standardise.hpp"

namespace tiller::tools::nets {
namespace {

Matrix points(int rows, int columns) {
  Matrix x(rows, columns);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) x(i, j) = std::sin(1.7 * i + 0.9 * j + 0.3 * i * j);
  return x;
}

double half_squares(const Mlp& mlp, const Matrix& x, const Matrix& y) {
  return 0.5 * (mlp.evaluate(x) - y).squaredNorm();
}

TEST(Mlp, GradientsAreThoseOfDifferences) {
  Mlp mlp({3, 5, 4, 2});
  mlp.randomise(1);
  const Matrix y = points(2, 7);
  Matrix x = points(3, 7);
  Mlp::Tape tape;
  mlp.forward(x, tape);
  Vector gradient = Vector::Zero(mlp.weights.size());
  Matrix by_input;
  mlp.backward(tape, tape.output() - y, gradient, &by_input);
  constexpr double kStep = 1e-6;
  for (Eigen::Index i = 0; i < gradient.size(); ++i) {
    Mlp moved = mlp;
    moved.weights(i) += kStep;
    const double above = half_squares(moved, x, y);
    moved.weights(i) -= 2.0 * kStep;
    EXPECT_NEAR(gradient(i), (above - half_squares(moved, x, y)) / (2.0 * kStep), 1e-7) << i;
  }
  for (int i = 0; i < x.size(); ++i) {
    const double at = x(i);
    x(i) = at + kStep;
    const double above = half_squares(mlp, x, y);
    x(i) = at - kStep;
    const double below = half_squares(mlp, x, y);
    x(i) = at;
    EXPECT_NEAR(by_input(i), (above - below) / (2.0 * kStep), 1e-7) << i;
  }
}

TEST(Mlp, ScalesFoldIntoTheWeights) {
  Mlp mlp({3, 6, 2});
  mlp.randomise(2);
  const Matrix x = (3.0 * points(3, 9).array() + 5.0).matrix(), y = (0.1 * points(2, 9).array() - 4.0).matrix();
  const Standardiser in = Standardiser::of(x), out = Standardiser::of(y);
  const Matrix scaled = out.revert(mlp.evaluate(in.apply(x)));
  Mlp folded = mlp;
  absorb_input_scale(folded, in.mean, in.sd);
  absorb_output_scale(folded, out.mean, out.sd);
  EXPECT_LT((folded.evaluate(x) - scaled).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Mlp, LearnsAFunctionThatNoLineFits) {
  const int samples = 200;
  Matrix x(1, samples), y(1, samples);
  for (int i = 0; i < samples; ++i) {
    x(0, i) = -2.0 + 4.0 * i / (samples - 1);
    y(0, i) = std::sin(3.0 * x(0, i));
  }
  Mlp mlp({1, 16, 16, 1});
  mlp.randomise(3);
  Adam adam;
  adam.rate = 1e-2;
  for (int step = 0; step < 2000; ++step) {
    Mlp::Tape tape;
    mlp.forward(x, tape);
    Vector gradient = Vector::Zero(mlp.weights.size());
    mlp.backward(tape, (tape.output() - y) / samples, gradient);
    adam.step(mlp.weights, gradient);
  }
  // the sine's own root mean square is 0.7, and a line leaves 0.65 of it
  EXPECT_LT(std::sqrt((mlp.evaluate(x) - y).squaredNorm() / samples), 0.02);
}

TEST(Mlp, TheFirstStepOfAdamIsItsRate) {
  Vector weights = Vector::Zero(2), gradient(2);
  gradient << 3.0, -1e-3;
  Adam adam;
  adam.step(weights, gradient);
  EXPECT_NEAR(weights(0), -1e-3, 1e-9);
  EXPECT_NEAR(weights(1), 1e-3, 1e-7);  // whatever the gradient's size
}

TEST(Standardiser, KeepsARowThatIsConstant) {
  Matrix x(2, 3);
  x << 1, 2, 3, 4, 4, 4;
  const Standardiser s = Standardiser::of(x);
  EXPECT_EQ(s.sd(1), 1.0);
  EXPECT_LT((s.revert(s.apply(x)) - x).cwiseAbs().maxCoeff(), 1e-15);
}

}  // namespace
}  // namespace tiller::tools::nets
