#include "tools/local_models/linear_model.hpp"

#include <Eigen/Cholesky>

namespace tiller::tools::local {

Vector LinearStep::next(const Vector& x, const Vector& u) const {
  return slope.leftCols(x.size()) * x + slope.rightCols(u.size()) * u + offset;
}

TransitionPrior prior_of_physics(const policy::PhysicsStep& physics, int states, const Vector& at, const Matrix& spread,
                                 const Matrix& noise, double strength) {
  Vector next;
  Matrix slope;
  physics(at.head(states), at.tail(at.size() - states), next, slope);
  const Eigen::Index n = at.size();
  TransitionPrior prior;
  prior.mean.resize(n + states);
  prior.mean << at, next;
  prior.covariance.resize(n + states, n + states);
  prior.covariance.topLeftCorner(n, n) = spread;
  prior.covariance.bottomLeftCorner(states, n) = slope * spread;
  prior.covariance.topRightCorner(n, states) = spread * slope.transpose();
  prior.covariance.bottomRightCorner(states, states) = slope * spread * slope.transpose() + noise;
  prior.mean_strength = prior.strength = strength;
  return prior;
}

TransitionMoments TransitionMoments::of(const Matrix& samples) {
  TransitionMoments m;
  m.count = static_cast<double>(samples.cols());
  m.mean = samples.rowwise().mean();
  const Matrix away = samples.colwise() - m.mean;
  m.covariance = away * away.transpose() / m.count;
  return m;
}

LinearStep fit_step(const TransitionMoments& data, const TransitionPrior& prior, int states, double ridge) {
  Vector mean = data.mean;
  Matrix covariance = data.covariance;
  if (prior.covariance.size() > 0) {
    const double n = data.count, m = prior.mean_strength;
    const Vector away = data.mean - prior.mean;
    mean = (m * prior.mean + n * data.mean) / (m + n);
    covariance = (prior.strength * prior.covariance + n * data.covariance + n * m / (n + m) * away * away.transpose()) /
                 (n + prior.strength);
  }
  const Eigen::Index inputs = mean.size() - states;
  Matrix given = covariance.topLeftCorner(inputs, inputs);
  given.diagonal().array() += ridge;
  LinearStep step;
  step.slope = given.ldlt().solve(covariance.topRightCorner(inputs, states)).transpose();
  step.offset = mean.tail(states) - step.slope * mean.head(inputs);
  step.noise = covariance.bottomRightCorner(states, states) - step.slope * covariance.topRightCorner(inputs, states);
  step.noise = 0.5 * (step.noise + step.noise.transpose()).eval();
  step.noise.diagonal().array() += 1e-10;
  return step;
}

}  // namespace tiller::tools::local
