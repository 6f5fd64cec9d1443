#include "harness/accuracy/batch_smc.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "posterior/prior.hpp"

namespace tiller::bench {
namespace {

constexpr std::uint32_t kStream = 131;
constexpr double kKept = 0.5;  // of the effective number, from one exponent to the next

class Cloud {
 public:
  Cloud(const ExactLikelihood& likelihood, int n, std::uint64_t seed)
      : likelihood_(likelihood), rng_(seed, kStream, 0) {
    at_.resize(likelihood.dimensions(), n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < at_.rows(); ++j) at_(j, i) = prior_quantile(likelihood.prior(j), rng_.uniform());
    log_likelihood_ = log_likelihood(at_);
  }

  /// The next exponent, and the particles resampled to it.
  void raise() {
    const double next = next_exponent();
    resample(weights((next - exponent_) * (log_likelihood_.array() - log_likelihood_.maxCoeff())));
    exponent_ = next;
  }

  /// One Metropolis step of every particle.
  void move() {
    const int d = static_cast<int>(at_.rows()), n = static_cast<int>(at_.cols());
    const Eigen::MatrixXd centred = at_.colwise() - at_.rowwise().mean();
    Eigen::MatrixXd covariance = centred * centred.transpose() / n;
    for (int j = 0; j < d; ++j) covariance(j, j) += 1e-12 * std::pow(prior_spread(likelihood_.prior(j)), 2);
    const Eigen::MatrixXd root = 2.38 / std::sqrt(d) * covariance.llt().matrixL().toDenseMatrix();
    Eigen::MatrixXd tried(d, n);
    for (int i = 0; i < n; ++i) {
      Eigen::VectorXd z(d);
      for (int j = 0; j < d; ++j) z[j] = rng_.normal();
      tried.col(i) = at_.col(i) + root * z;
    }
    const Eigen::VectorXd found = log_likelihood(tried);
    for (int i = 0; i < n; ++i) {
      const double gain = exponent_ * (found[i] - log_likelihood_[i]) + log_prior_of(tried, i) - log_prior_of(at_, i);
      if (!(std::log(rng_.uniform()) < gain)) continue;  // also where the gain is no number
      at_.col(i) = tried.col(i);
      log_likelihood_[i] = found[i];
    }
  }

  double exponent() const { return exponent_; }
  std::uint32_t simulations() const { return simulations_; }
  const Eigen::MatrixXd& at() const { return at_; }

 private:
  double log_prior_of(const Eigen::MatrixXd& v, int column) const {
    double sum = 0;
    for (int j = 0; j < v.rows(); ++j) sum += log_prior(likelihood_.prior(j), v(j, column));
    return sum;
  }

  /// Minus infinity outside of the prior.
  Eigen::VectorXd log_likelihood(const Eigen::MatrixXd& v) {
    simulations_ += static_cast<std::uint32_t>(v.cols());
    Eigen::VectorXd value = likelihood_.log_posterior(v);
    for (int i = 0; i < v.cols(); ++i) {
      const double prior = log_prior_of(v, i);
      value[i] = std::isfinite(prior) && std::isfinite(value[i]) ? value[i] - prior : -INFINITY;
    }
    return value;
  }

  static Eigen::VectorXd weights(const Eigen::ArrayXd& log_weight) {
    Eigen::VectorXd weight = log_weight.exp();
    for (double& w : weight)
      if (!std::isfinite(w)) w = 0;
    return weight / weight.sum();
  }

  double next_exponent() const {
    const Eigen::ArrayXd below = log_likelihood_.array() - log_likelihood_.maxCoeff();
    const auto keeps = [&](double step) {
      return 1.0 / weights(step * below).squaredNorm() >= kKept * static_cast<double>(below.size());
    };
    double low = 0, high = 1 - exponent_;
    if (keeps(high)) return 1.0;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (keeps(middle) ? low : high) = middle;
    }
    return exponent_ + std::max(low, 1e-300);
  }

  void resample(const Eigen::VectorXd& weight) {
    const Eigen::MatrixXd before = at_;
    const Eigen::VectorXd value = log_likelihood_;
    const int n = static_cast<int>(before.cols());
    const double offset = rng_.uniform();
    double sum = 0;
    int from = -1;
    for (int i = 0; i < n; ++i) {
      while (from + 1 < n && (from < 0 || sum < (i + offset) / n)) sum += weight[++from];
      at_.col(i) = before.col(from);
      log_likelihood_[i] = value[from];
    }
  }

  const ExactLikelihood& likelihood_;
  Rng rng_;
  Eigen::MatrixXd at_;  // (d x n) coordinates
  Eigen::VectorXd log_likelihood_;
  double exponent_ = 0;
  std::uint32_t simulations_ = 0;
};

}  // namespace

BatchPosterior batch_smc(const ExactLikelihood& likelihood, int particles, std::uint32_t budget, std::uint64_t seed) {
  Cloud cloud(likelihood, particles, seed);
  while (cloud.simulations() + static_cast<std::uint32_t>(particles) <= budget) {
    if (cloud.exponent() < 1.0) cloud.raise();
    cloud.move();
  }
  BatchPosterior out;
  out.exponent = cloud.exponent();
  out.simulations = cloud.simulations();
  out.point.resize(likelihood.dimensions(), particles);
  for (int i = 0; i < particles; ++i) out.point.col(i) = likelihood.parameters(cloud.at().col(i));
  return out;
}

}  // namespace tiller::bench
