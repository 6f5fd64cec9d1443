#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/polynomial_design.hpp"
#include "posterior/transition/evidence.hpp"

namespace tiller {

/// The evidence of evicted transitions about the parameters: their residuals as polynomials of second order
/// (polynomial_design.hpp), summed up,
///
///   e_kr(v) ~ c_kr' phi(z),   S_r(v) = phi' G_r phi with G_r += w c c',   p_j(v) = t_j' phi with t_j += w b_j c
///
/// S the squares, p the discrepancy's projections; q1 and q2 (colour.hpp) of the states that it pushes likewise.
///
/// Meant for differences between two points: what the polynomials miss at one is missed at the other.
class ResidualSummary {
 public:
  static ResidualSummary lay_out(Arena& arena, std::uint32_t d, const Evidence& evidence);
  void clear();
  bool empty() const { return empty_; }
  void forget(double keep);

  const PolynomialDesign& design() const { return design_; }
  /// Lays the design around the cloud and carries the sums over.
  void centre_on(const Cloud& cloud);

  /// Takes in one transition: residual (nx x points) at the design, and of the one before it where that is linked.
  /// Residuals that are not finite are refused: false.
  bool add(const float* residual, const float* before, const Evidence::Counted& one);
  /// sums += factor * the sums at coordinates (d), rows of `stride`, in the order of ResidualSumJob. Lanes beyond where
  /// the polynomials are believed get NaN.
  void add_sums(std::uint32_t lanes, const double* coordinate, double factor, double* sums, std::uint32_t stride) const;

 private:
  static constexpr std::uint32_t kPointsPerTerm = 4;  // of the design: residuals are cheap
  static constexpr std::uint32_t kMaxPoints = (kPointsPerTerm * PolynomialDesign::kMaxTerms + 15) / 16 * 16;

  std::uint32_t forms() const { return nx_ + (kLags - 1) * pushed_count_; }
  void add_lagged(std::uint32_t place, const double* c, const double* before, const Evidence::Counted& one);
  bool all_finite(const float* residual, const float* before, const Evidence::Counted& one) const;
  /// Coefficients of one row of residuals.
  void fit(const float* residual, double* c) const;

  std::uint32_t nx_ = 0, regressors_ = 0, pushed_count_ = 0, projections_ = 0, triangle_ = 0;
  std::uint32_t pushed_[kMaxPushed] = {};
  bool empty_ = true;
  PolynomialDesign design_;
  double* gram_ = nullptr;     // (nx x triangle) upper triangles, then twice (pushed_count x triangle) of q1 and q2
  double* tilt_ = nullptr;     // (projections x terms) three times
  double* scratch_ = nullptr;  // (terms)
};

}  // namespace tiller
