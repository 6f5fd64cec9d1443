#include "tools/likelihood_free/proposal.hpp"

#include <cmath>
#include <limits>

#include "core/rng.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kRngProposal = 83;  // purpose (core/rng.hpp)

/// Of chi-square with d degrees, 99.9 % (Wilson and Hilferty 1931).
double chi_square_999(std::uint32_t d) {
  const double share = 2.0 / (9.0 * d), root = 1.0 - share + 3.0902 * std::sqrt(share);
  return d * root * root * root;
}

PointCloud cloud_of(const PriorDistribution& law, const Matrix& v, const Vector& weight) {
  PointCloud cloud;
  cloud.dimension = law.dimension();
  const Vector w = weight / weight.sum();
  cloud.value.assign(v.data(), v.data() + v.size());
  cloud.weight.assign(w.data(), w.data() + w.size());
  for (std::uint32_t j = 0; j < law.dimension(); ++j) {
    cloud.low.push_back(law.low(j));
    cloud.high.push_back(law.high(j));
    cloud.spread.push_back(law.spread(j));
  }
  return cloud;
}

}  // namespace

Proposal::Proposal(const tiller_config_t& config)
    : configured_(config), config_(config), prior_(configured_), law_(config_) {}

void Proposal::fit(const Matrix& v, const Vector& weight, double wider) {
  GaussianMixture mixture = fit_mixture(cloud_of(prior_, v, weight));
  for (double& c : mixture.covariance) c *= wider * wider;
  mixture_ = std::make_unique<JointPrior>(mixture);
  config_.prior_mixture = &mixture_->mixture;
  law_ = PriorDistribution(config_);
}

Matrix Proposal::draw(std::uint64_t seed, std::uint64_t stream, std::uint32_t count) const {
  Matrix v(law_.dimension(), count);
  for (std::uint32_t k = 0; k < count; ++k) {
    Rng rng(seed, kRngProposal, (stream << 32) + k);
    law_.draw_one(rng, v.col(k).data());
  }
  return v;
}

bool Proposal::is_covered(const double* v) const {
  if (!mixture_) return true;
  const std::uint32_t d = law_.dimension();
  for (std::size_t c = 0; c < mixture_->weight.size(); ++c) {
    const double *mean = &mixture_->mean[c * d], *root = &mixture_->root[c * d * d];
    double square = 0.0;
    std::vector<double> e(d);
    for (std::uint32_t i = 0; i < d; ++i) {
      e[i] = v[i] - mean[i];
      for (std::uint32_t j = 0; j < i; ++j) e[i] -= root[i * d + j] * e[j];
      e[i] /= root[i * d + i];
      square += e[i] * e[i];
    }
    if (square < chi_square_999(d)) return true;
  }
  return false;
}

double Proposal::log_density(const double* v) const {
  return is_covered(v) ? law_.log_density(v) : -std::numeric_limits<double>::infinity();
}

}  // namespace tiller::tools
