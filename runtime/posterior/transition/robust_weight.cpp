#include "posterior/transition/robust_weight.hpp"

#include <cmath>
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
double RobustWeight::outlier_ratio(const TransitionData& data, std::uint32_t particle, const float* whitened) {
  const TransitionParticles& p = data.particles;
  const Evidence& evidence = data.evidence;
  const MeasuredStep& step = *data.ring.steps(data.ring.newest());
  double worst = 0.0;
  for (std::uint32_t r = 0; r < evidence.nx(); ++r) {
    if (std::isnan(step.change[r])) continue;
    // without regressors the sign does not matter
    const bool pushed = evidence.place_of(r) < evidence.pushed_count();
    const double residual = pushed ? data.sums.newest(p.n(), particle, r) : std::sqrt(p.fresh[r * p.n() + particle]);
    const double e = evidence.innovation(p.total + particle, p.n(), r, residual, whitened);
    const double freedom = evidence.freedom(r);
    const double ordinary = freedom * math::expm1(kOrdinary * kOrdinary / (freedom + 1.0));
    const double share = e * e / (ordinary * evidence.scale_square(p.total + particle, p.n(), r, whitened));
    if (!(share <= worst)) worst = share;
  }
  return worst;
}

double RobustWeight::find(const TransitionData& data, const float* whitened) {
  const Cloud& cloud = data.particles.cloud;
  weight_ = 1.0;
  if (!cloud.config->posterior.robust) return weight_;
  double least = INFINITY;
  for (std::uint32_t i = 0; i < cloud.n; ++i) {
    if (!(cloud.weight[i] * cloud.n > kHasSay)) continue;
    const double share = outlier_ratio(data, i, whitened);
    if (share < least) least = share;
    // the first particle usually ends the search
    if (least <= 1.0) {
      doubted_run_ = 0;
      return weight_;
    }
  }
  if (++doubted_run_ > kOutlierRun) return weight_;
  ++outliers_;
  // the weighted square falls as the residual grows: else every glitch would widen the noise by as much as an
  // ordinary residual's largest
  weight_ = 1.0 / (least * least);
  return weight_;
}

}  // namespace tiller
