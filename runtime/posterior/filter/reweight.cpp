// The likelihood, its exponent, the weights and the resampling.

#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

/// target = prior x likelihood^exponent. Weights follow the change of the target since the last tick.
tiller_status_t FilterPosterior::reweight() {
  double* base = scratch_row(0);
  double* gain = scratch_row(1);
  const double* before = scratch_row(2);
  evidence_.log_likelihood(n_, carried_.sums, n_, gain);
  bool any_finite = false, any_dead = false;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const bool alive = std::isfinite(gain[i]) && std::isfinite(cloud_.log_weight[i]);
    base[i] = alive ? cloud_.log_weight[i] - exponent_ * carried_.log_likelihood[i] : -INFINITY;
    any_finite = any_finite || alive;
    any_dead = any_dead || !alive;
    if (alive) continue;
    gain[i] = 0.0;
    // a frozen particle that met a state that is not finite tries again from the state it had
    for (std::uint32_t r = 0; r < rows_ && !enabled_; ++r) carried_.sums[r * n_ + i] = before[r * n_ + i];
  }
  if (!any_finite) {
    forget_last();
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

/// No particle took the transition in: as if it had never been.
void FilterPosterior::forget_last() {
  std::memcpy(carried_.sums, scratch_row(2), sizeof(double) * rows_ * n_);
  for (std::uint32_t k = 0; k < ny_; ++k)
    if (!std::isnan(now_.transition.measured[k])) evidence_.count(-now_.weight);
}

void FilterPosterior::resample() {
  cloud_.resample(tick_);
  permute_carried();
  moved_ = 0;
  ++resamplings_;
}

/// Data that the particles carry moves with them.
void FilterPosterior::permute_carried() {
  const auto permute = [this](double* rows, std::uint32_t count) {
    for (std::uint32_t i = 0; i < count; ++i) cloud_.permute(rows + std::size_t{i} * n_);
  };
  permute(carried_.filter.state, nf_);
  permute(carried_.filter.covariance, triangle_);
  permute(carried_.filter.effect_state, ns_);
  permute(carried_.process_scale, 1);
  permute(carried_.law, disturbances_.law_rows());
  permute(carried_.sums, rows_);
  permute(carried_.base, rows_);
  permute(carried_.log_likelihood, 1);
}

/// E[sigma^2] over the particles.
void FilterPosterior::measure_noise() {
  double sum = 0.0, weight = 0.0;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const double squared = carried_.sums[ScaleEvidence::kSquared * n_ + i];
    if (!(cloud_.weight[i] > 0.0) || !std::isfinite(squared)) continue;
    sum += cloud_.weight[i] * evidence_.variance(squared);
    weight += cloud_.weight[i];
  }
  if (!(weight > 0.0)) return;
  noise_scale_ = std::sqrt(sum / weight);
  // no noise grows by a fiftieth in a tick
  calm_scale_ = std::fmin(noise_scale_, 1.02 * calm_scale_);
}

}  // namespace tiller
