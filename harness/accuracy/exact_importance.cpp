#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "harness/accuracy/exact_likelihood.hpp"
#include "posterior/prior.hpp"

namespace tiller::bench {
namespace {

constexpr std::uint32_t kStream = 111;
constexpr double kLogTwoPi = 1.8378770664093453;

struct Gaussian {
  double share;
  Eigen::VectorXd mean;
  Eigen::LLT<Eigen::MatrixXd> factor;
  Gaussian(double s, const Eigen::VectorXd& m, const Eigen::MatrixXd& covariance)
      : share(s), mean(m), factor(covariance) {}
};

/// Gaussians and a share of the prior, all over the coordinates.
class Proposal {
 public:
  explicit Proposal(const ExactLikelihood& likelihood) : likelihood_(likelihood) {
    for (int j = 0; j < likelihood.dimensions(); ++j) {
      const tiller_prior_t& p = likelihood.prior(j);
      if (p.kind == tiller_prior_uniform) {
        log_prior_norm_ -= std::log(p.high - p.low);
        continue;
      }
      const double centre = p.kind == tiller_prior_log_normal ? std::log(p.a) : p.a;
      const auto below = [&](double c) { return 0.5 * std::erfc(-(c - centre) / (p.b * std::sqrt(2.0))); };
      log_prior_norm_ -=
          std::log(p.b) + 0.5 * kLogTwoPi + std::log(below(coordinate_high(p)) - below(coordinate_low(p)));
    }
  }
  void add(double share, const Eigen::VectorXd& mean, const Eigen::MatrixXd& covariance) {
    parts_.emplace_back(share, mean, covariance);
    sum_ += share;
  }
  void scale(double to) {
    for (Gaussian& g : parts_) g.share *= to / sum_;
    sum_ = to;
  }
  /// n points with log(posterior / proposal).
  void sample(int n, Rng& rng, Eigen::MatrixXd& point, Eigen::VectorXd& log_weight) const {
    const int d = likelihood_.dimensions();
    point.resize(d, n);
    for (int i = 0; i < n; ++i) {
      double u = rng.uniform();
      std::size_t which = 0;
      while (which < parts_.size() && u >= parts_[which].share) u -= parts_[which++].share;
      Eigen::VectorXd z(d);
      for (int j = 0; j < d; ++j)
        z[j] = which < parts_.size() ? rng.normal() : prior_quantile(likelihood_.prior(j), rng.uniform());
      point.col(i) =
          which < parts_.size() ? Eigen::VectorXd(parts_[which].mean + parts_[which].factor.matrixL() * z) : z;
    }
    log_weight = likelihood_.log_posterior(point) - log_density(point);
  }

 private:
  Eigen::VectorXd log_density(const Eigen::MatrixXd& point) const {
    const int n = static_cast<int>(point.cols()), d = likelihood_.dimensions();
    Eigen::ArrayXXd terms(n, static_cast<int>(parts_.size()) + 1);
    for (int i = 0; i < n; ++i) {
      double sum = log_prior_norm_ + std::log(1.0 - sum_);
      for (int j = 0; j < d; ++j) sum += log_prior(likelihood_.prior(j), point(j, i));
      terms(i, 0) = sum;
    }
    for (std::size_t g = 0; g < parts_.size(); ++g) {
      const Gaussian& part = parts_[g];
      const Eigen::MatrixXd z = part.factor.matrixL().solve(point.colwise() - part.mean);
      terms.col(static_cast<int>(g) + 1) = std::log(part.share) - 0.5 * d * kLogTwoPi -
                                           0.5 * z.colwise().squaredNorm().transpose().array() -
                                           part.factor.matrixL().toDenseMatrix().diagonal().array().log().sum();
    }
    const Eigen::ArrayXd top = terms.rowwise().maxCoeff();
    return top + (terms.colwise() - top).exp().rowwise().sum().log();
  }

  const ExactLikelihood& likelihood_;
  std::vector<Gaussian> parts_;
  double sum_ = 0.0, log_prior_norm_ = 0.0;
};

struct Sample {
  Eigen::MatrixXd point;  // coordinates
  Eigen::VectorXd weight, mean;
  Eigen::MatrixXd covariance;
  double effective = 0.0;

  Sample(const Proposal& proposal, int n, Rng& rng) {
    Eigen::VectorXd log_weight;
    proposal.sample(n, rng, point, log_weight);
    weight = (log_weight.array() - log_weight.maxCoeff()).exp();
    weight /= weight.sum();
    effective = 1.0 / weight.squaredNorm();
    mean = point * weight;
    const Eigen::MatrixXd centred = point.colwise() - mean;
    covariance = centred * weight.asDiagonal() * centred.transpose();
    covariance.diagonal() *= 1.0 + 1e-6;
  }
};

/// The Gaussian that is to the posterior times the kernel at the truth what N(mean, covariance) is to the posterior.
void add_neighbourhood(Proposal& proposal, const ExactLikelihood& likelihood, double share, const Eigen::VectorXd& mean,
                       const Eigen::MatrixXd& covariance, double bandwidth) {
  Eigen::VectorXd truth(mean.size());
  for (int j = 0; j < likelihood.dimensions(); ++j)
    truth[j] = to_coordinate(likelihood.prior(j), likelihood.truth()[j]);
  const double h2 = bandwidth * bandwidth;  // kernel h2 C, posterior C: a weighted mean of the two centres
  proposal.add(share, (truth + h2 * mean) / (1.0 + h2), 1.3 * h2 / (1.0 + h2) * covariance);
}

/// Gaussians around the sample as a whole and around points drawn from it: follows bent ridges.
Proposal refit(const ExactLikelihood& likelihood, const Sample& s, double bandwidth, Rng& rng) {
  constexpr int kLocal = 24;
  Proposal next(likelihood);
  next.add(0.45, s.mean, 1.2 * s.covariance);
  next.add(0.10, s.mean, 4.0 * s.covariance);
  add_neighbourhood(next, likelihood, 0.20, s.mean, s.covariance, bandwidth);
  for (int i = 0; i < kLocal; ++i) {
    double u = rng.uniform();
    int at = 0;
    while (at + 1 < s.weight.size() && u >= s.weight[at]) u -= s.weight[at++];
    next.add(0.20 / kLocal, s.point.col(at), 0.4 * s.covariance);
  }
  next.scale(0.95);
  return next;
}

}  // namespace

ExactPosterior exact_by_importance(const ExactLikelihood& likelihood, std::uint32_t particles, std::uint64_t seed,
                                   int samples) {
  const int d = likelihood.dimensions();
  const double h = scott(particles, d);
  Rng rng(seed, kStream, 0);
  const auto modes = likelihood.modes(1024);
  Proposal first(likelihood);
  for (const auto& m : modes) {
    const Eigen::MatrixXd covariance = m.information.inverse();
    first.add(0.6, m.at, covariance);
    first.add(0.3, m.at, 4.0 * covariance);
  }
  first.scale(0.9);
  Sample s(first, samples / 4, rng);
  for (int round = 0; round < 6; ++round) {
    const bool settled = round >= 1 && s.effective > 0.25 * static_cast<double>(s.weight.size());
    s = Sample(refit(likelihood, s, h, rng), settled || round == 5 ? samples : samples / 4, rng);
    if (settled) break;
  }

  ExactPosterior p;
  p.point.resize(d, s.point.cols());
  for (int i = 0; i < s.point.cols(); ++i) p.point.col(i) = likelihood.parameters(s.point.col(i));
  p.weight = s.weight;
  p.mean = p.point * p.weight;
  const Eigen::MatrixXd centred = p.point.colwise() - p.mean;
  p.covariance = centred * p.weight.asDiagonal() * centred.transpose();
  const Eigen::MatrixXd kernel = h * h * p.covariance;
  p.log_density = log_kernel_density(p.point, p.weight, likelihood.truth(), kernel);
  // a ratio of two sums over the same sample: its relative deviation to first order
  const Eigen::LLT<Eigen::MatrixXd> factor(kernel);
  const Eigen::MatrixXd z = factor.matrixL().solve(p.point.colwise() - likelihood.truth());
  const double norm = 0.5 * d * kLogTwoPi + factor.matrixL().toDenseMatrix().diagonal().array().log().sum();
  const Eigen::ArrayXd ratio = (-0.5 * z.colwise().squaredNorm().transpose().array() - norm - p.log_density).exp();
  p.error = std::sqrt((p.weight.array().square() * (ratio - 1.0).square()).sum());
  return p;
}

}  // namespace tiller::bench
