#pragma once

#include "tiller/tiller.h"

namespace tiller {

/// A parameter's coordinate: where the posterior takes steps, differences and covariances. The logarithm for a
/// log-normal prior (whose density is then a normal one, and no step leaves the positive numbers), else the
/// parameter itself.
double to_coordinate(const tiller_prior_t& prior, double value);
double from_coordinate(const tiller_prior_t& prior, double coordinate);

/// Bounds in the coordinate; infinite where there are none.
double coordinate_low(const tiller_prior_t& prior);
double coordinate_high(const tiller_prior_t& prior);

/// Standard deviation of the coordinate under a prior that is not fixed, its cut left out of account; > 0.
double prior_spread(const tiller_prior_t& prior);

/// Log density over the coordinate up to a constant; -infinity outside of the bounds.
double log_prior(const tiller_prior_t& prior, double coordinate);

/// The prior's quantile u in (0, 1), as a coordinate. Truncated normals are inverted by bisection: exact to
/// rounding for any bounds, no rejection loop without end. Cost: about 60 calls of erfc.
double prior_quantile(const tiller_prior_t& prior, double u);

}  // namespace tiller
