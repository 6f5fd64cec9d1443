#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/cloud.hpp"
#include "posterior/transition/transition_lanes.hpp"

namespace tiller {

/// What transitions that nobody keeps any more say of the parameters: their residuals as polynomials of second order,
///
///   e_kr(v) ~ c_kr' phi(z),  phi = [1, z, z z'],  v = centre + L z
///
/// fitted by least squares over a design of points around the cloud, and summed up: S_r(v) = phi' G_r phi with
/// G_r += w c c', and the discrepancy's projections p_j(v) = t_j' phi with t_j += w b_j c. A new design is an affine
/// change of z, under which polynomials are translated exactly. Above six coordinates phi is [1, z].
///
/// Meant for differences between two points: what the polynomials miss at one is missed at the other.
class ResidualSummary {
 public:
  static constexpr std::uint32_t kMaxTerms = 28;    // six coordinates, second order
  static constexpr std::uint32_t kMaxPoints = 112;  // of the design

  static ResidualSummary lay_out(Arena& arena, std::uint32_t d, std::uint32_t nx, std::uint32_t joints,
                                 const std::uint32_t* velocity);
  void clear();
  bool empty() const { return empty_; }
  void forget(double keep);

  bool laid() const { return laid_; }
  /// Whether a design exists and still lies where the cloud is.
  bool covers(const Cloud& cloud) const;
  /// Lays the design around the cloud (within the prior's bounds) and translates the sums. False where the cloud has
  /// no width to fit over; then nothing has changed.
  bool centre_on(const Cloud& cloud);
  std::uint32_t points() const { return points_; }
  /// (d x points), row stride `points`
  const double* design() const { return design_; }

  /// Takes in one transition: residual (nx x points) at the design; weight (nx) with 0 for missing rows; basis
  /// (projections). Residuals that are not finite are refused: false.
  bool add(const float* residual, const float* weight, const float* basis);
  /// sums += factor * the sums at coordinates (d), rows of `stride`, in the order of ResidualSumJob.
  void add_sums(std::uint32_t lanes, const double* coordinate, double factor, double* sums, std::uint32_t stride) const;

 private:
  void whiten(const double* v, double* z) const;
  void monomials(const double* z, double* phi) const;
  bool invert_design(const double* design, double* pseudo_inverse) const;
  void translate(const double* centre, const double* root);

  std::uint32_t d_ = 0, nx_ = 0, joints_ = 0, projections_ = 0;
  std::uint32_t velocity_[TILLER_MAX_JOINTS] = {};
  std::uint32_t terms_ = 0, triangle_ = 0, points_ = 0;
  bool quadratic_ = true, empty_ = true, laid_ = false;
  double centre_[TILLER_MAX_PARAMS] = {};
  double root_[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS] = {};  // L, lower, row-major stride d
  double inverse_root_[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS] = {};
  double* unit_ = nullptr;            // (points x d) the design in z before it is cut to the bounds
  double* design_ = nullptr;          // (d x points)
  double* pseudo_inverse_ = nullptr;  // (terms x points)
  double* candidate_ = nullptr;       // (terms x points) scratch
  double* gram_ = nullptr;            // (nx x triangle) upper triangles
  double* tilt_ = nullptr;            // (projections x terms)
};

}  // namespace tiller
