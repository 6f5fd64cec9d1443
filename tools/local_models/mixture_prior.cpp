#include "tools/local_models/mixture_prior.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/rng.hpp"

namespace tiller::tools::local {
namespace {

constexpr std::uint32_t kRngMixture = 95;  // purpose of random numbers (core/rng.hpp)

/// (samples x components) memberships, rows sum to one.
Matrix memberships(const TransitionMixture& mixture, const Matrix& samples) {
  const auto count = static_cast<Eigen::Index>(mixture.share.size());
  Matrix log_weight(samples.cols(), count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const Eigen::LLT<Matrix> factor(mixture.covariance[i]);
    Matrix z = samples.colwise() - mixture.mean[i];
    factor.matrixL().solveInPlace(z);
    const double constant = std::log(mixture.share[i]) - factor.matrixLLT().diagonal().array().log().sum();
    log_weight.col(k) = (constant - 0.5 * z.colwise().squaredNorm().array()).matrix().transpose();
  }
  Matrix weight = (log_weight.colwise() - log_weight.rowwise().maxCoeff()).array().exp().matrix();
  const Vector sum = weight.rowwise().sum();
  return sum.cwiseInverse().asDiagonal() * weight;
}

void maximise(const Matrix& samples, const Matrix& weight, const Vector& floor, TransitionMixture& mixture) {
  mixture = {};
  for (Eigen::Index k = 0; k < weight.cols(); ++k) {
    const double sum = weight.col(k).sum();
    if (sum < 1e-3) continue;
    const Vector mean = samples * weight.col(k) / sum;
    const Matrix away = samples.colwise() - mean;
    Matrix covariance = away * weight.col(k).asDiagonal() * away.transpose() / sum;
    covariance.diagonal() += floor;
    mixture.share.push_back(sum / static_cast<double>(samples.cols()));
    mixture.mean.push_back(mean);
    mixture.covariance.push_back(covariance);
  }
}

}  // namespace

TransitionMixture fit_mixture(const Matrix& samples, int components, int steps, std::uint64_t seed) {
  const Eigen::Index d = samples.rows(), n = samples.cols();
  const Eigen::Index count = std::max<Eigen::Index>(1, std::min<Eigen::Index>(components, n / (2 * d)));
  const Vector centre = samples.rowwise().mean();
  const Vector floor =
      1e-6 * (samples.colwise() - centre).rowwise().squaredNorm() / static_cast<double>(n) + Vector::Constant(d, 1e-10);
  // each sample to the nearest of `count` random ones, in deviations
  const Vector scale = (1e6 * floor).cwiseSqrt().cwiseInverse();
  Rng rng(seed, kRngMixture, 0);
  std::vector<Eigen::Index> seeds;
  for (Eigen::Index k = 0; k < count; ++k) seeds.push_back(rng.below(static_cast<std::uint32_t>(n)));
  Matrix weight = Matrix::Zero(n, count);
  for (Eigen::Index i = 0; i < n; ++i) {
    Vector distance(count);
    for (Eigen::Index k = 0; k < count; ++k)
      distance(k) = scale.cwiseProduct(samples.col(i) - samples.col(seeds[static_cast<std::size_t>(k)])).norm();
    Eigen::Index nearest = 0;
    distance.minCoeff(&nearest);
    weight(i, nearest) = 1.0;
  }
  TransitionMixture mixture;
  for (int s = 0; s < steps; ++s) {
    maximise(samples, weight, floor, mixture);
    weight = memberships(mixture, samples);
  }
  return mixture;
}

TransitionPrior prior_of_mixture(const TransitionMixture& mixture, const Matrix& samples, double strength) {
  const Vector share = memberships(mixture, samples).colwise().mean().transpose();
  TransitionPrior prior;
  prior.mean = Vector::Zero(samples.rows());
  prior.covariance = Matrix::Zero(samples.rows(), samples.rows());
  for (std::size_t k = 0; k < mixture.share.size(); ++k)
    prior.mean += share(static_cast<Eigen::Index>(k)) * mixture.mean[k];
  for (std::size_t k = 0; k < mixture.share.size(); ++k) {
    const Vector away = mixture.mean[k] - prior.mean;
    prior.covariance += share(static_cast<Eigen::Index>(k)) * (mixture.covariance[k] + away * away.transpose());
  }
  prior.mean_strength = prior.strength = strength;
  return prior;
}

}  // namespace tiller::tools::local
