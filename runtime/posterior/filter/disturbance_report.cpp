// What the model lacks, as it is told: forces, friction, parameters that drift.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/filter/filter_posterior.hpp"
#include "rollout/turn.hpp"
#include "tiller/math.hpp"

namespace tiller {

/// The parameters as each particle's filter has them, after its last step.
void FilterPosterior::note_drift() {
  if (!carried_.present) return;
  std::memcpy(carried_.present, cloud_.params, sizeof(double) * np_ * n_);
  for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) {
    const std::uint32_t param = disturbances_.drift_param(i);
    double* row = carried_.present + std::size_t{param} * n_;
    const double* by = carried_.filter.state + std::size_t{nx_ + disturbances_.drift_state(i)} * n_;
    for (std::uint32_t k = 0; k < n_; ++k) row[k] = disturbances_.drifted(param, row[k], by[k]);
  }
}

/// The mean force goes into what guides the moves to its swing.
void FilterPosterior::note_swing() {
  if (!guided() || !disturbances_.swings()) return;
  double force[TILLER_MAX_JOINTS] = {};
  for (std::uint32_t j = 0; j < disturbances_.joints(); ++j) {
    const double* row = carried_.filter.state + std::size_t{nx_ + disturbances_.force_state(j)} * n_;
    for (std::uint32_t k = 0; k < n_; ++k) force[j] += cloud_.weight[k] * row[k];
    const double size = disturbances_.size_of(j);
    force[j] = size > 0.0 ? force[j] / size : 0.0;
  }
  swing_.observe(force);
}

/// How far a particle's drift may be off, in the parameter's coordinate.
double FilterPosterior::drift_spread(std::uint32_t drift, std::uint32_t particle) const {
  const std::uint32_t state = nx_ + disturbances_.drift_state(drift);
  const double variance = carried_.filter.covariance[std::size_t{triangle_row(nf_, state, state)} * n_ + particle];
  return noise_scale_ * std::sqrt(std::fmax(0.0, variance));
}

/// What that adds to the parameter's deviation: of a logarithm its share of the parameter itself.
double FilterPosterior::drift_sd(std::uint32_t drift) const {
  const std::uint32_t param = disturbances_.drift_param(drift);
  const bool logarithmic = config_->priors[param].kind == tiller_prior_log_normal;
  const double* row = params_now() + std::size_t{param} * n_;
  double square = 0.0;
  for (std::uint32_t k = 0; k < n_; ++k) {
    const double sd = drift_spread(drift, k) * (logarithmic ? row[k] : 1.0);
    square += cloud_.weight[k] * sd * sd;
  }
  return std::sqrt(square);
}

/// Of a mixture of normals in the parameter's coordinate, by bisection. Cost: kHalvings N calls of erfc.
double FilterPosterior::drifting_quantile(std::uint32_t drift, double q) const {
  if (!(q >= 0.0 && q <= 1.0)) return NAN;
  constexpr int kHalvings = 36;      // to rounding, as far as a quantile is read
  constexpr double kFarthest = 6.0;  // deviations, beyond which nothing is left
  const std::uint32_t param = disturbances_.drift_param(drift);
  const tiller_prior_t& prior = config_->priors[param];
  double* const at = scratch_row(0);
  double* const sd = scratch_row(1);
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (std::uint32_t k = 0; k < n_; ++k) {
    at[k] = to_coordinate(prior, params_now()[std::size_t{param} * n_ + k]);
    sd[k] = std::fmax(drift_spread(drift, k), kVarianceFloor);
    low = std::fmin(low, at[k] - kFarthest * sd[k]);
    high = std::fmax(high, at[k] + kFarthest * sd[k]);
  }
  low = std::fmax(low, coordinate_low(prior));
  high = std::fmin(high, coordinate_high(prior));
  for (int halving = 0; halving < kHalvings; ++halving) {
    const double middle = 0.5 * (low + high);
    double below = 0.0;
    for (std::uint32_t k = 0; k < n_; ++k)
      below += cloud_.weight[k] * 0.5 * math::erfc((at[k] - middle) / (1.4142135623730951 * sd[k]));
    (below < q ? low : high) = middle;
  }
  return from_coordinate(prior, 0.5 * (low + high));
}

Posterior::Fading FilterPosterior::forces(double ahead_s, double* mean, double* sd, double* imaginary) const {
  if (disturbances_.wanderers() == 0) return {};
  const bool turns = disturbances_.per_joint() == DisturbanceStates::kAllKinds;
  const double* const rate = carried_.law + std::size_t{disturbances_.rate_row()} * n_;
  const double* const turn = carried_.law + std::size_t{disturbances_.turn_row()} * n_;
  for (std::uint32_t j = 0; j < disturbances_.wanderers(); ++j) {
    const std::uint32_t state = nx_ + disturbances_.force_state(j);
    const double* wandering = carried_.filter.state + std::size_t{state} * n_;
    const double* variance = carried_.filter.covariance + std::size_t{triangle_row(nf_, state, state)} * n_;
    double sum = 0.0, square = 0.0, within = 0.0;
    for (std::uint32_t k = 0; k < n_; ++k) {
      const Turn<double> kept = DisturbanceStates::mean_kept(rate[k], turn[k], ahead_s);
      const double force = kept.along * wandering[k] - (turns ? kept.across * wandering[n_ + k] : 0.0);
      sum += cloud_.weight[k] * force;
      square += cloud_.weight[k] * force * force;
      within += cloud_.weight[k] * (kept.along * kept.along + kept.across * kept.across) * variance[k];
    }
    if (mean) mean[j] = sum;
    if (sd)
      sd[j] = std::sqrt(std::fmax(0.0, square - sum * sum) + noise_scale_ * noise_scale_ * std::fmax(0.0, within));
    if (!imaginary) continue;
    imaginary[j] = 0.0;
    for (std::uint32_t k = 0; turns && k < n_; ++k) imaginary[j] += cloud_.weight[k] * wandering[n_ + k];
  }
  return forecast();
}

/// Of the particles' forecasts there is one mean; the law that is at it after kAhead periods, of what is there now,
/// stands for it. Each counts by the size of what matters.
Posterior::Fading FilterPosterior::forecast() const {
  constexpr double kAhead = 8.0;  // short against what swings, long against a period
  const bool turns = disturbances_.per_joint() == DisturbanceStates::kAllKinds;
  const double ahead_s = kAhead * config_->period_s;
  const double* const rate = carried_.law + std::size_t{disturbances_.rate_row()} * n_;
  const double* const turn = carried_.law + std::size_t{disturbances_.turn_row()} * n_;
  double square = 0.0, along = 0.0, across = 0.0, mean_rate = 0.0;
  for (std::uint32_t k = 0; k < n_; ++k) mean_rate += cloud_.weight[k] * rate[k];
  for (std::uint32_t j = 0; j < disturbances_.wanderers(); ++j) {
    const double* real = carried_.filter.state + std::size_t{nx_ + disturbances_.force_state(j)} * n_;
    const double* imaginary = turns ? real + n_ : nullptr;
    double now[2] = {}, then[2] = {};
    for (std::uint32_t k = 0; k < n_; ++k) {
      const double w = cloud_.weight[k], a = real[k], b = imaginary ? imaginary[k] : 0.0;
      const Turn<double> kept = turn_after(rate[k], turn[k], ahead_s);
      now[0] += w * a;
      now[1] += w * b;
      then[0] += w * (kept.along * a - kept.across * b);
      then[1] += w * (kept.across * a + kept.along * b);
    }
    const double size = disturbances_.size_of(j), per = size > 0.0 ? 1.0 / (size * size) : 0.0;
    square += per * (now[0] * now[0] + now[1] * now[1]);
    along += per * (then[0] * now[0] + then[1] * now[1]);
    across += per * (then[1] * now[0] - then[0] * now[1]);
  }
  const double left = std::hypot(along, across) / square;
  if (!(left > 0.0 && left <= 1.0)) return {mean_rate, 0.0};
  return {-math::log(left) / ahead_s, turns ? std::atan2(across, along) / ahead_s : 0.0};
}

void FilterPosterior::force_sizes(double* size) const {
  std::fill(size, size + TILLER_MAX_JOINTS, 0.0);
  for (std::uint32_t j = 0; j < disturbances_.wanderers(); ++j) {
    double square = 0.0;
    for (std::uint32_t k = 0; k < n_; ++k) square += cloud_.weight[k] * carried_.law[std::size_t{j} * n_ + k];
    size[j] = noise_scale_ * std::sqrt(square) * disturbances_.size_of(j);
  }
}

Posterior::Friction FilterPosterior::friction() const {
  Friction told;
  for (std::uint32_t j = 0; j < disturbances_.joints() && disturbances_.has_friction(); ++j) {
    const auto read = [&](std::uint32_t kind, double* mean, double* sd) {
      const std::uint32_t lacking = disturbances_.force_state(j) + kind, state = nx_ + lacking;
      if (!(disturbances_.friction_variance(lacking, 1.0, 0.0) > 0.0)) return;
      const double* row = carried_.filter.state + std::size_t{state} * n_;
      const double* variance = carried_.filter.covariance + std::size_t{triangle_row(nf_, state, state)} * n_;
      double sum = 0.0, square = 0.0, within = 0.0;
      for (std::uint32_t k = 0; k < n_; ++k) {
        sum += cloud_.weight[k] * row[k];
        square += cloud_.weight[k] * row[k] * row[k];
        within += cloud_.weight[k] * variance[k];
      }
      const double own = noise_scale_ * noise_scale_ * std::fmax(0.0, within);
      mean[j] = sum;
      sd[j] = std::sqrt(std::fmax(0.0, square - sum * sum) + own);
    };
    read(DisturbanceStates::kViscous, told.viscous, told.viscous_sd);
    read(DisturbanceStates::kDry, told.dry, told.dry_sd);
  }
  return told;
}

}  // namespace tiller
