#pragma once

#include "planners/qp/qp.hpp"

namespace tiller {

/// One second-order cone of one stage in the interior point: slack s = (radius; norm's inputs) and multiplier z, both
/// inside the cone |v_1| <= v_0, with the scaling W of Nesterov and Todd (1997), for which W z = W^-1 s = lambda
/// (the formulas: Vandenberghe, "The CVXOPT linear and quadratic cone program solvers", 2010, section 4). With F the
/// constant derivative of s in the stage's inputs, a step du asks for
///
///     dz = W^-1 v - W^-2 (F du + gap),   v = lambda \ (centre e - lambda o lambda - second (W^-1 ds) o (W dz))
///
/// so that the cone enters a sweep as F' W^-2 F in the inputs' curvature and F' (W^-1 v - W^-2 gap) in their gradient.
struct ConeBound {
  static constexpr std::uint32_t kMost = 1 + TILLER_MAX_INPUTS;
  using Vector = double[kMost];
  std::uint32_t stage = 0;
  const tiller_input_cone_t* cone = nullptr;
  std::uint32_t size = 0;                           // 1 + inputs of the norm
  std::uint32_t input[kMost] = {};                  // of component r > 0
  Vector s = {}, z = {};                            // inside
  Vector gap = {};                                  // value at the iterate - s
  Vector lambda = {}, axis = {};                    // scaled point; W's axis, on the hyperboloid of determinant 1
  double length = 1.0;                              // and W's factor
  Vector target = {}, push = {}, ds = {}, dz = {};  // v, dz at du = 0, and the step

  /// The cone at inputs `u` (m) of its stage.
  void value(const double* u, Vector& out) const;
  /// F du.
  void change(const double* du, Vector& out) const;
  /// out (m) += factor F' v.
  void add_transposed(double factor, const Vector& v, double* out) const;
  /// First pair: s as the inputs have it, brought inside by at least `slack`; z central, s'z = size.
  void begin(const double* u, double slack, double complementarity);

  double complementarity(double alpha) const;
  /// W of the present pair; the affine step's target.
  void scale();
  /// The target of a centring step with a share of the last step's second-order term.
  void aim(double centre, double second);
  /// block (m x m, rows `stride` apart) += F' W^-2 F.
  void add_curvature(double* block, std::size_t stride) const;
  void compute_push();
  /// ds, dz that go with inputs' step du (m).
  void recover(const double* du);
  /// The longest alpha <= most that keeps both inside.
  double longest_step(double most) const;
  void move(double alpha);
};

}  // namespace tiller
