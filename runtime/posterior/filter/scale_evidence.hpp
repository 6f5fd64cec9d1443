#pragma once

#include <cmath>
#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// The likelihood of a filter's innovations, their common scale integrated out:
///
///   z_k(theta) ~ N(0, sigma^2),  sigma^2 ~ InvGamma(a0, b0)
///   log L = -(a0 + n/2) log(b0 + S / 2) - l / 2
///
/// with z_k an innovation over the deviation s_k that its filter expects of it, S = sum z^2, l = sum log s^2, n the
/// number of values (Bernardo and Smith, Bayesian Theory, 1994, appendix A.2). Sums of a particle stand in rows: S,
/// then l.
class ScaleEvidence {
 public:
  static constexpr std::uint32_t kSquared = 0, kLogs = 1, kRows = 2;

  ScaleEvidence() = default;
  explicit ScaleEvidence(const tiller_config_t& config);

  void clear() { known_ = 0.0; }
  /// The scale's law before the data: as configured, or as worth `values` values of variance `variance`.
  void believe_configuration() { believe(1.0, 2.0 * configured_a0_); }
  void believe(double variance, double values);

  void forget(double keep) { known_ *= keep; }
  /// Each of the measured values (count; NaN: missing) by its weight.
  void count(const double* measured, std::uint32_t count, double weight) {
    for (std::uint32_t k = 0; k < count; ++k)
      if (!std::isnan(measured[k])) known_ += weight;
  }

  double counted() const { return known_; }
  void take_back(double counted) { known_ -= counted; }

  /// Of `lanes` particles whose sums stand in rows of `stride`. NaN where the sums are those of no particle: beyond
  /// rounding below zero.
  void log_likelihood(std::uint32_t lanes, const double* sums, std::uint32_t stride, double* out) const;
  /// E[sigma^2] of a particle with squared error S.
  double variance(double squared_error) const;

 private:
  double exponent() const { return a0_ + 0.5 * known_; }

  double configured_a0_ = 1.0, a0_ = 1.0, b0_ = 1.0;
  double known_ = 0.0;  // n
};

/// The noise's estimated scale over the configured one.
struct NoiseScale {
  double now = 1.0;
  double calm = 1.0;  // without what a sudden surprise puts into the noise: none grows by a fiftieth in a tick

  void take(double variance) {
    now = std::sqrt(variance);
    calm = std::fmin(now, 1.02 * calm);
  }
  double variance() const { return now * now; }
};

}  // namespace tiller
