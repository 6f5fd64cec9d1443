// One weight per transition, so that a glitch does not teach: full where any particle explains it, falling where none
// does.

#include <cmath>

#include "posterior/transition/transition_cloud.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Deviations up to which a residual is an ordinary one: of 10^5 normal values one lies beyond.
constexpr double kOrdinary = 4.5;
/// Particles below this share of an even weight have no say.
constexpr double kHasSay = 1e-2;
/// Doubted transitions in a row after which they are believed: then the world has changed, not the sensor.
constexpr std::uint32_t kOutlierRun = 5;

}  // namespace

/// How far the worst row of a transition lies from what a particle predicts: the square of the residual over that of
/// the Student-t's residual that is as improbable as kOrdinary normal deviations. Few data so do not speak of many
/// deviations.
double TransitionCloud::outlier_ratio(std::uint32_t particle, const MeasuredStep& step, const float* basis) const {
  double worst = 0.0;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    if (std::isnan(step.change[r])) continue;
    // without regressors the sign does not matter
    const bool pushed = evidence_.place_of(r) < evidence_.pushed_count();
    const double residual = pushed ? newest_residual(particle, r) : std::sqrt(fresh_[r * n_ + particle]);
    const double e = evidence_.innovation(total_ + particle, n_, r, residual, basis);
    const double freedom = evidence_.freedom(r);
    const double ordinary = freedom * math::expm1(kOrdinary * kOrdinary / (freedom + 1.0));
    const double share = e * e / (ordinary * evidence_.scale_square(total_ + particle, n_, r, basis));
    if (!(share <= worst)) worst = share;
  }
  return worst;
}

double TransitionCloud::find_robust_weight(std::uint32_t slot) {
  double least = INFINITY;
  for (std::uint32_t i = 0; i < n_; ++i) {
    if (!(cloud_.weight[i] * n_ > kHasSay)) continue;
    const double share = outlier_ratio(i, steps_[slot], whitened_);
    if (share < least) least = share;
    // the first particle usually ends the search
    if (least <= 1.0) {
      doubted_run_ = 0;
      return 1.0;
    }
  }
  if (++doubted_run_ > kOutlierRun) return 1.0;
  ++outliers_;
  // the weighted square falls as the residual grows: else every glitch would widen the noise by as much as an
  // ordinary residual's largest
  return 1.0 / (least * least);
}

}  // namespace tiller
