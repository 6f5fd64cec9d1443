#include "tools/policy_search/gaussian_process.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/rng.hpp"
#include "tools/policy_search/lbfgs.hpp"

namespace tiller::tools::policy {
namespace {

constexpr std::uint32_t kRngGp = 90;  // purpose of random numbers (core/rng.hpp)

/// Squared exponential kernel between two sets of points, (n x m), signal one.
Matrix correlation(const Matrix& a, const Matrix& b, const Vector& log_length) {
  const Vector inverse = (-log_length.array()).exp().matrix();
  const Matrix sa = inverse.asDiagonal() * a, sb = inverse.asDiagonal() * b;
  Matrix k = sa.transpose() * sb;
  k.colwise() -= Vector(0.5 * sa.colwise().squaredNorm().transpose());
  k.rowwise() -= 0.5 * sb.colwise().squaredNorm();
  return k.array().min(0.0).exp().matrix();
}

double deviation(const Eigen::RowVectorXd& v) {
  return std::max(1e-6, std::sqrt((v.array() - v.mean()).square().mean()));
}

/// ((p - centre) / log bound)^30: nothing inside of the bound, much beyond it.
double fine(double excess, double log_bound, double& slope) {
  const double share = excess / log_bound, power = std::pow(share, 29);
  slope = 30.0 * power / log_bound;
  return power * share;
}

std::vector<Eigen::Index> some_of(Eigen::Index count, Eigen::Index wanted, std::uint64_t seed) {
  std::vector<Eigen::Index> index(static_cast<std::size_t>(count));
  std::iota(index.begin(), index.end(), 0);
  if (count <= wanted) return index;
  Rng rng(seed, kRngGp, static_cast<std::uint64_t>(count));
  for (Eigen::Index i = 0; i < wanted; ++i)
    std::swap(index[static_cast<std::size_t>(i)],
              index[static_cast<std::size_t>(i) + rng.below(static_cast<std::uint32_t>(count - i))]);
  index.resize(static_cast<std::size_t>(wanted));
  std::sort(index.begin(), index.end());
  return index;
}

/// Data points by falling variance given the points before, until nothing is left to tell.
std::vector<Eigen::Index> pivots(const Matrix& x, const GpShape& shape, Eigen::Index wanted) {
  const Eigen::Index n = x.cols(), outputs = shape.log_signal.size();
  std::vector<Eigen::Index> chosen;
  Vector left = Vector::Ones(n);
  Matrix root(n, wanted);
  for (Eigen::Index k = 0; k < wanted; ++k) {
    Eigen::Index next = 0;
    if (left.maxCoeff(&next) < 1e-8) break;
    Vector column = Vector::Zero(n);
    for (Eigen::Index a = 0; a < outputs; ++a)
      column += correlation(x, x.col(next), shape.log_length.col(a)) / static_cast<double>(outputs);
    column -= root.leftCols(k) * root.row(next).head(k).transpose();
    root.col(k) = column / std::sqrt(left(next));
    left -= root.col(k).cwiseAbs2();
    left(next) = 0.0;
    chosen.push_back(next);
  }
  return chosen;
}

struct Weights {
  Vector beta;
  Matrix w;
};

Weights exact_weights(const Matrix& x, const Vector& y, const GpShape& shape, Eigen::Index a) {
  const double signal = std::exp(2.0 * shape.log_signal(a));
  Matrix k = signal * correlation(x, x, shape.log_length.col(a));
  k.diagonal().array() += std::exp(2.0 * shape.log_noise(a)) + 1e-8 * signal;
  const Eigen::LLT<Matrix> factor(k);
  return {factor.solve(y), factor.solve(Matrix::Identity(x.cols(), x.cols()))};
}

/// FITC with inducing points u: with V = L^-1 K_uf, L L' = K_uu, and the diagonal D of what u leaves of the variance
/// plus the noise, B = I + V D^-1 V', beta = L^-T B^-1 V D^-1 y and W = L^-T (I - B^-1) L^-1.
Weights sparse_weights(const Matrix& u, const Matrix& x, const Vector& y, const GpShape& shape, Eigen::Index a) {
  const double signal = std::exp(2.0 * shape.log_signal(a));
  Matrix k = signal * correlation(u, u, shape.log_length.col(a));
  k.diagonal().array() += 1e-6 * signal;
  const Eigen::LLT<Matrix> factor(k);
  Matrix v = signal * correlation(u, x, shape.log_length.col(a));
  factor.matrixL().solveInPlace(v);
  const Vector d =
      (signal - v.colwise().squaredNorm().array()).max(0.0) + std::exp(2.0 * shape.log_noise(a)) + 1e-8 * signal;
  const Matrix scaled = v * d.cwiseInverse().asDiagonal();
  const Matrix identity = Matrix::Identity(u.cols(), u.cols());
  const Eigen::LLT<Matrix> b(identity + scaled * v.transpose());
  Matrix middle = identity - b.solve(identity);
  factor.matrixU().solveInPlace(middle);
  middle.transposeInPlace();
  factor.matrixU().solveInPlace(middle);
  Vector beta = b.solve(scaled * y);
  factor.matrixU().solveInPlace(beta);
  return {beta, 0.5 * (middle + middle.transpose())};
}

}  // namespace

double gp_evidence(const Matrix& x, const Vector& y, const Vector& p, Vector* gradient) {
  const Eigen::Index inputs = x.rows(), n = x.cols();
  const double signal = std::exp(2.0 * p(inputs)), noise = std::exp(2.0 * p(inputs + 1));
  const Matrix k = signal * correlation(x, x, p.head(inputs));
  Matrix sum = k;
  sum.diagonal().array() += noise + 1e-8 * signal;
  const Eigen::LLT<Matrix> factor(sum);
  if (factor.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Vector alpha = factor.solve(y);
  const double value = 0.5 * y.dot(alpha) + factor.matrixLLT().diagonal().array().log().sum() +
                       0.5 * static_cast<double>(n) * std::log(6.283185307179586);
  if (!gradient) return value;
  Matrix q = factor.solve(Matrix::Identity(n, n));
  q.noalias() -= alpha * alpha.transpose();  // twice the derivative with respect to the kernel matrix
  const Matrix h = q.cwiseProduct(k);
  const Vector row = h.rowwise().sum();
  gradient->resize(inputs + 2);
  for (Eigen::Index d = 0; d < inputs; ++d) {
    const Vector at = x.row(d).transpose();
    (*gradient)(d) = (row.dot(at.cwiseAbs2()) - at.dot(h * at)) * std::exp(-2.0 * p(d));
  }
  (*gradient)(inputs) = row.sum() + 1e-8 * signal * q.trace();
  (*gradient)(inputs + 1) = noise * q.trace();
  return value;
}

void fit_shape(const Matrix& x, const Matrix& y, const GpOptions& options, std::uint64_t seed, GpShape& shape) {
  const Eigen::Index inputs = x.rows(), outputs = y.rows();
  const std::vector<Eigen::Index> part = some_of(x.cols(), options.most_fitted, seed);
  Matrix px(inputs, static_cast<Eigen::Index>(part.size())), py(outputs, px.cols());
  for (std::size_t i = 0; i < part.size(); ++i) {
    px.col(static_cast<Eigen::Index>(i)) = x.col(part[i]);
    py.col(static_cast<Eigen::Index>(i)) = y.col(part[i]);
  }
  Vector log_spread(inputs);
  for (Eigen::Index d = 0; d < inputs; ++d) log_spread(d) = std::log(deviation(x.row(d)));
  if (shape.empty()) {
    shape.log_length = log_spread.replicate(1, outputs);
    shape.log_signal = shape.log_noise = Vector(outputs);
    for (Eigen::Index a = 0; a < outputs; ++a) shape.log_signal(a) = std::log(deviation(y.row(a)));
    shape.log_noise = shape.log_signal.array() - std::log(10.0);
  }
  for (Eigen::Index a = 0; a < outputs; ++a) {
    Vector p(inputs + 2);
    p << shape.log_length.col(a), shape.log_signal(a), shape.log_noise(a);
    const Vector target = py.row(a).transpose();
    const Objective objective = [&](const Vector& at, Vector& gradient) {
      double value = gp_evidence(px, target, at, &gradient), slope = 0;
      for (Eigen::Index d = 0; d < inputs; ++d) {
        value += fine(at(d) - log_spread(d), std::log(100.0), slope);
        gradient(d) += slope;
      }
      value += fine(at(inputs) - at(inputs + 1), std::log(options.most_ratio), slope);
      gradient(inputs) += slope;
      gradient(inputs + 1) -= slope;
      return value;
    };
    LbfgsOptions how;
    how.evaluations = options.evaluations;
    how.decrease = 1e-6;
    how.gradient = 1e-3;
    minimise(objective, p, how);
    shape.log_length.col(a) = p.head(inputs);
    shape.log_signal(a) = p(inputs);
    shape.log_noise(a) = p(inputs + 1);
  }
}

Bumps condition(const Matrix& x, const Matrix& y, const GpShape& shape, const GpOptions& options) {
  Bumps out;
  const bool exact = x.cols() <= options.most_points;
  out.x = x;
  if (!exact) {
    const std::vector<Eigen::Index> chosen = pivots(x, shape, options.most_points);
    out.x.resize(x.rows(), static_cast<Eigen::Index>(chosen.size()));
    for (std::size_t i = 0; i < chosen.size(); ++i) out.x.col(static_cast<Eigen::Index>(i)) = x.col(chosen[i]);
  }
  out.log_length = shape.log_length;
  out.log_signal = shape.log_signal;
  out.beta.resize(out.x.cols(), y.rows());
  for (Eigen::Index a = 0; a < y.rows(); ++a) {
    const Vector target = y.row(a).transpose();
    Weights weights = exact ? exact_weights(x, target, shape, a) : sparse_weights(out.x, x, target, shape, a);
    out.beta.col(a) = weights.beta;
    out.w.push_back(std::move(weights.w));
  }
  return out;
}

}  // namespace tiller::tools::policy
