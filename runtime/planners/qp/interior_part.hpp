#pragma once

#include "planners/qp/interior_point.hpp"

namespace tiller {

/// Where a program along a horizon stands in a tree.
enum class TreePlace {
  alone,   // its start is given, its end is its own
  trunk,   // its last row's cost is the branches'
  branch,  // its first row is the trunk's last
};

/// Where the iterates begin.
enum class FirstIterate {
  given,    // at the caller's inputs, brought inside their bounds: few iterations where they are nearly right
  central,  // away from all bounds, wherever the inputs were
};

/// What an interior point method does to one program along a horizon, for a driver (interior_point.cpp) that walks over
/// the parts of a tree: between the parts go the step at the branching, forward, and gradients there, backward.
class InteriorPart {
 public:
  InteriorPart() = default;
  InteriorPart(InteriorPoint& work, const Qp& program, QpSolution& solution, TreePlace place);

  // ---- set up, in this order; simulate goes from the trunk to the branches
  /// Inputs inside their bounds, multipliers zero.
  void first_iterate(FirstIterate from);
  /// Inputs without room are fixed.
  void collect_bounds();
  /// States by the dynamics.
  void simulate();
  /// First distances and multipliers, of cones too: on the central path as far as the iterate allows, at the size of
  /// the gradient.
  void first_multipliers(double size, FirstIterate from);

  // ---- the iterate
  /// Gradient of the cost; the sum of its sizes, in which NaN in anything shows.
  double cost_gradient();
  /// Largest residual, each part as kkt_residual measures it. Completes the gradients of the cost to those of the
  /// Lagrangian: a step that is solved for from what is left errs by a share of what is left. `behind` (s): what the
  /// branches' first rows add to the trunk's last one; null: nothing.
  double residual(const double* behind);
  /// A bound that stays out of reach while its multiplier grows past everything.
  bool hopeless(double size) const;
  /// Adds products of distances and multipliers after a share `alpha` of the step, and their number.
  void complementarity(double alpha, double& sum, std::size_t& terms) const;

  // ---- one step
  void aim_at_bounds();
  /// `second`: share of the predictor's second-order term.
  void aim(double centre, double second);
  bool factorise(const double* behind);
  void resolve(const double* behind);
  /// The step along the dynamics from that of the first row (s); null: from zero.
  void roll_step(const double* from);
  void shorten(double& alpha) const;
  void move(double alpha);
  /// Rounding may have left an input a last digit outside.
  void clip_inputs();

  std::size_t size() const { return N * (m + s); }
  std::size_t bounds() const;
  std::size_t cones() const;
  const double* first_gradient() const;
  const double* end_step() const;
  const double* value() const;
  const double* slope() const;

 private:
  using Bound = InteriorPoint::Bound;
  double& value_of(const Bound& b) const;
  double step_of(const Bound& b) const;
  void add(bool of_state, std::size_t index, double sign, double bound);
  double least_slack(const Bound& b, FirstIterate from) const;
  void bound_residuals(double& worst);
  void input_residuals(double& worst);
  void state_residuals(const double* behind, double& worst);
  void barrier_diagonals();
  void barrier_gradients(const double* behind);
  double* inputs_of(std::size_t k, double* x, double* u) const;
  void read_inputs(std::size_t k, double* out) const;
  void first_cones(double size);
  void cone_residuals(double& worst);
  void cone_hessians();
  void cone_gradients();

  InteriorPoint* w = nullptr;
  const Qp* qp = nullptr;
  QpSolution at;
  TreePlace place = TreePlace::alone;
  LqProblem delta;  // the sweep's problem: a step from the iterate
  std::size_t n = 0, m = 0, M = 0, s = 0, N = 0;
};

}  // namespace tiller
