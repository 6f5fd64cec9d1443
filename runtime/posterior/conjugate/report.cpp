// Report of the closed form: moments, quantiles, particles.

#include <cmath>

#include "posterior/conjugate/conjugate_posterior.hpp"
#include "tiller/math.hpp"

namespace tiller {

double ConjugatePosterior::noise_scale() const {
  return regression_.count() > 0.0 ? std::sqrt(regression_.variance()) : 1.0;
}

void ConjugatePosterior::covariance(double* covariance) const {
  for (std::uint32_t i = 0; i < np_ * np_; ++i) covariance[i] = 0.0;
  for (std::uint32_t r = 0; r < d_; ++r)
    for (std::uint32_t c = 0; c <= r; ++c) {
      double sum = 0.0;
      for (std::uint32_t i = 0; i <= r; ++i)
        for (std::uint32_t j = 0; j <= c; ++j)
          sum += prior_.root[r][i] * regression_.covariance(i, j) * prior_.root[c][j];
      const std::uint32_t row = cloud_.inferred[r], column = cloud_.inferred[c];
      covariance[row * np_ + column] = covariance[column * np_ + row] = sum;
    }
}

void ConjugatePosterior::moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const {
  double covariance_of[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS];
  if (param_sd) covariance(covariance_of);
  for (std::uint32_t i = 0; i < np_; ++i) {
    if (param_mean) param_mean[i] = config_->priors[i].a;
    if (param_sd) param_sd[i] = std::sqrt(covariance_of[i * np_ + i]);
  }
  for (std::uint32_t j = 0; j < d_ && param_mean; ++j) {
    double mean = prior_.mean[j];
    for (std::uint32_t i = 0; i <= j; ++i) mean += prior_.root[j][i] * regression_.mean()[i];
    param_mean[cloud_.inferred[j]] = mean;
  }
  for (std::uint32_t i = 0; i < nx_; ++i) {
    if (state_mean) state_mean[i] = state_[i];
    if (state_sd) state_sd[i] = noise_scale() * std::sqrt(state_variance_[i]);
  }
}

/// Bisection on the law's own distribution function: normals mixed over the noise scale.
double ConjugatePosterior::quantile(std::uint32_t param, double q) const {
  if (param >= np_ || !(q >= 0.0 && q <= 1.0)) return NAN;
  std::uint32_t row = 0;
  while (row < d_ && cloud_.inferred[row] != param) ++row;
  if (row == d_) return config_->priors[param].a;
  constexpr std::uint32_t kNodes = ScaleRegression::kNodes;
  double mean[kNodes], sd[kNodes], low = HUGE_VAL, high = -HUGE_VAL;
  for (std::uint32_t k = 0; k < kNodes; ++k) {
    double variance;
    regression_.along(prior_.root[row], k, &mean[k], &variance);
    sd[k] = std::sqrt(variance);
    // beyond nine deviations of every node there is less than 1e-18
    low = std::fmin(low, mean[k] - 9.0 * sd[k]);
    high = std::fmax(high, mean[k] + 9.0 * sd[k]);
  }
  for (int i = 0; i < 64; ++i) {
    const double middle = 0.5 * (low + high);
    double below = 0.0;
    for (std::uint32_t k = 0; k < kNodes; ++k)
      below += regression_.node_weight(k) * 0.5 * math::erfc((mean[k] - middle) / (1.4142135623730951 * sd[k]));
    (below < q ? low : high) = middle;
  }
  return prior_.mean[row] + 0.5 * (low + high);
}

void ConjugatePosterior::particle(std::uint32_t index, double* params, double* state, double* weight) const {
  if (index >= cloud_.n) return;
  for (std::uint32_t i = 0; i < np_ && params; ++i) params[i] = cloud_.params[i * cloud_.n + index];
  for (std::uint32_t i = 0; i < nx_ && state; ++i) state[i] = state_[i];
  if (weight) *weight = cloud_.weight[index];
}

void ConjugatePosterior::draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float*,
                              float* history) const {
  if (count == 1 && params) {
    double mean[TILLER_MAX_PARAMS];
    moments(mean, nullptr, nullptr, nullptr);
    for (std::uint32_t i = 0; i < np_; ++i) params[i] = static_cast<float>(mean[i]);
  } else if (params) {
    const Cloud::Drawn what[] = {{cloud_.params, np_, params}};
    cloud_.draw(count, tick, what, 1);
  }
  for (std::uint32_t i = 0; i < nx_ && state; ++i)
    for (std::uint32_t k = 0; k < count; ++k) state[i * count + k] = static_cast<float>(state_[i] - origin()[i]);
  inputs_.copy(setup_.delay_steps, history);
}

void ConjugatePosterior::report(PosteriorReport& report) const {
  report = {};
  for (std::uint32_t i = 0; i < nx_; ++i) report.noise_sd[i] = noise_scale() * config_->process_sd[i];
  report.delay_weight[0] = report.forgetting_weight[0] = 1.0;
}

}  // namespace tiller
