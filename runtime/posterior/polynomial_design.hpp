#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/cloud.hpp"
#include "posterior/filter_lanes.hpp"

namespace tiller {

/// Where functions of the parameters are sampled, and how they become polynomials of second order,
///
///   f(v) ~ c' phi(z),  phi = [1, z, z z'],  v = centre + L z
///
/// by least squares over a design of points around a cloud of particles. Functions are smooth and known without noise:
/// what the fit leaves is their third order over the cloud. The products z z' are those of the first kMostCurved
/// coordinates, the model's before its effects'; the others have slopes alone. Forces of effects are mostly linear in
/// their parameters, and the fit's cost grows with the square of its terms.
///
/// A new design is an affine change of z, under which polynomials are carried over exactly: phi_before = T phi_now. L
/// is lower triangular, so the first coordinates' z follow from the first coordinates' z, and their products too.
class PolynomialDesign {
 public:
  static constexpr std::uint32_t kMostCurved = kMostCurvedCoordinates;
  static constexpr std::uint32_t kMaxTerms = kMaxPolynomialTerms;

  /// Points are `points_per_term` times the terms, at least 16.
  static PolynomialDesign lay_out(Arena& arena, std::uint32_t d, double points_per_term);
  void clear() { laid_ = false; }

  bool laid() const { return laid_; }
  /// Whether a design exists and still lies where the cloud is. Cost: O(256 d^2).
  bool covers(const Cloud& cloud) const;
  /// Lays the design around the cloud, within the prior's bounds. A direction along which the cloud has no width gets
  /// kLeastWidth of the prior's. Cost: O(N d^2 + points terms^2).
  void centre_on(const Cloud& cloud);
  /// T (terms x terms, row-major) of the last centre_on(), if a design was laid before it.
  const double* translation() const { return translation_; }

  std::uint32_t dimension() const { return d_; }
  std::uint32_t terms() const { return terms_; }
  /// Coordinates that have terms of second order, the first ones.
  std::uint32_t curved() const { return curved_; }
  std::uint32_t points() const { return points_; }
  /// (d x points), row stride points()
  const double* at() const { return design_; }
  const double* centre() const { return centre_; }
  const double* inverse_root() const { return inverse_root_; }  // (d x d) lower
  /// Squared length of z up to which polynomials are believed: a quarter beyond the outermost points.
  double trusted_square() const { return trusted_square_; }

  /// Coefficients (terms) of the polynomial through values (points).
  void fit(const double* values, double* coefficients) const;
  /// z (d) and phi(z) (terms) of a point v (d).
  void whiten(const double* v, double* z) const;
  void monomials(const double* z, double* phi) const;

  /// triangle (terms (terms + 1) / 2) += weight c c', its upper half row by row.
  void add_square(const double* coefficients, double weight, double* triangle) const;
  /// Data that every evaluation over this design shares: its shape, and the points of `lanes` (rows of `stride`).
  PolynomialJob job(std::uint32_t lanes, const double* coordinate, std::uint32_t stride) const;

  /// c_now = T' c_before, in place; scratch (terms).
  void translate(double* coefficients, double* scratch) const;
  /// G_now = T' G_before T of an upper triangle row by row, in place.
  void translate_form(double* triangle) const;

 private:
  void find_moments(const Cloud& cloud, double* mean, double* root) const;
  void find_translation(const double* centre, const double* root);
  void place_points(const Cloud& cloud);
  void invert();

  std::uint32_t d_ = 0, curved_ = 0, terms_ = 0, points_ = 0;
  bool laid_ = false;
  double trusted_square_ = 0.0;
  double* centre_ = nullptr;          // (d)
  double* root_ = nullptr;            // (d x d) L, lower
  double* inverse_root_ = nullptr;    // (d x d)
  double* unit_ = nullptr;            // (points x d) the design in z before it is cut to the bounds
  double* design_ = nullptr;          // (d x points)
  double* pseudo_inverse_ = nullptr;  // (terms x points)
  double* translation_ = nullptr;     // (terms x terms)
  double* square_ = nullptr;          // (2 x terms x terms) scratch
};

}  // namespace tiller
