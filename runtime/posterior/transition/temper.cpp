// The exponent on the likelihood, the weights, the resampling, the noise.

#include <cmath>

#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

/// New data: the particles' evidence, and what was to be expected of it.
void TransitionCloud::take_evidence(double log_constant) {
  evidence_.log_likelihood(n_, total_, n_, gain_);
  // log_weight - log(weight) is the same for all: what normalises them
  std::uint32_t heaviest = 0;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const bool alive = std::isfinite(gain_[i]) && std::isfinite(cloud_.log_weight[i]);
    base_[i] = alive ? cloud_.log_weight[i] - log_likelihood_[i] : -INFINITY;
    if (!alive) gain_[i] = 0.0;
    if (cloud_.weight[i] > cloud_.weight[heaviest]) heaviest = i;
  }
  const double normaliser = cloud_.log_weight[heaviest] - std::log(cloud_.weight[heaviest]);
  const WeighResult result = cloud_.lanes->weigh(n_, base_, gain_, 1.0, nullptr);
  log_predictive_ = result.sum > 0.0 ? result.largest + std::log(result.sum) - normaliser + log_constant : 0.0;
  if (robust_weight_ < 1.0) log_predictive_ -= kDoubtCost;
  for (std::uint32_t i = 0; i < n_; ++i)
    if (std::isfinite(base_[i])) base_[i] += (1.0 - exponent_) * log_likelihood_[i];
  temper();
}

/// No new data: the exponent goes as far as the cloud, which has been swept, allows.
void TransitionCloud::raise() {
  for (std::uint32_t i = 0; i < n_; ++i) {
    base_[i] = cloud_.log_weight[i] - exponent_ * log_likelihood_[i];
    gain_[i] = log_likelihood_[i];
  }
  temper();
}

/// target = prior x likelihood^exponent. base: log weight less what the old likelihood has in it; gain: the likelihood;
/// weights follow the change of the target. An exponent rises only after every particle has had a move since it last
/// changed: particles that were only copied look like agreement, and the target outruns them.
void TransitionCloud::temper() {
  bool any_dead = false;
  for (std::uint32_t i = 0; i < n_; ++i) {
    any_dead = any_dead || std::isinf(base_[i]);
    log_likelihood_[i] = gain_[i];
  }
  if (!config_->posterior.enabled) return;

  const double floor = config_->posterior.ess_fraction * n_;
  const bool can_move = config_->posterior.moves_per_tick > 0 && d_ > 0;
  const bool swept = moved_ >= n_;
  const double high = swept ? 1.0 : exponent_;
  double chosen = high;
  const double ess = cloud_.lanes->weigh(n_, base_, gain_, high, nullptr).effective_samples;
  const bool ordinary = !can_move || (swept && exponent_ == 1.0 && ess >= 0.5 * floor);
  if (ess < floor && !ordinary) chosen = cloud_.largest_exponent(base_, gain_, exponent_, high, floor);
  cloud_.set_weights(base_, gain_, chosen);
  if (chosen != exponent_) moved_ = 0;
  exponent_ = chosen;
  if (cloud_.effective_samples < floor || chosen < high || any_dead) resample();
}

void TransitionCloud::resample() {
  cloud_.resample(tick_ * 64 + (resamplings_ & 63u));
  for (std::uint32_t r = 0; r < rows_; ++r) {
    cloud_.permute(total_ + r * n_);
    cloud_.permute(ring_sums_ + r * n_);
  }
  cloud_.permute(log_likelihood_);
  load_params();
  moved_ = 0;
  ++resamplings_;
}

void TransitionCloud::measure_noise() {
  double left[TILLER_MAX_STATES], before[TILLER_MAX_STATES];
  if (!evidence_.mean_errors(n_, total_, n_, cloud_.weight, left, before)) return;
  discrepancy_share_ = 0.0;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    noise_variance_[r] = evidence_.noise_variance(left[r], r);
    calm_variance_[r] = std::fmin(noise_variance_[r], kNoiseGrowth * calm_variance_[r]);
    if (before[r] > 0.0 && 1.0 - left[r] / before[r] > discrepancy_share_)
      discrepancy_share_ = 1.0 - left[r] / before[r];
  }
}

}  // namespace tiller
