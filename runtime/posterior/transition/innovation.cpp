// Input of the adequacy test: the newest transition against what the particles predicted.

#include <cmath>

#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

/// Normalised by what the noise and the particles' disagreement let expect; before the transition is counted. The
/// witnesses' mean is off by an eighth of what the particles disagree about, which is part of the deviation by which it
/// is divided. Cost: O(kSubsample nx).
void TransitionCloud::measure_innovation(std::uint32_t slot) {
  const MeasuredStep& step = steps_[slot];
  const std::uint32_t stride = n_ > kSubsample ? n_ / kSubsample : 1;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    innovation_[r] = NAN;
    if (std::isnan(step.change[r])) continue;
    double weight = 0.0, mean = 0.0, square = 0.0, within = 0.0;
    for (std::uint32_t i = 0; i < n_; i += stride) {
      const double w = cloud_.weight[i];
      const double raw = newest_residual(i, r);
      if (!(w > 0.0) || !std::isfinite(raw)) continue;
      const double e = evidence_.innovation(total_ + i, n_, r, raw, whitened_);
      weight += w;
      mean += w * e;
      square += w * e * e;
      within += w * evidence_.scale_square(total_ + i, n_, r, whitened_);
    }
    if (!(weight > 0.0)) continue;
    mean /= weight;
    const double between = std::fmax(0.0, square / weight - mean * mean);
    innovation_[r] = mean / std::sqrt(within / weight + between);
  }
}

}  // namespace tiller
