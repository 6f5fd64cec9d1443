#pragma once

#include <string>
#include <vector>

#include "tools/imitate/cost_terms.hpp"

namespace tiller::tools::imitate {

/// A target that is learnt beside the weights. With s how far it moves from the file's,
///
///     w (d - s)^2 = w d^2 - 2 w s d + what does not depend on the state
///
/// so that it adds a linear feature with the coefficient w s, in stages and in the end of a horizon.
struct CostTarget {
  std::uint32_t state = 0;
  std::string key;       ///< "cost.target.angle_rad"
  double value = 0;      ///< the file's
  double unit = 1;       ///< of the search: the prior's deviation is prior_sd of them
  bool angle = false;    ///< the file's and the learnt one may differ by half a turn at most
  Eigen::Index of[2]{};  ///< whose logarithm multiplies its stage and its end: 0 what is kept, i the learnt term i - 1
  double kept[2]{};      ///< what that is multiplied by: the file's weight where it is kept, one where it is learnt
};

/// The target of a state by its name. False with a sentence in `error`: no such state, no number in the file's text, no
/// weight on the state.
bool cost_target(const RobotFile& robot, const std::string& text, const std::vector<CostTerm>& learnt,
                 const std::string& state, CostTarget& target, std::string& error);

/// The search's parameters theta: logarithms of the scale and of the learnt weights, targets' moves in their units.
/// The groups of an Expansion: what is kept, a learnt term each, then stage and end of each target.
class CostParameters {
 public:
  CostParameters(const std::vector<CostTerm>& learnt, const std::vector<CostTarget>& targets)
      : weights_(1 + static_cast<Eigen::Index>(learnt.size())), targets_(targets) {}

  Eigen::Index weights() const { return weights_; }  ///< the scale among them
  Eigen::Index size() const { return weights_ + static_cast<Eigen::Index>(targets_.size()); }
  Eigen::Index groups() const { return weights_ + 2 * static_cast<Eigen::Index>(targets_.size()); }

  Vector coefficient(const Vector& theta) const;  ///< (groups)
  /// (groups): what each coefficient gains for a unit of its own parameter.
  Vector rate(const Vector& theta) const;
  /// (groups x parameters): how the groups' own parameters move with theta.
  Matrix chain(const Vector& theta) const;

 private:
  double weight(const CostTarget& target, int part, const Vector& theta) const;
  Eigen::Index weights_;
  std::vector<CostTarget> targets_;
};

}  // namespace tiller::tools::imitate
