#include "tools/nets/gru.hpp"

#include <cmath>
#include <random>

namespace tiller::tools::nets {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

enum Gate { kUpdate, kReset, kNew };

/// A gate's rows: bias, weights of the inputs, weights of the states.
template <class Weights>
auto block(Weights& weights, Gate gate, int inputs, int states) {
  using Map = std::conditional_t<std::is_const_v<Weights>, Eigen::Map<const RowMajor>, Eigen::Map<RowMajor>>;
  const Eigen::Index size = Eigen::Index{states} * (1 + inputs + states);
  return Map(weights.data() + gate * size, states, 1 + inputs + states);
}

template <class W>
Matrix affine(const W& w, const Matrix& x, const Matrix& h) {
  Matrix a = w.middleCols(1, x.rows()) * x;
  a.noalias() += w.rightCols(h.rows()) * h;
  a.colwise() += Vector(w.col(0));
  return a;
}

Matrix logistic(const Matrix& a) { return (1.0 / (1.0 + (-a.array()).exp())).matrix(); }

/// Adds a gate's share to the gradient: `by` (states x samples) with respect to its sum before the activation.
template <class G>
void add_gate(G&& gradient, const Matrix& by, const Matrix& x, const Matrix& h) {
  gradient.col(0) += by.rowwise().sum();
  gradient.middleCols(1, x.rows()).noalias() += by * x.transpose();
  gradient.rightCols(h.rows()).noalias() += by * h.transpose();
}

}  // namespace

Gru::Gru(int inputs, int states)
    : weights(Vector::Zero(Eigen::Index{3} * states * (1 + inputs + states))), inputs_(inputs), states_(states) {}

void Gru::randomise(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const double reach = std::sqrt(6.0 / (inputs_ + 2 * states_));
  for (const Gate gate : {kUpdate, kReset, kNew}) {
    auto w = block(weights, gate, inputs_, states_);
    for (Eigen::Index i = 0; i < w.rows(); ++i) {
      w(i, 0) = 0.0;
      // 53 random bits by hand: the library's distributions differ between implementations
      for (Eigen::Index j = 1; j < w.cols(); ++j)
        w(i, j) = reach * (2.0 * (static_cast<double>(random() >> 11) * 0x1p-53) - 1.0);
    }
  }
}

void Gru::forward(const std::vector<Matrix>& sequence, Tape& tape) const {
  const std::size_t steps = sequence.size();
  const Eigen::Index samples = sequence[0].cols();
  const auto wz = block(weights, kUpdate, inputs_, states_), wr = block(weights, kReset, inputs_, states_),
             wn = block(weights, kNew, inputs_, states_);
  tape.x = sequence;
  tape.z.resize(steps), tape.r.resize(steps), tape.n.resize(steps), tape.h.resize(steps + 1);
  tape.h[0] = Matrix::Zero(states_, samples);
  tape.output = Matrix::Zero(outputs(), samples);
  for (std::size_t t = 0; t < steps; ++t) {
    const Matrix &x = tape.x[t], &h = tape.h[t];
    tape.z[t] = logistic(affine(wz, x, h));
    tape.r[t] = logistic(affine(wr, x, h));
    tape.n[t] = affine(wn, x, tape.r[t].cwiseProduct(h)).array().tanh().matrix();
    tape.h[t + 1] = tape.n[t] + tape.z[t].cwiseProduct(h - tape.n[t]);
    tape.output.bottomRows(states_) += tape.h[t + 1] / static_cast<double>(steps);
  }
  tape.output.topRows(states_) = tape.h[steps];
}

void Gru::backward(const Tape& tape, const Matrix& by_output, Vector& gradient) const {
  const std::size_t steps = tape.x.size();
  const auto wz = block(weights, kUpdate, inputs_, states_), wr = block(weights, kReset, inputs_, states_),
             wn = block(weights, kNew, inputs_, states_);
  const Matrix by_mean = by_output.bottomRows(states_) / static_cast<double>(steps);
  Matrix by_h = by_output.topRows(states_);  // of the state after step t
  for (std::size_t t = steps; t-- > 0;) {
    const Matrix &x = tape.x[t], &h = tape.h[t], &z = tape.z[t], &r = tape.r[t], &n = tape.n[t];
    by_h += by_mean;
    const Matrix by_z = (by_h.array() * (h - n).array() * z.array() * (1.0 - z.array())).matrix();
    const Matrix by_n = (by_h.array() * (1.0 - z.array()) * (1.0 - n.array().square())).matrix();
    const Matrix by_rh = wn.rightCols(states_).transpose() * by_n;
    const Matrix by_r = (by_rh.array() * h.array() * r.array() * (1.0 - r.array())).matrix();
    add_gate(block(gradient, kUpdate, inputs_, states_), by_z, x, h);
    add_gate(block(gradient, kReset, inputs_, states_), by_r, x, h);
    add_gate(block(gradient, kNew, inputs_, states_), by_n, x, r.cwiseProduct(h));
    Matrix before = by_h.cwiseProduct(z) + by_rh.cwiseProduct(r);
    before.noalias() += wz.rightCols(states_).transpose() * by_z;
    before.noalias() += wr.rightCols(states_).transpose() * by_r;
    by_h = std::move(before);
  }
}

}  // namespace tiller::tools::nets
