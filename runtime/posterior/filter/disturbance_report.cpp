// What the model lacks, as it is told: forces, friction, parameters that drift.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "posterior/filter/filter_estimate.hpp"
#include "posterior/filter/mixture_moments.hpp"
#include "rollout/turn.hpp"
#include "tiller/math.hpp"

namespace tiller {

/// How far a particle's drift may be off, in the parameter's coordinate.
double FilterEstimate::drift_spread(std::uint32_t drift, std::uint32_t particle) const {
  const std::uint32_t state = nx() + p_.disturbances->drift_state(drift);
  const double variance = p_.covariance(state, state)[particle];
  return noise_scale_ * std::sqrt(std::fmax(0.0, variance));
}

/// What that adds to the parameter's deviation: of a logarithm its share of the parameter itself.
double FilterEstimate::drift_sd(std::uint32_t drift) const {
  const std::uint32_t param = p_.disturbances->drift_param(drift);
  const bool logarithmic = p_.cloud.config->priors[param].kind == tiller_prior_log_normal;
  const double* row = p_.params_now() + std::size_t{param} * p_.n();
  double square = 0.0;
  for (std::uint32_t k = 0; k < p_.n(); ++k) {
    const double sd = drift_spread(drift, k) * (logarithmic ? row[k] : 1.0);
    square += p_.weight(k) * sd * sd;
  }
  return std::sqrt(square);
}

/// Of a mixture of normals in the parameter's coordinate, by bisection. Cost: kHalvings N calls of erfc.
double FilterEstimate::drifting_quantile(std::uint32_t drift, double q) const {
  if (!(q >= 0.0 && q <= 1.0)) return NAN;
  constexpr int kHalvings = 36;      // to rounding, as far as a quantile is read
  constexpr double kFarthest = 6.0;  // deviations, beyond which nothing is left
  const std::uint32_t param = p_.disturbances->drift_param(drift);
  const tiller_prior_t& prior = p_.cloud.config->priors[param];
  double* const at = p_.scratch_row(0);
  double* const sd = p_.scratch_row(1);
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (std::uint32_t k = 0; k < p_.n(); ++k) {
    at[k] = to_coordinate(prior, p_.params_now()[std::size_t{param} * p_.n() + k]);
    sd[k] = std::fmax(drift_spread(drift, k), kVarianceFloor);
    low = std::fmin(low, at[k] - kFarthest * sd[k]);
    high = std::fmax(high, at[k] + kFarthest * sd[k]);
  }
  low = std::fmax(low, coordinate_low(prior));
  high = std::fmin(high, coordinate_high(prior));
  for (int halving = 0; halving < kHalvings; ++halving) {
    const double middle = 0.5 * (low + high);
    double below = 0.0;
    for (std::uint32_t k = 0; k < p_.n(); ++k)
      below += p_.weight(k) * 0.5 * math::erfc((at[k] - middle) / (1.4142135623730951 * sd[k]));
    (below < q ? low : high) = middle;
  }
  return from_coordinate(prior, 0.5 * (low + high));
}

Posterior::Fading FilterEstimate::forces(double ahead_s, double* mean, double* sd, double* imaginary) const {
  if (p_.disturbances->wanderers() == 0) return {};
  const bool turns = p_.disturbances->per_joint() == DisturbanceStates::kAllKinds;
  const double* const rate = p_.law(p_.disturbances->rate_row());
  const double* const turn = p_.law(p_.disturbances->turn_row());
  for (std::uint32_t j = 0; j < p_.disturbances->wanderers(); ++j) {
    const std::uint32_t state = nx() + p_.disturbances->force_state(j);
    const double* wandering = p_.state(state);
    const double* variance = p_.covariance(state, state);
    MixtureMoments all;
    for (std::uint32_t k = 0; k < p_.n(); ++k) {
      const Turn<double> kept = DisturbanceStates::mean_kept(rate[k], turn[k], ahead_s);
      const double force = kept.along * wandering[k] - (turns ? kept.across * wandering[p_.n() + k] : 0.0);
      all.add(p_.weight(k), force, 0.0);
      all.within += p_.weight(k) * (kept.along * kept.along + kept.across * kept.across) * variance[k];
    }
    if (mean) mean[j] = all.mean;
    if (sd) sd[j] = all.deviation(noise_scale_);
    if (!imaginary) continue;
    imaginary[j] = 0.0;
    for (std::uint32_t k = 0; turns && k < p_.n(); ++k) imaginary[j] += p_.weight(k) * wandering[p_.n() + k];
  }
  return forecast();
}

/// Of the particles' forecasts there is one mean; the law that is at it after kAhead periods, of what is there now,
/// stands for it. Each counts by the size of what matters.
Posterior::Fading FilterEstimate::forecast() const {
  constexpr double kAhead = 8.0;  // short against what swings, long against a period
  const bool turns = p_.disturbances->per_joint() == DisturbanceStates::kAllKinds;
  const double ahead_s = kAhead * p_.cloud.config->period_s;
  const double* const rate = p_.law(p_.disturbances->rate_row());
  const double* const turn = p_.law(p_.disturbances->turn_row());
  const double mean_rate = p_.mean(rate);
  double square = 0.0, along = 0.0, across = 0.0;
  for (std::uint32_t j = 0; j < p_.disturbances->wanderers(); ++j) {
    const double* real = p_.state(nx() + p_.disturbances->force_state(j));
    const double* imaginary = turns ? real + p_.n() : nullptr;
    double now[2] = {}, then[2] = {};
    for (std::uint32_t k = 0; k < p_.n(); ++k) {
      const double w = p_.weight(k), a = real[k], b = imaginary ? imaginary[k] : 0.0;
      const Turn<double> kept = turn_after(rate[k], turn[k], ahead_s);
      now[0] += w * a;
      now[1] += w * b;
      then[0] += w * (kept.along * a - kept.across * b);
      then[1] += w * (kept.across * a + kept.along * b);
    }
    const double size = p_.disturbances->size_of(j), per = size > 0.0 ? 1.0 / (size * size) : 0.0;
    square += per * (now[0] * now[0] + now[1] * now[1]);
    along += per * (then[0] * now[0] + then[1] * now[1]);
    across += per * (then[1] * now[0] - then[0] * now[1]);
  }
  const double left = std::hypot(along, across) / square;
  if (!(left > 0.0 && left <= 1.0)) return {mean_rate, 0.0};
  return {-math::log(left) / ahead_s, turns ? std::atan2(across, along) / ahead_s : 0.0};
}

void FilterEstimate::force_sizes(double* size) const {
  std::fill(size, size + TILLER_MAX_JOINTS, 0.0);
  for (std::uint32_t j = 0; j < p_.disturbances->wanderers(); ++j) {
    double square = 0.0;
    for (std::uint32_t k = 0; k < p_.n(); ++k) square += p_.weight(k) * p_.law(j)[k];
    size[j] = noise_scale_ * std::sqrt(square) * p_.disturbances->size_of(j);
  }
}

Posterior::Friction FilterEstimate::friction() const {
  const DisturbanceStates& disturbances = *p_.disturbances;
  Posterior::Friction told;
  for (std::uint32_t j = 0; j < disturbances.joints() && disturbances.has_friction(); ++j) {
    const auto read = [&](std::uint32_t kind, double* mean, double* sd) {
      const std::uint32_t lacking = disturbances.force_state(j) + kind, state = nx() + lacking;
      if (!(disturbances.friction_variance(lacking, 1.0, 0.0) > 0.0)) return;
      const double *row = p_.state(state), *variance = p_.covariance(state, state);
      MixtureMoments all;
      for (std::uint32_t k = 0; k < p_.n(); ++k) all.add(p_.weight(k), row[k], variance[k]);
      mean[j] = all.mean;
      sd[j] = all.deviation(noise_scale_);
    };
    read(DisturbanceStates::kViscous, told.viscous, told.viscous_sd);
    read(DisturbanceStates::kDry, told.dry, told.dry_sd);
  }
  return told;
}

}  // namespace tiller
