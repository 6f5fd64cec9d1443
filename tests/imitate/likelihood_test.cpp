// The likelihood of demonstrated inputs: against dense algebra on a linear system, its slopes against differences, and
// inputs at limits as one-sided evidence.

#include "tools/imitate/likelihood.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

namespace tiller::tools::imitate {
namespace {

double wave(int i) { return std::sin(1.3 * i + 0.2 * i * i); }

void put(std::vector<SparseQuadratic::Entry>& list, int row, int column, double value) {
  list.push_back({static_cast<std::uint16_t>(row), static_cast<std::uint16_t>(column), value});
}

/// A motion of a linear system with two inputs: costs are 1/2 h z^2 + g z for each entry of z = (x, u).
Expansion linear_motion(Eigen::Index steps) {
  Expansion e;
  e.n = 3;
  e.nu = 2;
  e.steps = steps;
  e.defect = Matrix::Zero(3, steps);
  e.stage.resize(4);
  e.terminal.resize(4);
  for (Eigen::Index k = 0; k < steps; ++k) {
    Matrix f(3, 5);
    for (int i = 0; i < 15; ++i) f(i) = 0.6 * wave(i + 3 * static_cast<int>(k));
    e.f.push_back(f);
    e.at_limit.push_back({0, 0});
    for (int g = 0; g < 4; ++g) {
      SparseQuadratic q;
      const int at = g == 0 ? 3 : g == 1 ? 4 : g - 2;  // an input each, a state each
      put(q.gradient, at, 0, wave(7 * g + static_cast<int>(k)));
      put(q.hessian, at, at, 1.5 + wave(g));
      e.stage[static_cast<std::size_t>(g)].push_back(q);
    }
  }
  for (int g = 0; g < 4; ++g) e.terminal[static_cast<std::size_t>(g)].resize(static_cast<std::size_t>(steps) + 1);
  put(e.terminal[3].back().gradient, 2, 0, 0.7);
  put(e.terminal[3].back().hessian, 2, 2, 3.0);
  return e;
}

/// Levine and Koltun's equation 5 with gradient and Hessian by all inputs at once.
double dense(const Expansion& e, const Vector& w) {
  const Eigen::Index all = e.nu * e.steps;
  Matrix x = Matrix::Zero(e.n, all), hessian = Matrix::Zero(all, all);  // x: state by all inputs
  Vector gradient = Vector::Zero(all);
  const auto add = [&](const std::vector<std::vector<SparseQuadratic>>& features, Eigen::Index k, const Matrix& z) {
    Vector g = Vector::Zero(e.n + e.nu);
    Matrix h = Matrix::Zero(e.n + e.nu, e.n + e.nu);
    for (std::size_t i = 0; i < e.groups(); ++i)
      features[i][static_cast<std::size_t>(k)].add(w(static_cast<Eigen::Index>(i)), g, h);
    gradient += z.transpose() * g.head(z.rows());
    hessian += z.transpose() * h.topLeftCorner(z.rows(), z.rows()) * z;
  };
  for (Eigen::Index k = 0; k < e.steps; ++k) {
    Matrix z = Matrix::Zero(e.n + e.nu, all);
    z.topRows(e.n) = x;
    for (Eigen::Index i = 0; i < e.nu; ++i) z(e.n + i, k * e.nu + i) = 1;
    add(e.stage, k, z);
    x = e.f[static_cast<std::size_t>(k)] * z;
  }
  add(e.terminal, e.steps, x);
  return 0.5 * std::log(hessian.determinant()) - 0.5 * gradient.dot(hessian.inverse() * gradient) -
         0.5 * static_cast<double>(all) * std::log(2 * 3.14159265358979323846);
}

Likelihood at(const Expansion& e, const Vector& w, const Foresight& foresight = {}) {
  Likelihood sum;
  sum.gradient = Vector::Zero(w.size());
  sum.information = Matrix::Zero(w.size(), w.size());
  add_likelihood(e, w, foresight, sum);
  return sum;
}

void expect_slopes(const Expansion& e, const Foresight& foresight) {
  const Vector log_w = (Vector(4) << 0.3, -0.5, 0.2, 0.9).finished();
  const Likelihood sum = at(e, log_w.array().exp(), foresight);
  ASSERT_TRUE(sum.good);
  constexpr double kStep = 1e-5;
  for (int g = 0; g < 4; ++g) {
    Vector up = log_w, down = log_w;
    up(g) += kStep;
    down(g) -= kStep;
    const double slope =
        (at(e, up.array().exp(), foresight).value - at(e, down.array().exp(), foresight).value) / (2 * kStep);
    EXPECT_NEAR(sum.gradient(g), slope, 1e-6 * (1 + std::fabs(slope))) << g;
  }
  EXPECT_GE(Eigen::FullPivLU<Matrix>(sum.information).determinant(), 0);
}

TEST(Likelihood, IsThatOfAllInputsAtOnce) {
  const Expansion e = linear_motion(6);
  const Vector w = (Vector(4) << 1.2, 0.4, 2.0, 0.7).finished();
  const Likelihood sum = at(e, w);
  EXPECT_EQ(sum.inputs, 12);
  EXPECT_NEAR(sum.value, dense(e, w), 1e-9);  // both in double, a few dozen sums
}

TEST(Likelihood, SlopesAreThoseOfDifferences) { expect_slopes(linear_motion(7), {}); }

TEST(Likelihood, OfARecedingHorizonToo) {
  Expansion e = linear_motion(9);
  e.terminal[3].assign(10, e.terminal[3].back());
  expect_slopes(e, {4, 2});
  EXPECT_EQ(at(e, Vector::Ones(4), {4, 2}).inputs, 2 * 3);  // those of periods 0, 2 and 4: 5 + 4 is the end
}

TEST(Likelihood, DefectsCount) {
  Expansion e = linear_motion(7);
  for (int k = 0; k < 7; ++k) e.defect(k % 3, k) = 0.3 * wave(k);
  expect_slopes(e, {});
  EXPECT_GT(std::fabs(at(e, Vector::Ones(4)).value - at(linear_motion(7), Vector::Ones(4)).value), 1e-3);
}

TEST(Likelihood, LimitsAreOneSided) {
  Expansion e = linear_motion(7);
  e.at_limit[2] = {1, 0};
  e.at_limit[4] = {-1, 1};
  expect_slopes(e, {});
  const Likelihood sum = at(e, Vector::Ones(4));
  EXPECT_EQ(sum.inputs, 11);
  EXPECT_EQ(sum.limited, 3);
}

TEST(Likelihood, PressingAgainstALimitHarderIsNoEvidence) {
  Expansion e = linear_motion(1);
  e.terminal[3].back() = {};
  e.at_limit[0] = {1, 0};
  double before = -1e9;
  for (const double slope : {3.0, 0.0, -3.0, -30.0, -300.0}) {  // downhill beyond the limit, ever steeper
    e.stage[0][0].gradient[0].value = slope;
    const double now = at(e, Vector::Ones(4)).value;
    EXPECT_GE(now, before) << slope;
    if (slope == -300.0) {
      EXPECT_NEAR(now, before, 1e-6);
    }
    before = now;
  }
}

}  // namespace
}  // namespace tiller::tools::imitate
