// Backpropagation through time against differences, a step by hand, and sequences that only a memory can tell apart.

#include "tools/nets/gru.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tools/nets/adam.hpp"

namespace tiller::tools::nets {
namespace {

std::vector<Matrix> sequence(int steps, int inputs, int samples) {
  std::vector<Matrix> all;
  for (int t = 0; t < steps; ++t) {
    Matrix x(inputs, samples);
    for (int i = 0; i < inputs; ++i)
      for (int s = 0; s < samples; ++s) x(i, s) = std::sin(1.3 * t + 0.7 * i + 0.9 * s + 0.2 * t * s);
    all.push_back(x);
  }
  return all;
}

TEST(Gru, GradientsAreThoseOfDifferences) {
  Gru gru(2, 3);
  gru.randomise(4);
  gru.weights.array() += 0.05;  // biases that matter
  const auto x = sequence(6, 2, 5);
  Gru::Tape tape;
  gru.forward(x, tape);
  Matrix pull(gru.outputs(), 5);
  for (int i = 0; i < pull.size(); ++i) pull(i) = std::cos(0.8 * i);
  Vector gradient = Vector::Zero(gru.weights.size());
  gru.backward(tape, pull, gradient);
  const auto scalar = [&](const Gru& moved) {
    Gru::Tape t;
    moved.forward(x, t);
    return t.output.cwiseProduct(pull).sum();
  };
  constexpr double kStep = 1e-6;
  for (Eigen::Index i = 0; i < gradient.size(); ++i) {
    Gru above = gru, below = gru;
    above.weights(i) += kStep;
    below.weights(i) -= kStep;
    EXPECT_NEAR(gradient(i), (scalar(above) - scalar(below)) / (2.0 * kStep), 1e-7) << i;
  }
}

TEST(Gru, AStepIsThatOfItsEquations) {
  Gru gru(1, 1);
  gru.weights << 0.1, 0.2, 0.3, -0.1, 0.4, 0.5, 0.2, -0.6, 0.7;  // z, r, n: bias, input, state
  Matrix x(1, 1);
  const auto s = [](double a) { return 1.0 / (1.0 + std::exp(-a)); };
  double h = 0.0;
  std::vector<Matrix> all;
  for (const double value : {0.9, -0.4}) {
    x << value;
    all.push_back(x);
    const double z = s(0.1 + 0.2 * value + 0.3 * h), r = s(-0.1 + 0.4 * value + 0.5 * h);
    const double n = std::tanh(0.2 - 0.6 * value + 0.7 * r * h);
    h = (1.0 - z) * n + z * h;
  }
  Gru::Tape tape;
  gru.forward(all, tape);
  EXPECT_NEAR(tape.output(0, 0), h, 1e-15);
  EXPECT_NEAR(tape.output(1, 0), 0.5 * (h + tape.h[1](0, 0)), 1e-15);
}

// The answer is the first input, the rest is noise: without a memory the error stays at one.
TEST(Gru, LearnsToKeepWhatCameFirst) {
  constexpr int kSteps = 12, kSamples = 64;
  auto x = sequence(kSteps, 2, kSamples);
  Matrix y(1, kSamples);
  for (int s = 0; s < kSamples; ++s) y(0, s) = s % 2 == 0 ? 1.0 : -1.0;
  for (int t = 0; t < kSteps; ++t) x[static_cast<std::size_t>(t)].row(1).setZero();
  x[0].row(1) = y;
  Gru gru(2, 6);
  gru.randomise(1);
  Mlp read({gru.outputs(), 1});
  read.randomise(2);
  Adam for_gru, for_read;
  for_gru.rate = for_read.rate = 1e-2;
  double error = 0.0;
  for (int step = 0; step < 300; ++step) {
    Gru::Tape tape;
    Mlp::Tape top;
    gru.forward(x, tape);
    read.forward(tape.output, top);
    const Matrix off = top.output() - y;
    error = off.squaredNorm() / kSamples;
    Vector by_gru = Vector::Zero(gru.weights.size()), by_read = Vector::Zero(read.weights.size());
    Matrix by_summary;
    read.backward(top, off / kSamples, by_read, &by_summary);
    gru.backward(tape, by_summary, by_gru);
    for_gru.step(gru.weights, by_gru);
    for_read.step(read.weights, by_read);
  }
  EXPECT_LT(error, 0.02);
}

}  // namespace
}  // namespace tiller::tools::nets
