// The exponent on the likelihood, the weights, the resampling, the noise.

#include <cmath>

#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

/// target = prior x likelihood^exponent. Weights follow the change of the target since the last call, by new data or
/// by a higher exponent. An exponent rises only after every particle has had a move since it last changed: particles
/// that were only copied look like agreement, and the target outruns them.
void TransitionCloud::temper() {
  evidence_.log_likelihood(n_, total_, n_, gain_);
  bool any_dead = false;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const bool alive = std::isfinite(gain_[i]) && std::isfinite(cloud_.log_weight[i]);
    base_[i] = alive ? cloud_.log_weight[i] - exponent_ * log_likelihood_[i] : -INFINITY;
    if (!alive) gain_[i] = 0.0;
    any_dead = any_dead || !alive;
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
  for (std::uint32_t r = 0; r < nx_; ++r) {
    double sum = 0.0, weight = 0.0;
    for (std::uint32_t i = 0; i < n_; ++i) {
      const double squared = evidence_.squared_error(total_ + i, n_, r);
      if (!(cloud_.weight[i] > 0.0) || !std::isfinite(squared)) continue;
      sum += cloud_.weight[i] * squared;
      weight += cloud_.weight[i];
    }
    if (weight > 0.0) noise_variance_[r] = evidence_.noise_variance(sum / weight, r);
  }
}

}  // namespace tiller
