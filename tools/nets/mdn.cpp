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
Matrix triangle_of(const Places& at, const double* output, int k) {
  Matrix a = Matrix::Zero(at.d, at.d);
  const double* from = output + at.triangle(k);
  for (int i = 0; i < at.d; ++i)
    for (int j = 0; j <= i; ++j, ++from)
      a(i, j) = i == j ? std::exp(std::fmin(std::fmax(*from, -kLargestLog), kLargestLog)) : *from;
  return a;
}

/// Of logits, in place of them: log softmax.
Vector log_softmax(const Vector& logits) {
  const double top = logits.maxCoeff();
  return (logits.array() - top - std::log((logits.array() - top).exp().sum())).matrix();
}

double log_sum(const Vector& logs) {
  const double top = logs.maxCoeff();
  return std::isfinite(top) ? top + std::log((logs.array() - top).exp().sum()) : top;
}

/// Adds the derivatives of one component, `share` its part of the density.
void add_component(const Places& at, int k, double share, const Matrix& a, const Vector& off, const Vector& e,
                   double* by) {
  const Vector pull = a.transpose() * e;
  for (int i = 0; i < at.d; ++i) by[at.mean(k) + i] -= share * pull(i);
  double* to = by + at.triangle(k);
  for (int i = 0; i < at.d; ++i)
    for (int j = 0; j <= i; ++j, ++to) *to += share * (i == j ? e(i) * a(i, i) * off(i) - 1.0 : e(i) * off(j));
}

}  // namespace

double MixtureHead::loss(const Matrix& output, const Matrix& target, Matrix* by_output) const {
  const Places at{dimension, components};
  const auto samples = static_cast<double>(output.cols());
  if (by_output) *by_output = Matrix::Zero(output.rows(), output.cols());
  std::vector<Matrix> a(static_cast<std::size_t>(components));
  std::vector<Vector> off(a.size()), e(a.size());
  double sum = 0.0;
  for (Eigen::Index s = 0; s < output.cols(); ++s) {
    const double* column = output.col(s).data();
    const Vector log_weight = log_softmax(output.col(s).head(components));
    Vector part(components);
    for (int k = 0; k < components; ++k) {
      const auto i = static_cast<std::size_t>(k);
      a[i] = triangle_of(at, column, k);
      off[i] = target.col(s) - output.col(s).segment(at.mean(k), dimension);
      e[i] = a[i] * off[i];
      part(k) =
          log_weight(k) + a[i].diagonal().array().log().sum() - 0.5 * (e[i].squaredNorm() + dimension * kLogTwoPi);
    }
    const double density = log_sum(part);
    sum -= density;
    if (!by_output) continue;
    for (int k = 0; k < components; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const double share = std::exp(part(k) - density) / samples;
      (*by_output)(k, s) = std::exp(log_weight(k)) / samples - share;
      add_component(at, k, share, a[i], off[i], e[i], by_output->col(s).data());
    }
  }
  return sum / samples;
}

NormalMixture MixtureHead::mixture(const Vector& output) const {
  const Places at{dimension, components};
  NormalMixture out{log_softmax(output.head(components)).array().exp().matrix(), Matrix(dimension, components), {}};
  for (int k = 0; k < components; ++k) {
    out.mean.col(k) = output.segment(at.mean(k), dimension);
    const Matrix root =
        triangle_of(at, output.data(), k).triangularView<Eigen::Lower>().solve(Matrix::Identity(dimension, dimension));
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
