#pragma once

#include <vector>

#include "tools/imitate/cost_terms.hpp"

namespace tiller::tools::imitate {

/// A motion to learn from: states (nx x steps + 1) that nearly follow the model under inputs (nu x steps).
struct Motion {
  Matrix state, input;
  Eigen::Index steps() const { return input.cols(); }
};

/// The second-order expansion of one feature at one point, over z = (x, input before, u): what is not zero of it.
struct SparseQuadratic {
  struct Entry {
    std::uint16_t row, column;
    double value;
  };
  std::vector<Entry> gradient, hessian;  ///< of the gradient `column` is 0
  bool empty() const { return gradient.empty() && hessian.empty(); }
  /// gradient += w its own; hessian likewise; both of the size of z or longer than it.
  void add(double w, Vector& g, Matrix& h) const;
};

/// Model and features along a motion. A group is what one weight multiplies: group 0 all that is kept, then a learnt
/// term each, at weight one, then for each learnt target what a move of it adds to its stages and to the end.
struct Expansion {
  Eigen::Index n = 0, nu = 0;  ///< of the state with the input before behind it, and of the input
  Eigen::Index steps = 0;
  std::vector<Matrix> f;                               ///< (steps) of (n x n + nu): the step's derivatives
  Matrix defect;                                       ///< (n x steps) model's next state minus the motion's
  std::vector<std::vector<SparseQuadratic>> stage;     ///< (groups) of (steps)
  std::vector<std::vector<SparseQuadratic>> terminal;  ///< (groups) of (steps + 1): as the end of a horizon
  std::vector<std::vector<std::int8_t>> at_limit;      ///< (steps) of (nu): -1 low, 1 high, 0 free
  std::size_t groups() const { return stage.size(); }
  /// Whether a group has a slope or a curvature anywhere but in ends of horizons, or anywhere at all.
  bool varies(std::size_t group) const;
};

struct ExpandOptions {
  bool every_end = false;     ///< any point may end a horizon; else the last one alone
  double limit_share = 1e-3;  ///< an input that is this share of its range from a limit counts as at it
};

/// `cost` with its weights; `learnt` are the groups behind group 0, `targets` the states whose targets are learnt. Of
/// quadratic terms exact, of the others as QuadratiseJob has it. O(groups steps) model expansions.
Expansion expand(const Scene& scene, const Motion& motion, const tiller_config_t& cost,
                 const std::vector<CostTerm>& learnt, const ExpandOptions& options,
                 const std::vector<std::uint32_t>& targets = {});

}  // namespace tiller::tools::imitate
