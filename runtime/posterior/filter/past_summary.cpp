#include "posterior/filter/past_summary.hpp"

#include <cmath>
#include <cstring>

namespace tiller {

bool Regression::design(std::uint32_t d, std::uint32_t lanes, const double* coordinates, std::uint32_t stride,
                        const unsigned char* use) {
  d_ = d;
  lanes_ = lanes;
  stride_ = stride;
  coordinates_ = coordinates;
  use_ = use;
  used_ = 0;
  for (std::uint32_t l = 0; l < lanes; ++l) used_ += use[l] ? 1u : 0u;
  if (used_ < 2) return false;

  for (std::uint32_t j = 0; j < d; ++j) {
    const double* row = coordinates + j * stride;
    double sum = 0.0, square = 0.0;
    for (std::uint32_t l = 0; l < lanes; ++l)
      if (use[l]) sum += row[l];
    mean_[j] = sum / used_;
    for (std::uint32_t l = 0; l < lanes; ++l)
      if (use[l]) square += (row[l] - mean_[j]) * (row[l] - mean_[j]);
    // lanes that agree to rounding carry no slope
    inverse_sd_[j] = square > 1e-24 * mean_[j] * mean_[j] * used_ ? std::sqrt(used_ / square) : 0.0;
  }

  double normal[kMax * kMax] = {};
  for (std::uint32_t l = 0; l < lanes; ++l) {
    if (!use[l]) continue;
    double z[kMax];
    for (std::uint32_t j = 0; j < d; ++j) z[j] = (coordinates[j * stride + l] - mean_[j]) * inverse_sd_[j];
    for (std::uint32_t r = 0; r < d; ++r)
      for (std::uint32_t c = 0; c <= r; ++c) normal[r * kMax + c] += z[r] * z[c];
  }
  for (std::uint32_t r = 0; r < d; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c) {
      double sum = normal[r * kMax + c] + (r == c ? 1e-3 : 0.0);
      for (std::uint32_t k = 0; k < c; ++k) sum -= factor_[r * kMax + k] * factor_[c * kMax + k];
      factor_[r * kMax + c] = r == c ? std::sqrt(std::fmax(sum, 1e-6)) : sum / factor_[c * kMax + c];
    }
  }
  return true;
}

void Regression::fit(const double* y, double* intercept, double* slope) const {
  double mean = 0.0;
  for (std::uint32_t l = 0; l < lanes_; ++l)
    if (use_[l]) mean += y[l];
  mean /= used_;
  *intercept = mean;

  for (std::uint32_t j = 0; j < d_; ++j) {
    double sum = 0.0;
    for (std::uint32_t l = 0; l < lanes_; ++l)
      if (use_[l]) sum += (coordinates_[j * stride_ + l] - mean_[j]) * (y[l] - mean);
    slope[j] = sum * inverse_sd_[j];
  }
  for (std::uint32_t r = 0; r < d_; ++r) {
    for (std::uint32_t k = 0; k < r; ++k) slope[r] -= factor_[r * kMax + k] * slope[k];
    slope[r] /= factor_[r * kMax + r];
  }
  for (std::uint32_t r = d_; r-- > 0;) {
    for (std::uint32_t k = r + 1; k < d_; ++k) slope[r] -= factor_[k * kMax + r] * slope[k];
    slope[r] /= factor_[r * kMax + r];
  }
  for (std::uint32_t j = 0; j < d_; ++j) slope[j] *= inverse_sd_[j];
}

void PastSummary::clear() { std::memset(this, 0, sizeof *this); }

void PastSummary::add_innovation(std::uint32_t d, const double* centre, double intercept, const double* slope) {
  double at_zero = intercept;
  for (std::uint32_t j = 0; j < d; ++j) at_zero -= slope[j] * centre[j];
  for (std::uint32_t r = 0; r < d; ++r) {
    tilt[r] += at_zero * slope[r];
    for (std::uint32_t c = 0; c < d; ++c) curvature[r * TILLER_MAX_PARAMS + c] += slope[r] * slope[c];
  }
}

void PastSummary::add_log_variance(std::uint32_t d, const double* slope) {
  for (std::uint32_t j = 0; j < d; ++j) log_slope[j] += slope[j];
}

double PastSummary::squared_error_change(std::uint32_t d, const double* from, const double* to) const {
  // |z(to)|^2 - |z(from)|^2 = (to - from)^T [ curvature (to + from) + 2 tilt ]
  double change = 0.0;
  for (std::uint32_t r = 0; r < d; ++r) {
    double gradient = 2.0 * tilt[r];
    for (std::uint32_t c = 0; c < d; ++c) gradient += curvature[r * TILLER_MAX_PARAMS + c] * (to[c] + from[c]);
    change += (to[r] - from[r]) * gradient;
  }
  return change;
}

double PastSummary::log_variance_change(std::uint32_t d, const double* from, const double* to) const {
  double change = 0.0;
  for (std::uint32_t j = 0; j < d; ++j) change += log_slope[j] * (to[j] - from[j]);
  return change;
}

}  // namespace tiller
