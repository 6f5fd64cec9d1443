#pragma once

#include "core/arena.hpp"
#include "core/rng.hpp"
#include "posterior/coordinates.hpp"
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

/// An engine's own coordinates and their marginal priors. They stand behind the parameters'.
struct ExtraCoordinates {
  std::uint32_t count = 0;
  tiller_prior_t prior[kMaxExtra] = {};
};

/// A normal law of coordinates v (d), in memory of an engine's.
struct NormalLaw {
  std::uint32_t d = 0;
  double* mean = nullptr;  // (d)
  double* root = nullptr;  // (d x d) lower root of the covariance, row-major
  static NormalLaw lay_out(Arena& arena, std::uint32_t d);
  double log_density(const double* v) const;  // normalised
};

/// The joint prior of all coordinates v (d): of the inferred parameters the marginals' product, or config.prior_mixture
/// cut to the marginals' bounds; times the extra coordinates' marginals.
class PriorDistribution {
 public:
  PriorDistribution() = default;
  explicit PriorDistribution(const tiller_config_t& config, const ExtraCoordinates& extra = {});

  std::uint32_t dimension() const { return d_; }
  /// Coordinates 0 .. named() - 1 are those of inferred parameters.
  std::uint32_t named() const { return named_; }
  /// The marginal that names the coordinate and the bounds of coordinate j of d.
  const tiller_prior_t& marginal(std::uint32_t j) const {
    return j < named_ ? config_->priors[inferred_[j]] : extra_.prior[j - named_];
  }
  double low(std::uint32_t j) const { return coordinate_low(marginal(j)); }
  double high(std::uint32_t j) const { return coordinate_high(marginal(j)); }
  bool is_mixture() const { return config_->prior_mixture != nullptr; }
  /// Standard deviation of coordinate j, cuts left out of account; > 0.
  double spread(std::uint32_t j) const {
    return is_mixture() && j < named_ ? mixture_.spread(j) : prior_spread(marginal(j));
  }
  /// Covariance of the coordinates (d x d, row-major), cuts left out of account; positive definite.
  void covariance(double* c) const;
  /// Log density up to a constant; -infinity outside of the bounds. Cost: d, or components * d^2 / 2.
  double log_density(const double* v) const;
  /// From now on half of the prior is `before` (cut to the bounds), which outlives this; of the other half the extra
  /// coordinates have before's marginal law, since what changes is the robot, not the noise. Null: as configured.
  void believe_before(const NormalLaw* before) { before_ = before; }
  /// log_density() less that of what draw_one() draws from: 0 but after believe_before().
  double log_excess(const double* v) const {
    return before_ ? changed_log_density(v) - configured_log_density(v) : 0.0;
  }
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
  double configured_log_density(const double* v) const;
  double changed_log_density(const double* v) const;
  double log_scale() const;
  void draw_mixture(std::uint64_t seed, std::uint32_t count, double* v, std::uint32_t* index) const;

  const tiller_config_t* config_ = nullptr;
  std::uint32_t d_ = 0, named_ = 0;
  std::uint32_t inferred_[TILLER_MAX_PARAMS] = {};
  ExtraCoordinates extra_;
  Mixture mixture_;
  const NormalLaw* before_ = nullptr;
};

}  // namespace tiller
