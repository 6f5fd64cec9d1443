// What the posterior tells: moments, quantiles, particles.

#include <algorithm>
#include <cmath>

#include "posterior/posterior.hpp"

namespace tiller {

void Posterior::moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const {
  for (std::uint32_t i = 0; i < np_ && (param_mean || param_sd); ++i) {
    const double* row = cloud_.params + i * n_;
    double mean = 0.0, square = 0.0;
    for (std::uint32_t k = 0; k < n_; ++k) mean += cloud_.weight[k] * row[k];
    for (std::uint32_t k = 0; k < n_; ++k) square += cloud_.weight[k] * (row[k] - mean) * (row[k] - mean);
    // a fixed parameter is exact, whatever the weights' sum rounds to
    const bool fixed = config_->priors[i].kind == tiller_prior_fixed;
    if (param_mean) param_mean[i] = fixed ? config_->priors[i].a : mean;
    if (param_sd) param_sd[i] = fixed ? 0.0 : std::sqrt(square);
  }
  if (!state_mean && !state_sd) return;
  std::uint32_t heaviest = 0;
  for (std::uint32_t k = 1; k < n_; ++k)
    if (cloud_.weight[k] > cloud_.weight[heaviest]) heaviest = k;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    // about one particle, so that angles on both sides of the cut average rightly
    const double* row = cloud_.filter.state + i * n_;
    const double* variance = cloud_.filter.covariance + triangle_row(nx_, i, i) * n_;
    double mean = 0.0, within = 0.0, between = 0.0;
    for (std::uint32_t k = 0; k < n_; ++k) {
      const double difference = state_difference(*config_->model, i, row[k], row[heaviest]);
      mean += cloud_.weight[k] * difference;
      between += cloud_.weight[k] * difference * difference;
      within += cloud_.weight[k] * variance[k];
    }
    if (state_mean) state_mean[i] = row[heaviest] + mean;
    if (state_sd) state_sd[i] = std::sqrt(std::fmax(0.0, between - mean * mean) + noise_scale_ * noise_scale_ * within);
  }
}

void Posterior::covariance(double* covariance) const {
  double mean[TILLER_MAX_PARAMS];
  moments(mean, nullptr, nullptr, nullptr);
  for (std::uint32_t i = 0; i < np_ * np_; ++i) covariance[i] = 0.0;
  for (std::uint32_t a = 0; a < d_; ++a) {
    for (std::uint32_t b = 0; b <= a; ++b) {
      const std::uint32_t r = inferred_[a], c = inferred_[b];
      const double *row_r = cloud_.params + r * n_, *row_c = cloud_.params + c * n_;
      double sum = 0.0;
      for (std::uint32_t k = 0; k < n_; ++k) sum += cloud_.weight[k] * (row_r[k] - mean[r]) * (row_c[k] - mean[c]);
      covariance[r * np_ + c] = covariance[c * np_ + r] = sum;
    }
  }
}

double Posterior::quantile(std::uint32_t param, double q) const {
  if (param >= np_ || !(q >= 0.0 && q <= 1.0)) return NAN;
  const double* row = cloud_.params + param * n_;
  for (std::uint32_t k = 0; k < n_; ++k) order_[k] = k;
  // ties by index: the order, and so the sum's bits, are the same in every standard library
  std::sort(order_, order_ + n_,
            [row](std::uint32_t a, std::uint32_t b) { return row[a] != row[b] ? row[a] < row[b] : a < b; });
  // each particle stands at the middle of its share of the weight
  double below = 0.0, last_at = 0.0;
  for (std::uint32_t k = 0; k < n_; ++k) {
    const double weight = cloud_.weight[order_[k]], at = below + 0.5 * weight;
    if (at >= q) {
      if (k == 0 || at <= last_at) return row[order_[k]];
      const double share = (q - last_at) / (at - last_at);
      return row[order_[k - 1]] + share * (row[order_[k]] - row[order_[k - 1]]);
    }
    below += weight;
    last_at = at;
  }
  return row[order_[n_ - 1]];
}

void Posterior::particle(std::uint32_t index, double* params, double* state, double* weight) const {
  if (index >= n_) return;
  for (std::uint32_t i = 0; i < np_ && params; ++i) params[i] = cloud_.params[i * n_ + index];
  for (std::uint32_t i = 0; i < nx_ && state; ++i) state[i] = cloud_.filter.state[i * n_ + index];
  if (weight) *weight = cloud_.weight[index];
}

}  // namespace tiller
