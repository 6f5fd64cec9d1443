#include "posterior/mixture.hpp"

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

Mixture::Mixture(const tiller_mixture_t& given) : given_(&given) {
  const std::uint32_t d = given.dimension;
  double largest = -INFINITY;
  for (std::uint32_t c = 0; c < given.components; ++c) {
    log_factor_[c] = math::log(given.weight[c]);
    for (std::uint32_t j = 0; j < d; ++j) log_factor_[c] -= math::log(root_of(c)[j * d + j]);
    largest = std::fmax(largest, log_factor_[c]);
  }
  for (std::uint32_t c = 0; c < given.components; ++c) log_factor_[c] -= largest;
  log_scale_ = largest;
  double square[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS];
  covariance(square);
  for (std::uint32_t j = 0; j < d; ++j) spread_[j] = std::sqrt(square[j * d + j]);
}

double Mixture::log_density(const double* v) const {
  const std::uint32_t d = given_->dimension;
  double exponent[kMaxComponents], largest = -INFINITY;
  for (std::uint32_t c = 0; c < given_->components; ++c) {
    const double *m = mean_of(c), *root = root_of(c);
    double z[TILLER_MAX_PARAMS], sum = 0.0;
    for (std::uint32_t j = 0; j < d; ++j) {
      double rest = v[j] - m[j];
      for (std::uint32_t k = 0; k < j; ++k) rest -= root[j * d + k] * z[k];
      z[j] = rest / root[j * d + j];
      sum += -0.5 * z[j] * z[j];
    }
    exponent[c] = sum + log_factor_[c];
    largest = std::fmax(largest, exponent[c]);
  }
  if (given_->components == 1 || !std::isfinite(largest)) return largest;
  double sum = 0.0;
  for (std::uint32_t c = 0; c < given_->components; ++c) sum += math::exp(exponent[c] - largest);
  return largest + math::log(sum);
}

void Mixture::mean(double* m) const {
  const std::uint32_t d = given_->dimension;
  for (std::uint32_t j = 0; j < d; ++j) {
    m[j] = 0.0;
    for (std::uint32_t c = 0; c < given_->components; ++c) m[j] += given_->weight[c] * mean_of(c)[j];
  }
}

void Mixture::covariance(double* square) const {
  const std::uint32_t d = given_->dimension;
  double m[TILLER_MAX_PARAMS];
  mean(m);
  for (std::uint32_t r = 0; r < d; ++r) {
    for (std::uint32_t s = 0; s <= r; ++s) {
      double sum = 0.0;
      for (std::uint32_t c = 0; c < given_->components; ++c) {
        double within = 0.0;
        for (std::uint32_t k = 0; k <= s; ++k) within += root_of(c)[r * d + k] * root_of(c)[s * d + k];
        sum += given_->weight[c] * (within + (mean_of(c)[r] - m[r]) * (mean_of(c)[s] - m[s]));
      }
      square[r * d + s] = square[s * d + r] = sum;
    }
  }
}

std::uint32_t Mixture::component_at(double share) const {
  double below = 0.0;
  std::uint32_t last = 0;
  for (std::uint32_t c = 0; c < given_->components; ++c) {
    if (!(given_->weight[c] > 0.0)) continue;
    below += given_->weight[c];
    last = c;  // rounding may leave the share beyond the sum: it belongs to the last that has any weight
    if (share < below) break;
  }
  return last;
}

void Mixture::place(std::uint32_t component, double* z) const {
  const std::uint32_t d = given_->dimension;
  for (std::uint32_t j = d; j-- > 0;) {  // from the last row up: each needs only the z before it
    double sum = mean_of(component)[j];
    for (std::uint32_t k = 0; k <= j; ++k) sum += root_of(component)[j * d + k] * z[k];
    z[j] = sum;
  }
}

void Mixture::draw_one(Rng& rng, double* v) const {
  const std::uint32_t component = given_->components > 1 ? component_at(rng.uniform()) : 0;
  for (std::uint32_t j = 0; j < given_->dimension; ++j) v[j] = rng.normal();
  place(component, v);
}

}  // namespace tiller
