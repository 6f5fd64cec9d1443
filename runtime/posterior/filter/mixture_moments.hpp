#pragma once

#include <cmath>

namespace tiller {

/// Mean and deviation of a mixture of normal laws.
struct MixtureMoments {
  double mean = 0.0, square = 0.0, within = 0.0;

  void add(double weight, double value, double variance) {
    mean += weight * value;
    square += weight * value * value;
    within += weight * variance;
  }
  /// `scale`: of the deviations within. Far outside of any machine's range rounding can leave a variance below zero.
  double deviation(double scale) const {
    const double own = within < 0.0 ? 0.0 : scale * scale * within;
    return std::sqrt(std::fmax(0.0, square - mean * mean) + own);
  }
};

}  // namespace tiller
