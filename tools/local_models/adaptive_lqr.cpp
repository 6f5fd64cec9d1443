#include "tools/local_models/adaptive_lqr.hpp"

#include <Eigen/Cholesky>
#include <cmath>

namespace tiller::tools::local {

AdaptiveLqr::AdaptiveLqr(policy::PhysicsStep physics, const AdaptiveOptions& options)
    : physics_(std::move(physics)), options_(options), last_command_(Vector::Zero(options.low.size())) {}

void AdaptiveLqr::learn(const Vector& x, const Vector& u, const Vector& next) {
  Vector z(x.size() + u.size() + next.size());
  z << x, u, next;
  if (data_.count == 0) {
    data_ = {1.0, z, Matrix::Zero(z.size(), z.size())};
    return;
  }
  // one weight of one in front of all others times `keep`
  const double kept = data_.count * std::exp(-1.0 / options_.period_memory), share = 1.0 / (kept + 1.0);
  const Vector away = z - data_.mean;
  data_.mean += share * away;
  data_.covariance = (1.0 - share) * (data_.covariance + share * away * away.transpose());
  data_.count = kept + 1.0;
}

LinearStep AdaptiveLqr::model(const Vector& x, const Vector& u) const {
  const Eigen::Index nx = x.size();
  Vector at(nx + u.size());
  at << x, u;
  TransitionPrior prior = prior_of_physics(physics_, static_cast<int>(nx), at, options_.spread.cwiseAbs2().asDiagonal(),
                                           options_.noise.cwiseAbs2().asDiagonal(), options_.strength);
  prior.mean_strength = 1.0;  // an offset shows in few transitions, slopes in many
  if (!options_.adapt || data_.count == 0) {
    const TransitionMoments none{0.0, prior.mean, Matrix::Zero(prior.mean.size(), prior.mean.size())};
    return fit_step(none, prior, static_cast<int>(nx), 0.0);
  }
  return fit_step(data_, prior, static_cast<int>(nx), 0.0);
}

Vector AdaptiveLqr::command(const Vector& x) {
  const LinearStep step = model(x, last_command_);
  const Eigen::Index nx = x.size(), nu = last_command_.size();
  const Matrix a = step.slope.leftCols(nx), b = step.slope.rightCols(nu);
  // about the target and the command that holds it best: y = x - target, v = u - hold, and the drift that is left
  Vector drift = a * options_.target + step.offset - options_.target;
  Matrix square = b.transpose() * b;
  square.diagonal().array() += 1e-9 * (1e-12 + square.trace());
  const Vector hold = (-square.ldlt().solve(b.transpose() * drift)).cwiseMax(options_.low).cwiseMin(options_.high);
  drift += b * hold;
  Matrix value = options_.terminal_weight, gain;
  Vector slope = Vector::Zero(nx), offset;
  for (int k = 0; k < options_.horizon; ++k) {
    const Eigen::LDLT<Matrix> curvature(options_.input_weight + b.transpose() * value * b);
    gain = -curvature.solve(b.transpose() * value * a);
    offset = -curvature.solve(b.transpose() * (value * drift + slope));
    const Matrix closed = a + b * gain;
    slope =
        closed.transpose() * (slope + value * (b * offset + drift)) + gain.transpose() * options_.input_weight * offset;
    value =
        options_.state_weight + gain.transpose() * options_.input_weight * gain + closed.transpose() * value * closed;
    value = 0.5 * (value + value.transpose()).eval();
  }
  last_command_ = (hold + gain * (x - options_.target) + offset).cwiseMax(options_.low).cwiseMin(options_.high);
  return last_command_;
}

}  // namespace tiller::tools::local
