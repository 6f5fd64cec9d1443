#pragma once

#include "core/rng.hpp"
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

/// The joint prior of the inferred parameters, in their coordinates v (d).
class PriorLaw {
 public:
  PriorLaw() = default;
  explicit PriorLaw(const tiller_config_t& config);

  std::uint32_t dimension() const { return d_; }
  /// The marginal that names the coordinate and the bounds of parameter j of d.
  const tiller_prior_t& marginal(std::uint32_t j) const { return config_->priors[inferred_[j]]; }
  double low(std::uint32_t j) const { return coordinate_low(marginal(j)); }
  double high(std::uint32_t j) const { return coordinate_high(marginal(j)); }
  /// Standard deviation of coordinate j, > 0.
  double spread(std::uint32_t j) const { return prior_spread(marginal(j)); }
  /// Log density up to a constant; -infinity outside of the bounds.
  double log_density(const double* v) const;
  /// One draw, v (d).
  void draw_one(Rng& rng, double* v) const;
  /// `count` draws (coordinate j of draw k at v[j * count + k]); `index` (count) is scratch. A Latin hypercube: each
  /// marginal is cut into `count` slices of equal mass and each slice is drawn once, so that the draws have the
  /// prior's own quantiles.
  void draw(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const;

 private:
  const tiller_config_t* config_ = nullptr;
  std::uint32_t d_ = 0;
  std::uint32_t inferred_[TILLER_MAX_PARAMS] = {};
};

}  // namespace tiller
