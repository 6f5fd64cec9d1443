#include "tools/identify/gaussian.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/rng.hpp"

namespace tiller::tools {
namespace {

constexpr double kLeastShare = 1e-6;  // of the prior's deviation
constexpr int kTries = 64;

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

}  // namespace

Gaussian Gaussian::of_prior(const tiller_config_t& config, const Coordinates& coordinates) {
  const std::uint32_t d = coordinates.count();
  Gaussian g{std::vector<double>(d), std::vector<double>(std::size_t{d} * d)};
  if (config.prior_mixture) {
    const Mixture mixture(*config.prior_mixture);
    mixture.mean(g.mean.data());
    mixture.covariance(g.covariance.data());
    return g;
  }
  for (std::uint32_t j = 0; j < d; ++j) {
    g.mean[j] = coordinates.mean(j);
    g.covariance[std::size_t{j} * d + j] = coordinates.sd(j) * coordinates.sd(j);
  }
  return g;
}

Gaussian Gaussian::refit(const Coordinates& coordinates, const std::vector<double>& v,
                         const std::vector<double>& weight) {
  const std::uint32_t d = coordinates.count();
  Gaussian g{std::vector<double>(d), std::vector<double>(std::size_t{d} * d)};
  for (std::size_t s = 0; s < weight.size(); ++s)
    for (std::uint32_t j = 0; j < d; ++j) g.mean[j] += weight[s] * v[s * d + j];
  for (std::size_t s = 0; s < weight.size(); ++s)
    for (std::uint32_t j = 0; j < d; ++j)
      for (std::uint32_t k = 0; k <= j; ++k)
        g.covariance[std::size_t{j} * d + k] += weight[s] * (v[s * d + j] - g.mean[j]) * (v[s * d + k] - g.mean[k]);
  for (std::uint32_t j = 0; j < d; ++j)  // symmetric to the last bit, as a posterior's file has it
    for (std::uint32_t k = 0; k < j; ++k) g.covariance[std::size_t{k} * d + j] = g.covariance[std::size_t{j} * d + k];
  for (std::uint32_t j = 0; j < d; ++j) {
    const double least = kLeastShare * coordinates.sd(j);
    g.covariance[std::size_t{j} * d + j] += least * least;
  }
  return g;
}

std::vector<double> Gaussian::draw(const Coordinates& coordinates, std::uint64_t seed, MethodRng purpose,
                                   std::uint64_t stream, std::size_t count) const {
  const auto d = static_cast<Eigen::Index>(mean.size());
  const Matrix factor = Eigen::Map<const Matrix>(covariance.data(), d, d).llt().matrixL();
  std::vector<double> all(count * mean.size());
  Eigen::VectorXd z(d);
  for (std::size_t s = 0; s < count; ++s) {
    Rng rng(seed, purpose, (stream << 24) + s);
    Eigen::Map<Eigen::VectorXd> v(all.data() + s * mean.size(), d);
    for (int t = 0; t < kTries; ++t) {
      for (Eigen::Index j = 0; j < d; ++j) z[j] = rng.normal();
      v = Eigen::Map<const Eigen::VectorXd>(mean.data(), d) + factor * z;
      if (coordinates.inside(v.data())) break;
    }
    for (std::uint32_t j = 0; j < coordinates.count(); ++j)
      v[j] = std::min(std::max(v[j], coordinates.low(j)), coordinates.high(j));
  }
  return all;
}

}  // namespace tiller::tools
