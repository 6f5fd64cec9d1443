#pragma once

#include "planners/qp/qp.hpp"

namespace tiller {

/// A quadratic program on a tree: M scenarios under one input sequence, the trunk, behind which each goes on with
/// inputs of its own, its branch.
///
///     minimise  [trunk] + sum_j weight_j [branch j]
///     subject to  the constraints of the trunk and of the branches,  x_0 of branch j = block j of the trunk's last row
///
/// Each part is a program along a horizon (qp.hpp), the trunk one of M scenarios, the branches of one. The states at
/// the branching are the trunk's last row and the branches' first: their cost is the branches', their bounds are the
/// trunk's, and what a branch costs from there on is all that the trunk knows of it. A sweep is therefore one of each
/// branch and then one of the trunk, which ends in their costs to go: M sweeps of n states in the place of one of M n.
///
/// Multipliers and penalties of a branch are those of its own cost, without its weight: a branch of weight zero has a
/// solution too. Without branches the trunk is the whole program.
struct QpTree {
  const Qp* part[1 + TILLER_MAX_SCENARIOS] = {};  // the trunk first; a branch's start is in the trunk's solution
  QpSolution* solution[1 + TILLER_MAX_SCENARIOS] = {};
  std::uint32_t branches = 0;      // 0, or the trunk's scenarios
  const double* weight = nullptr;  // (branches)
  double* end_hessian = nullptr;   // (M x n x n) the trunk's last row of qxx: the solvers write it
  double* end_gradient = nullptr;  // (M x n) and of qx
  std::uint32_t parts() const { return 1 + branches; }
};

/// A program without branches.
inline QpTree tree_of(const Qp& qp, QpSolution& solution) {
  QpTree tree;
  tree.part[0] = &qp;
  tree.solution[0] = &solution;
  return tree;
}

/// The end of the trunk from a branch's first row: weight times its value (n x n; null: it stands) and slope (n).
inline void end_trunk(const QpTree& tree, std::uint32_t branch, const double* value, const double* slope) {
  const std::size_t n = tree.part[0]->lq.states;
  const double w = tree.weight[branch];
  for (std::size_t i = 0; value && i < n * n; ++i) tree.end_hessian[branch * n * n + i] = w * value[i];
  for (std::size_t i = 0; i < n; ++i) tree.end_gradient[branch * n + i] = w * slope[i];
}

}  // namespace tiller
