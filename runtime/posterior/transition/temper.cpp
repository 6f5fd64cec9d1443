// The exponent on the likelihood, the weights, the resampling, the noise.

#include <cmath>
#include <cstring>

#include "posterior/transition/transition_cloud.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// How close the search for an exponent comes to the floor of effective samples.
constexpr double kSlack = 0.1;
/// While most of the data of a young ring have yet to count, steps may cost more effective samples: the cloud shrinks
/// by orders of magnitude then, and a short run must arrive.
constexpr double kEarly = 0.5, kEarlyFloor = 0.5;

}  // namespace

/// New data: the particles' evidence, and what was to be expected of it.
void TransitionCloud::take_evidence(double log_constant) {
  evidence_.log_likelihood(n_, total_, n_, gain_);
  // log_weight - log(weight) is the same for all: what normalises them
  std::uint32_t heavy = 0;
  while (heavy + 1 < n_ && !(cloud_.weight[heavy] * n_ > 0.5)) ++heavy;
  const double normaliser = cloud_.log_weight[heavy] - math::log(cloud_.weight[heavy]);
  WeighResult predicted;
  if (exponent_ < 1.0) {
    transition_table().split_weights(n_, cloud_.log_weight, log_likelihood_, 1.0, gain_, base_, fresh_);
    predicted = cloud_.lanes->weigh(n_, base_, fresh_, 1.0, nullptr);
  }
  const bool full = exponent_ == 1.0;
  const bool any_dead =
      transition_table().split_weights(n_, cloud_.log_weight, log_likelihood_, exponent_, gain_, base_, gain_);
  const WeighResult present = temper(any_dead);
  if (full) predicted = present;
  log_predictive_ =
      predicted.sum > 0.0 ? predicted.largest + math::log(predicted.sum) - normaliser + log_constant : 0.0;
  if (robust_weight_ < 1.0) log_predictive_ -= kDoubtCost;
}

/// No new data: the exponent goes as far as the cloud, which has been swept, allows.
void TransitionCloud::raise() {
  transition_table().split_weights(n_, cloud_.log_weight, log_likelihood_, exponent_, log_likelihood_, base_, gain_);
  temper(false);
}

/// target = prior x likelihood^exponent. base_: log weight less what the old likelihood has in it; gain_: the
/// likelihood; weights follow the change of the target. An exponent rises only after every particle has had a move
/// since it last changed: particles that were only copied look like agreement, and the target outruns them. Returns the
/// weights' sum at the largest exponent that is allowed.
WeighResult TransitionCloud::temper(bool any_dead) {
  std::memcpy(log_likelihood_, gain_, n_ * sizeof(double));
  if (!config_->posterior.enabled) return {};

  const double floor = config_->posterior.ess_fraction * n_;
  const bool can_move = config_->posterior.moves_per_tick > 0 && d_ > 0;
  const bool swept = moved_ >= n_;
  const double high = swept ? 1.0 : exponent_;
  double chosen = high;
  const WeighResult at_high = cloud_.lanes->weigh(n_, base_, gain_, high, fresh_);
  const double ess = at_high.effective_samples;
  const bool ordinary = !can_move || (swept && exponent_ == 1.0 && ess >= 0.5 * floor);
  if (ess < floor && !ordinary)
    chosen = cloud_.largest_exponent(base_, gain_, exponent_, high,
                                     exponent_ < kEarly && begin_ == 0 ? kEarlyFloor * floor : floor, kSlack);
  if (chosen == high) {
    std::memcpy(cloud_.weight, fresh_, n_ * sizeof(double));
    transition_table().normalise(n_, base_, gain_, high, at_high.sum, at_high.largest + math::log(at_high.sum),
                                 cloud_.weight, cloud_.log_weight);
    cloud_.effective_samples = ess;
  } else {
    cloud_.set_weights(base_, gain_, chosen);
  }
  if (chosen != exponent_) moved_ = 0;
  exponent_ = chosen;
  if (cloud_.effective_samples < floor || chosen < high || any_dead) resample();
  return at_high;
}

void TransitionCloud::resample() {
  cloud_.resample_in_place(tick_ * 64 + (resamplings_ & 63u));
  for (std::uint32_t r = 0; r < rows_; ++r) {
    cloud_.permute_in_place(total_ + r * n_);
    cloud_.permute_in_place(ring_sums_ + r * n_);
  }
  for (std::uint32_t j = 0; j < d_; ++j) cloud_.permute_in_place(params_ + cloud_.inferred[j] * n_);
  cloud_.permute_in_place(log_likelihood_);
  moved_ = 0;
  ++resamplings_;
}

void TransitionCloud::measure_noise() {
  double left[TILLER_MAX_STATES], before[TILLER_MAX_STATES];
  // particles differ by less than colours do: few speak for all
  constexpr std::uint32_t kSpeakers = 16;
  evidence_.lead(n_, total_, n_, cloud_.weight, n_ > kSpeakers ? n_ / kSpeakers : 1);
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
