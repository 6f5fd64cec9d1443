#include "tools/policy_search/normal_steps.hpp"

#include <Eigen/LU>
#include <cmath>

namespace tiller::tools::policy {
namespace {

/// E[cos(a + sign b + phase)] with (a, b) normal.
Var mean_cosine(const VarMatrix& mean, const VarMatrix& s, int i, int k, double sign, double phase) {
  const Var variance = s(i, i) + s(k, k) + (2.0 * sign) * s(i, k);
  return exp(-0.5 * variance) * cos(mean(i) + sign * mean(k) + phase);
}

constexpr double kQuarter = 1.5707963267948966;

/// E[sin(a + p) sin(b + q)] as half the difference of E cos(a - b + p - q) and E cos(a + b + p + q). Within one angle
/// too.
Var mean_of_sines(const VarMatrix& mean, const VarMatrix& s, int i, double p, int k, double q) {
  return 0.5 * (mean_cosine(mean, s, i, k, -1.0, p - q) - mean_cosine(mean, s, i, k, 1.0, p + q));
}

}  // namespace

VarNormal with_sines(const VarNormal& x, const std::vector<int>& angles) {
  const int n = x.size(), count = static_cast<int>(angles.size());
  VarNormal out(n + 2 * count);
  for (int i = 0; i < n; ++i) {
    out.mean(i) = x.mean(i);
    for (int j = 0; j < n; ++j) out.covariance(i, j) = x.covariance(i, j);
  }
  for (int k = 0; k < 2 * count; ++k) {  // even: sine, odd: cosine, of angle k / 2
    const int angle = angles[static_cast<std::size_t>(k / 2)];
    const Var shrink = exp(-0.5 * x.covariance(angle, angle));
    const Var sine = shrink * sin(x.mean(angle)), cosine = shrink * cos(x.mean(angle));
    out.mean(n + k) = k % 2 == 0 ? sine : cosine;
    const Var slope = k % 2 == 0 ? cosine : -sine;
    for (int j = 0; j < n; ++j) out.covariance(j, n + k) = out.covariance(n + k, j) = x.covariance(j, angle) * slope;
  }
  for (int k = 0; k < 2 * count; ++k)
    for (int l = 0; l <= k; ++l) {
      const Var product =
          mean_of_sines(x.mean, x.covariance, angles[static_cast<std::size_t>(k / 2)], k % 2 ? kQuarter : 0.0,
                        angles[static_cast<std::size_t>(l / 2)], l % 2 ? kQuarter : 0.0);
      out.covariance(n + k, n + l) = out.covariance(n + l, n + k) = product - out.mean(n + k) * out.mean(n + l);
    }
  return out;
}

double squash(double v, double low, double high) {
  return 0.5 * (low + high) + 0.5 * (high - low) * (9.0 * std::sin(v) + std::sin(3.0 * v)) / 8.0;
}

VarMoments squashed(const VarMatrix& mean, const VarMatrix& covariance, const Vector& low, const Vector& high) {
  const int n = mean.rows();
  // v and 3 v side by side: the sines of all
  VarMatrix m(2 * n, 1), s(2 * n, 2 * n);
  for (int i = 0; i < 2 * n; ++i) {
    const double gi = i < n ? 1.0 : 3.0;
    m(i) = gi * mean(i % n);
    for (int j = 0; j < 2 * n; ++j) s(i, j) = (gi * (j < n ? 1.0 : 3.0)) * covariance(i % n, j % n);
  }
  VarMatrix sine(2 * n, 1), cosine(2 * n, 1);
  for (int i = 0; i < 2 * n; ++i) {
    const Var shrink = exp(-0.5 * s(i, i));
    sine(i) = shrink * sin(m(i));
    cosine(i) = shrink * cos(m(i));
  }
  VarMoments out{VarMatrix(n, 1), VarMatrix(n, n), VarMatrix(n, n)};
  const auto share = [&](int i, int part) { return (part == 0 ? 9.0 : 1.0) * (high(i) - low(i)) / 16.0; };
  for (int i = 0; i < n; ++i) {
    out.mean(i) = 0.5 * (low(i) + high(i)) + share(i, 0) * sine(i) + share(i, 1) * sine(n + i);
    out.gain(i, i) = share(i, 0) * cosine(i) + (3.0 * share(i, 1)) * cosine(n + i);
    for (int j = 0; j <= i; ++j) {
      Var sum;
      for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b)
          sum += (share(i, a) * share(j, b)) *
                 (mean_of_sines(m, s, a * n + i, 0.0, b * n + j, 0.0) - sine(a * n + i) * sine(b * n + j));
      out.covariance(i, j) = out.covariance(j, i) = sum;
    }
  }
  return out;
}

double saturating_cost(const Vector& z, const Vector& target, const Matrix& weight) {
  const Vector d = z - target;
  return 1.0 - std::exp(-0.5 * d.dot(weight * d));
}

Var saturating_cost(Tape& tape, const VarNormal& z, const Vector& target, const Matrix& weight) {
  const Matrix s = z.covariance.values();
  const Eigen::PartialPivLU<Matrix> lu(Matrix::Identity(s.rows(), s.cols()) + s * weight);
  const Matrix inner = weight * lu.inverse();
  const Vector pull = inner * (z.mean.values() - target);
  const double likelihood = std::exp(-0.5 * pull.dot(z.mean.values().col(0) - target)) / std::sqrt(lu.determinant());
  const Var cost = tape.variable(1.0 - likelihood);
  tape.defer(cost, [&tape, z, cost, inner, pull, likelihood] {
    const double by = tape.derivative(cost);
    z.mean.add_to(tape, by * likelihood * pull);
    z.covariance.add_to(tape, 0.5 * by * likelihood * (inner - pull * pull.transpose()));
  });
  return cost;
}

VarMoments taped_bumps(Tape& tape, const Bumps& bumps, const VarNormal& input, BumpsDerivative* derivative) {
  const Vector m = input.mean.values();
  const Matrix s = input.covariance.values();
  const Moments moments = bump_moments(bumps, m, s);
  const VarMoments out{VarMatrix(tape, moments.mean), VarMatrix(tape, moments.covariance),
                       VarMatrix(tape, moments.gain)};
  tape.defer(out.mean(0), [&tape, &bumps, derivative, input, out, m, s] {
    const Moments by{out.mean.derivatives(tape), out.covariance.derivatives(tape), out.gain.derivatives(tape)};
    const InputDerivative back = bump_adjoint(bumps, m, s, by, derivative);
    input.mean.add_to(tape, back.mean);
    input.covariance.add_to(tape, back.covariance);
  });
  return out;
}

}  // namespace tiller::tools::policy
