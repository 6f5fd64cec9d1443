#pragma once

#include "core/rng.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// tiller_mixture_t at work: density, moments and draws of a mixture of normals over d coordinates, uncut. Keeps the
/// caller's arrays and what is computed once from them.
class Mixture {
 public:
  static constexpr std::uint32_t kMaxComponents = 64;

  Mixture() = default;
  /// `given` has passed tiller_config_check.
  explicit Mixture(const tiller_mixture_t& given);

  std::uint32_t components() const { return given_->components; }
  std::uint32_t dimension() const { return given_->dimension; }
  /// log sum_c w_c N(v; m_c, L_c L_c'), less the largest component's log factor w_c / |L_c|, so that one component
  /// has the normal's exponent alone, to the bit. Cost: components * d^2 / 2.
  double log_density(const double* v) const;
  /// That factor's logarithm.
  double log_scale() const { return log_scale_; }
  void mean(double* m) const;                                  // (d)
  void covariance(double* c) const;                            // (d x d) within and between the components
  double spread(std::uint32_t j) const { return spread_[j]; }  // root of its diagonal

  /// The component at which `share` in (0, 1) of the cumulated weights lies.
  std::uint32_t component_at(double share) const;
  /// m_c + L_c z, in the place of z (d).
  void place(std::uint32_t component, double* z) const;
  void draw_one(Rng& rng, double* v) const;

 private:
  const double* mean_of(std::uint32_t c) const { return given_->mean + c * given_->dimension; }
  const double* root_of(std::uint32_t c) const { return given_->root + c * given_->dimension * given_->dimension; }

  const tiller_mixture_t* given_ = nullptr;
  double log_factor_[kMaxComponents] = {}, log_scale_ = 0.0;
  double spread_[TILLER_MAX_PARAMS] = {};
};

}  // namespace tiller
