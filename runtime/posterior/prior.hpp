#pragma once

#include "core/rng.hpp"
#include "posterior/mixture.hpp"
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

/// The joint prior of the inferred parameters, in their coordinates v (d): the marginals' product, or
/// config.prior_mixture cut to the marginals' bounds.
class PriorLaw {
 public:
  PriorLaw() = default;
  explicit PriorLaw(const tiller_config_t& config);

  std::uint32_t dimension() const { return d_; }
  /// The marginal that names the coordinate and the bounds of parameter j of d.
  const tiller_prior_t& marginal(std::uint32_t j) const { return config_->priors[inferred_[j]]; }
  double low(std::uint32_t j) const { return coordinate_low(marginal(j)); }
  double high(std::uint32_t j) const { return coordinate_high(marginal(j)); }
  bool is_mixture() const { return config_->prior_mixture != nullptr; }
  /// Standard deviation of coordinate j, cuts left out of account; > 0.
  double spread(std::uint32_t j) const { return is_mixture() ? mixture_.spread(j) : prior_spread(marginal(j)); }
  /// Covariance of the coordinates (d x d, row-major), cuts left out of account; positive definite.
  void covariance(double* c) const;
  /// Log density up to a constant; -infinity outside of the bounds. Cost: d, or components * d^2 / 2.
  double log_density(const double* v) const;
  /// One draw, v (d). From a mixture: until it lies within the bounds, kTries times at most; then the last try is
  /// reflected at them until it does. Means lie within the bounds: a mixture of which so little does is one that is
  /// far wider than the bounds, and a wide normal folded into them is as flat there as a cut one.
  void draw_one(Rng& rng, double* v) const;
  /// `count` draws (coordinate j of draw k at v[j * count + k]); `index` (count) is scratch. A Latin hypercube: each
  /// marginal is cut into `count` slices of equal mass and each slice is drawn once, so that the draws have the
  /// prior's own quantiles. A mixture's components get their shares of the draws, to one draw, and within a component
  /// the hypercube lies in its whitened coordinates; what falls outside of the bounds is drawn again as one draw.
  void draw(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const;

 private:
  static constexpr int kTries = 64;

  bool within(const double* v) const;
  void draw_mixture(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const;

  const tiller_config_t* config_ = nullptr;
  std::uint32_t d_ = 0;
  std::uint32_t inferred_[TILLER_MAX_PARAMS] = {};
  Mixture mixture_;
};

}  // namespace tiller
