#include "tools/nets/mlp.hpp"

#include <cmath>
#include <random>

namespace tiller::tools::nets {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A layer's rows: bias, then weights.
Eigen::Map<const RowMajor> layer(const Vector& weights, Eigen::Index at, int outputs, int inputs) {
  return {weights.data() + at, outputs, inputs + 1};
}
Eigen::Map<RowMajor> layer(Vector& weights, Eigen::Index at, int outputs, int inputs) {
  return {weights.data() + at, outputs, inputs + 1};
}

}  // namespace

Eigen::Index Mlp::count(const std::vector<int>& widths) {
  Eigen::Index count = 0;
  for (std::size_t l = 1; l < widths.size(); ++l) count += Eigen::Index{widths[l]} * (widths[l - 1] + 1);
  return count;
}

Mlp::Mlp(std::vector<int> widths) : weights(Vector::Zero(count(widths))), widths_(std::move(widths)) {}

void Mlp::randomise(std::uint64_t seed, double last_gain) {
  std::mt19937_64 random(seed);
  Eigen::Index at = 0;
  for (std::size_t l = 1; l < widths_.size(); ++l) {
    auto w = layer(weights, at, widths_[l], widths_[l - 1]);
    const double reach = std::sqrt(6.0 / (widths_[l] + widths_[l - 1])) * (l + 1 == widths_.size() ? last_gain : 1.0);
    for (Eigen::Index i = 0; i < w.rows(); ++i) {
      w(i, 0) = 0.0;
      // 53 random bits by hand: the library's distributions differ between implementations
      for (Eigen::Index j = 1; j < w.cols(); ++j)
        w(i, j) = reach * (2.0 * (static_cast<double>(random() >> 11) * 0x1p-53) - 1.0);
    }
    at += w.size();
  }
}

void Mlp::forward(const Matrix& x, Tape& tape) const {
  tape.layers.resize(widths_.size());
  tape.layers[0] = x;
  Eigen::Index at = 0;
  for (std::size_t l = 1; l < widths_.size(); ++l) {
    const auto w = layer(weights, at, widths_[l], widths_[l - 1]);
    Matrix& y = tape.layers[l];
    y.noalias() = w.rightCols(widths_[l - 1]) * tape.layers[l - 1];
    y.colwise() += Vector(w.col(0));
    if (l + 1 < widths_.size()) y = y.array().tanh().matrix();
    at += w.size();
  }
}

Matrix Mlp::evaluate(const Matrix& x) const {
  Tape tape;
  forward(x, tape);
  return std::move(tape.layers.back());
}

void Mlp::backward(const Tape& tape, const Matrix& by_output, Vector& gradient, Matrix* by_input) const {
  Matrix d = by_output;  // with respect to a layer before its activation
  Eigen::Index at = weights.size();
  for (std::size_t l = widths_.size() - 1; l > 0; --l) {
    at -= Eigen::Index{widths_[l]} * (widths_[l - 1] + 1);
    auto g = layer(gradient, at, widths_[l], widths_[l - 1]);
    g.col(0) += d.rowwise().sum();
    g.rightCols(widths_[l - 1]).noalias() += d * tape.layers[l - 1].transpose();
    if (l == 1 && !by_input) return;
    Matrix before = layer(weights, at, widths_[l], widths_[l - 1]).rightCols(widths_[l - 1]).transpose() * d;
    if (l == 1) {
      *by_input = std::move(before);
      return;
    }
    d = (before.array() * (1.0 - tape.layers[l - 1].array().square())).matrix();
  }
}

void absorb_input_scale(Mlp& mlp, const Vector& mean, const Vector& sd) {
  auto w = layer(mlp.weights, 0, mlp.widths()[1], mlp.inputs());
  for (Eigen::Index i = 0; i < w.rows(); ++i)
    for (int j = 0; j < mlp.inputs(); ++j) {
      w(i, j + 1) /= sd(j);
      w(i, 0) -= w(i, j + 1) * mean(j);
    }
}

void absorb_output_scale(Mlp& mlp, const Vector& mean, const Vector& sd) {
  const std::vector<int>& widths = mlp.widths();
  const int before = widths[widths.size() - 2];
  const Eigen::Index size = Eigen::Index{mlp.outputs()} * (before + 1);
  auto w = layer(mlp.weights, mlp.weights.size() - size, mlp.outputs(), before);
  for (Eigen::Index i = 0; i < w.rows(); ++i) {
    w.row(i) *= sd(i);
    w(i, 0) += mean(i);
  }
}

}  // namespace tiller::tools::nets
