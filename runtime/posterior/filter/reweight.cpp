// The likelihood, its exponent, the weights and the resampling.

#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "posterior/filter/filter_posterior.hpp"
#include "tiller/math.hpp"

namespace tiller {

/// Innovations with variance sigma^2 s_k and sigma^2 ~ InvGamma(a0, a0) have, sigma^2 integrated out, the log
/// density  -(a0 + n/2) log(a0 + sum e_k^2 / (2 s_k)) - sum log(s_k) / 2  up to a constant of n and a0.
double FilterPosterior::log_likelihood(double squared_error, double log_variance) const {
  const double a0 = config_->posterior.noise_scale_shape;
  return -(a0 + 0.5 * static_cast<double>(scalars_)) * math::log(a0 + 0.5 * squared_error) - 0.5 * log_variance;
}

/// target = prior x likelihood^exponent. Weights follow the change of the target since the last tick.
tiller_status_t FilterPosterior::reweight() {
  double* base = scratch_row(0);
  double* gain = scratch_row(1);
  bool any_finite = false, any_dead = false;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const double updated = log_likelihood(carried_.squared_error[i], carried_.log_variance[i]);
    const bool alive = std::isfinite(updated) && std::isfinite(cloud_.log_weight[i]);
    base[i] = alive ? cloud_.log_weight[i] - exponent_ * carried_.log_likelihood[i] : -INFINITY;
    gain[i] = alive ? updated : 0.0;
    any_finite = any_finite || alive;
    any_dead = any_dead || !alive;
    // a frozen particle that met a state that is not finite tries again from the state it had
    if (!enabled_ && !alive) {
      carried_.squared_error[i] = scratch_row(2)[i];
      carried_.log_variance[i] = scratch_row(3)[i];
    }
  }
  if (!any_finite) {
    std::memcpy(carried_.squared_error, scratch_row(2), n_ * sizeof(double));
    std::memcpy(carried_.log_variance, scratch_row(3), n_ * sizeof(double));
    for (std::uint32_t k = 0; k < ny_; ++k) scalars_ -= std::isnan(now_.measured[k]) ? 0u : 1u;
    return tiller_status_posterior_degenerate;
  }
  if (!enabled_) {
    measure_noise();
    return tiller_status_ok;
  }

  const double floor = config_->posterior.ess_fraction * n_;
  const bool can_move = config_->posterior.moves_per_tick > 0 && d_ > 0;
  const bool swept = moved_ >= n_;
  // a raised exponent needs a cloud that has moved since the last change: particles that only were copied look
  // like agreement, and the target outruns them
  const double high = swept ? 1.0 : exponent_;
  double chosen = high;
  double ess = cloud_.lanes->weigh(n_, base, gain, high, nullptr).effective_samples;
  const bool ordinary = !can_move || (swept && exponent_ == 1.0 && ess >= 0.5 * floor);
  if (ess < floor && !ordinary) chosen = cloud_.largest_exponent(base, gain, exponent_, high, floor);
  cloud_.set_weights(base, gain, chosen);
  if (chosen != exponent_) moved_ = 0;
  exponent_ = chosen;
  for (std::uint32_t i = 0; i < n_; ++i) carried_.log_likelihood[i] = std::isinf(base[i]) ? 0.0 : gain[i];
  // a particle whose state is not finite is replaced at once: moves and fits then find every particle alive
  if (cloud_.effective_samples < floor || chosen < high || any_dead) resample();
  measure_noise();
  return exponent_ < 1.0 ? tiller_status_tempered : tiller_status_ok;
}

void FilterPosterior::resample() {
  cloud_.resample(tick_);
  for (std::uint32_t i = 0; i < nx_; ++i) cloud_.permute(carried_.filter.state + i * n_);
  for (std::uint32_t i = 0; i < triangle_; ++i) cloud_.permute(carried_.filter.covariance + i * n_);
  for (std::uint32_t i = 0; i < ns_; ++i) cloud_.permute(carried_.filter.effect_state + i * n_);
  cloud_.permute(carried_.squared_error);
  cloud_.permute(carried_.log_variance);
  cloud_.permute(carried_.base_squared_error);
  cloud_.permute(carried_.base_log_variance);
  cloud_.permute(carried_.log_likelihood);
  moved_ = 0;
  ++resamplings_;
}

/// E[sigma^2] over the particles: the mean of InvGamma(a0 + n/2, a0 + sse/2).
void FilterPosterior::measure_noise() {
  const double a0 = config_->posterior.noise_scale_shape;
  const double shape = a0 + 0.5 * static_cast<double>(scalars_);
  double sum = 0.0, weight = 0.0;
  for (std::uint32_t i = 0; i < n_; ++i) {
    if (!(cloud_.weight[i] > 0.0) || !std::isfinite(carried_.squared_error[i])) continue;
    sum += cloud_.weight[i] * (a0 + 0.5 * carried_.squared_error[i]);
    weight += cloud_.weight[i];
  }
  // the mean exists from shape 1 on; before that the ratio of the two stands in its place
  if (weight > 0.0) noise_scale_ = std::sqrt(sum / weight / (shape > 2.0 ? shape - 1.0 : shape));
}

}  // namespace tiller
