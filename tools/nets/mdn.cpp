#include "tools/nets/mdn.hpp"

#include <Eigen/Cholesky>
#include <cmath>

namespace tiller::tools::nets {
namespace {

constexpr double kLogTwoPi = 1.8378770664093453;
/// Logarithms of the triangle's diagonal are kept within this: a network far from its data overflows nothing.
constexpr double kLargestLog = 20.0;

/// Where component k's numbers stand in a column of outputs.
struct Places {
  int d, components;
  int triangle_size() const { return d * (d + 1) / 2; }
  Eigen::Index mean(int k) const { return components + k * d; }
  Eigen::Index triangle(int k) const { return components * (1 + d) + k * triangle_size(); }
};

/// A: exponentials on the diagonal.
void read_triangle(const Places& at, const double* output, int k, Matrix& a) {
  a.setZero(at.d, at.d);
  const double* from = output + at.triangle(k);
  for (int i = 0; i < at.d; ++i)
    for (int j = 0; j <= i; ++j, ++from)
      a(i, j) = i == j ? std::exp(std::fmin(std::fmax(*from, -kLargestLog), kLargestLog)) : *from;
}

/// A component at one target; kept from sample to sample, so that nothing is allocated in between.
struct Component {
  Matrix a;
  Vector off, e, pull;
  /// log density
  double read(const Places& at, const Eigen::Ref<const Vector>& output, const Eigen::Ref<const Vector>& target, int k) {
    read_triangle(at, output.data(), k, a);
    off = target - output.segment(at.mean(k), at.d);
    e.noalias() = a.lazyProduct(off);
    double log_root = 0.0;
    for (int i = 0; i < at.d; ++i) log_root += std::log(a(i, i));
    return log_root - 0.5 * (e.squaredNorm() + at.d * kLogTwoPi);
  }
  /// Adds its derivatives, `share` its part of the density.
  void add(const Places& at, int k, double share, double* by) {
    pull.noalias() = a.transpose().lazyProduct(e);
    for (int i = 0; i < at.d; ++i) by[at.mean(k) + i] -= share * pull(i);
    double* to = by + at.triangle(k);
    for (int i = 0; i < at.d; ++i)
      for (int j = 0; j <= i; ++j, ++to) *to += share * (i == j ? e(i) * a(i, i) * off(i) - 1.0 : e(i) * off(j));
  }
};

/// Of logits, in place of them: log softmax.
Vector log_softmax(const Vector& logits) {
  const double top = logits.maxCoeff();
  return (logits.array() - top - std::log((logits.array() - top).exp().sum())).matrix();
}

double log_sum(const Vector& logs) {
  const double top = logs.maxCoeff();
  return std::isfinite(top) ? top + std::log((logs.array() - top).exp().sum()) : top;
}

}  // namespace

double MixtureHead::loss(const Matrix& output, const Matrix& target, Matrix* by_output) const {
  const Places at{dimension, components};
  const auto samples = static_cast<double>(output.cols());
  if (by_output) *by_output = Matrix::Zero(output.rows(), output.cols());
  std::vector<Component> all(static_cast<std::size_t>(components));
  Vector log_weight, part(components);
  double sum = 0.0;
  for (Eigen::Index s = 0; s < output.cols(); ++s) {
    log_weight = log_softmax(output.col(s).head(components));
    for (int k = 0; k < components; ++k)
      part(k) = log_weight(k) + all[static_cast<std::size_t>(k)].read(at, output.col(s), target.col(s), k);
    const double density = log_sum(part);
    sum -= density;
    for (int k = 0; by_output && k < components; ++k) {
      const double share = std::exp(part(k) - density) / samples;
      (*by_output)(k, s) = std::exp(log_weight(k)) / samples - share;
      all[static_cast<std::size_t>(k)].add(at, k, share, by_output->col(s).data());
    }
  }
  return sum / samples;
}

NormalMixture MixtureHead::mixture(const Vector& output) const {
  const Places at{dimension, components};
  NormalMixture out{log_softmax(output.head(components)).array().exp().matrix(), Matrix(dimension, components), {}};
  for (int k = 0; k < components; ++k) {
    out.mean.col(k) = output.segment(at.mean(k), dimension);
    Matrix a;
    read_triangle(at, output.data(), k, a);
    const Matrix root = a.triangularView<Eigen::Lower>().solve(Matrix::Identity(dimension, dimension));
    out.covariance.push_back(root * root.transpose());
  }
  return out;
}

double log_density(const NormalMixture& mixture, const Vector& at) {
  Vector part(mixture.weight.size());
  for (Eigen::Index k = 0; k < part.size(); ++k) {
    const Eigen::LLT<Matrix> root(mixture.covariance[static_cast<std::size_t>(k)]);
    const Vector e = root.matrixL().solve(at - mixture.mean.col(k));
    part(k) = std::log(mixture.weight(k)) - root.matrixLLT().diagonal().array().log().sum() -
              0.5 * (e.squaredNorm() + static_cast<double>(at.size()) * kLogTwoPi);
  }
  return log_sum(part);
}

}  // namespace tiller::tools::nets
