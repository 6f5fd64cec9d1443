#pragma once

#include <cstdint>

#include "posterior/transition/discrepancy.hpp"

namespace tiller {

/// One weight per transition, so that a glitch does not teach: full where any particle explains it, falling where none
/// does.
class RobustWeight {
 public:
  void clear() { *this = {}; }
  /// Of the newest transition, whose sums are fresh; `whitened`: its regressors.
  double find(const TransitionData& data, const float* whitened);
  /// Of the last transition.
  double weight() const { return weight_; }
  /// Transitions that no particle could explain.
  std::uint64_t outliers() const { return outliers_; }

 private:
  static double outlier_ratio(const TransitionData& data, std::uint32_t particle, const float* whitened);

  double weight_ = 1.0;
  std::uint32_t doubted_run_ = 0;
  std::uint64_t outliers_ = 0;
};

}  // namespace tiller
