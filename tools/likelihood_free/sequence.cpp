#include "tools/likelihood_free/sequence.hpp"

#include <algorithm>
#include <cmath>

#include "tools/nets/standardise.hpp"

namespace tiller::tools {

Sequencer::Sequencer(const std::vector<Piece>& pieces) : pieces_(pieces), ny_(pieces[0].start.size()) {
  for (const Piece& piece : pieces) periods_ += piece.measured.cols();
  steps_ = std::min(kLongest, periods_);
  const Eigen::Index nu = pieces[0].input.rows();
  input_ = Matrix::Zero(nu, steps_);
  Vector count = Vector::Zero(steps_);
  Eigen::Index at = 0;
  for (const Piece& piece : pieces)
    for (Eigen::Index k = 0; k < piece.measured.cols(); ++k, ++at) {
      input_.col(at * steps_ / periods_) += piece.input.col(k);
      count(at * steps_ / periods_) += 1.0;
    }
  input_.array().rowwise() /= count.transpose().array();
  if (nu > 0) input_ = nets::Standardiser::of(input_).apply(input_);
}

Matrix Sequencer::blocks_of(const Trajectory& trajectory) const {
  Matrix sums = Matrix::Zero(2 * ny_, steps_);
  Eigen::Index at = 0;
  for (std::size_t p = 0; p < trajectory.size(); ++p)
    for (Eigen::Index k = 0; k < trajectory[p].cols(); ++k, ++at) {
      const Eigen::Index step = at * steps_ / periods_;
      const Vector before = k > 0 ? Vector(trajectory[p].col(k - 1)) : pieces_[p].start;
      sums.col(step).head(ny_) += trajectory[p].col(k) - before;
      sums.col(step).tail(ny_) += trajectory[p].col(k);
    }
  return sums;
}

void Sequencer::learn(const std::vector<Trajectory>& all) {
  mean_ = sd_ = Matrix::Zero(2 * ny_, steps_);
  for (const Trajectory& one : all) mean_ += blocks_of(one) / static_cast<double>(all.size());
  for (const Trajectory& one : all)
    sd_ += ((blocks_of(one) - mean_).array().square() / static_cast<double>(all.size())).matrix();
  sd_ = sd_.cwiseSqrt();
  for (Eigen::Index i = 0; i < sd_.size(); ++i)
    if (!(sd_(i) > 1e-12 * (1e-12 + std::fabs(mean_(i))))) sd_(i) = 1.0;
}

std::vector<Matrix> Sequencer::of(const std::vector<Trajectory>& all) const {
  const auto samples = static_cast<Eigen::Index>(all.size());
  std::vector<Matrix> sequence(static_cast<std::size_t>(steps_), Matrix(rows(), samples));
  for (Eigen::Index s = 0; s < samples; ++s) {
    const Matrix z =
        ((blocks_of(all[static_cast<std::size_t>(s)]) - mean_).array() / sd_.array()).cwiseMax(-10.0).cwiseMin(10.0);
    for (Eigen::Index t = 0; t < steps_; ++t) sequence[static_cast<std::size_t>(t)].col(s) << z.col(t), input_.col(t);
  }
  return sequence;
}

}  // namespace tiller::tools
