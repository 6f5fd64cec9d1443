#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/filter_lanes.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Linear regression on the inferred coordinates over the lanes of a rerun: value(v) = intercept + slope . v with
/// v in the summary's fixed coordinates.
///
/// One design, many responses: the normal equations are factored once. Regressors are standardised over the lanes
/// and each slope carries a ridge of 1e-3 of a lane, so lanes that agree in a coordinate give a slope of zero, not
/// an infinite one. There is no noise to average away (the response is a smooth function of the parameters): what
/// the fit leaves is curvature over the cloud, which shrinks with the cloud squared.
class Regression {
 public:
  /// rows of `lanes`: coordinates (d x lanes, row stride `stride`); `use` (lanes) is zero for lanes to leave out.
  /// False if fewer than two lanes are left.
  bool design(std::uint32_t d, std::uint32_t lanes, const double* coordinates, std::uint32_t stride,
              const unsigned char* use);
  /// Fits y (lanes) and returns intercept and slope (d) in raw coordinates relative to the lanes' mean.
  void fit(const double* y, double* intercept, double* slope) const;
  const double* centre() const { return mean_; }

 private:
  static constexpr std::uint32_t kMax = TILLER_MAX_PARAMS;
  std::uint32_t d_ = 0, lanes_ = 0, stride_ = 0, used_ = 0;
  const double* coordinates_ = nullptr;
  const unsigned char* use_ = nullptr;
  double mean_[kMax], inverse_sd_[kMax];
  double factor_[kMax * kMax];  // Cholesky of the standardised normal matrix
};

/// What the likelihood keeps of transitions that left the window: squared innovations as a quadratic of the
/// coordinates v (statistical linearisation of each innovation), log variances as a linear function. Only
/// differences between two parameter vectors are ever read from it.
struct PastSummary {
  double curvature[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS];  // sum of slope slope^T
  double tilt[TILLER_MAX_PARAMS];                           // sum of intercept * slope
  double log_slope[TILLER_MAX_PARAMS];

  void clear();
  /// One normalised innovation, linear in v - centre.
  void add_innovation(std::uint32_t d, const double* centre, double intercept, const double* slope);
  void add_log_variance(std::uint32_t d, const double* slope);
  /// to minus from
  double squared_error_change(std::uint32_t d, const double* from, const double* to) const;
  double log_variance_change(std::uint32_t d, const double* from, const double* to) const;
};

/// The filter at the window's start as a function of the coordinates: means linear, covariance common.
struct StartLaw {
  double centre[TILLER_MAX_PARAMS];
  double state[TILLER_MAX_STATES], state_slope[TILLER_MAX_STATES * TILLER_MAX_PARAMS];
  double effect[TILLER_MAX_EFFECT_STATES], effect_slope[TILLER_MAX_EFFECT_STATES * TILLER_MAX_PARAMS];
  double covariance[triangle_rows(TILLER_MAX_STATES)];
};

}  // namespace tiller
