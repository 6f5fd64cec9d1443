#pragma once

#include <cstdint>

#include "posterior/filter/scale_evidence.hpp"
#include "posterior/filter_lanes.hpp"
#include "posterior/polynomial_design.hpp"

namespace tiller {

/// The evidence of evicted transitions about the parameters, and where the filter stands at the window's start,
/// as polynomials of the coordinates (polynomial_design.hpp).
///
/// At every point of the design a filter of its own is carried along the window's start. Of each transition that
/// leaves, the normalised innovations z_k, log s^2 and the filter after it are fitted at those points:
///
///   S(v) = phi' G phi with G += w c c',   l(v) = t' phi      (z ~ c' phi)
///
/// Covariances go by the logarithm of their root's diagonal and the rest of the root over it, so that every polynomial
/// is a covariance. Meant for differences between two points: what the polynomials miss at one is missed at the other.
class FilterSummary {
 public:
  /// nx: of the filters' states.
  static FilterSummary lay_out(Arena& arena, std::uint32_t d, std::uint32_t nx, std::uint32_t ns);
  void clear();
  bool empty() const { return empty_; }
  void forget(double keep);

  const PolynomialDesign& design() const { return design_; }
  /// Lays the design around the cloud; what is known of the past is carried over, the filters at the points are read
  /// from the polynomials.
  void centre_on(const Cloud& cloud);
  /// The filters at the design's points.
  const FilterRows& filters() const { return filters_; }

  /// One transition leaves: sums of all points have been advanced by it, the filters stand after it. z (ny x points)
  /// its normalised innovations, log_variance (points).
  void add(double weight, std::uint32_t ny, const double* z, const double* log_variance);
  /// The polynomials of the filters at the points.
  void fit_filters();

  /// sums += factor * the past's at coordinates (d rows), in the order of ScaleEvidence. NaN where the polynomials are
  /// not believed.
  void add_sums(std::uint32_t lanes, const double* coordinate, std::uint32_t coordinate_stride, double factor,
                double* sums, std::uint32_t stride) const;
  /// The filters of `lanes` points at the window's start; `lanes` a multiple of 16, rows of `coordinate_stride`.
  void read_filters(std::uint32_t lanes, const double* coordinate, std::uint32_t coordinate_stride,
                    const FilterRows& to) const;

 private:
  std::uint32_t nx_ = 0, ns_ = 0, triangle_ = 0;
  bool empty_ = true;
  PolynomialDesign design_;
  double* gram_ = nullptr;     // (upper triangle of terms)
  double* tilt_ = nullptr;     // (terms) of l
  double* law_ = nullptr;      // (nx + ns + triangle x terms) of the filters
  double* scratch_ = nullptr;  // (terms), (points)
  FilterRows filters_;         // of stride points
};

}  // namespace tiller
