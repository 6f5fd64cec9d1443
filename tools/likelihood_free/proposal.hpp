#pragma once

#include <memory>

#include "tiller/config.hpp"
#include "tools/likelihood_free/draws.hpp"
#include "tools/robot/joint_prior.hpp"

namespace tiller::tools {

/// What the draws of a round come from: the prior, or a mixture of normals cut to the prior's bounds.
class Proposal {
 public:
  /// Begins as the configuration's prior.
  explicit Proposal(const tiller_config_t& config);
  Proposal(const Proposal&) = delete;  // the laws point into it
  Proposal& operator=(const Proposal&) = delete;

  /// Becomes a mixture fitted to weighted coordinates v (d x n) (fit_mixture), its deviations `wider` times theirs.
  /// Cost: a tenth of a second for 512 points.
  void fit(const Matrix& v, const Vector& weight, double wider);
  /// `count` draws (d x count), the same for the same seed and `stream`.
  Matrix draw(std::uint64_t seed, std::uint64_t stream, std::uint32_t count) const;
  /// Up to a constant; -infinity outside of the bounds.
  double log_prior(const double* v) const { return prior_.log_density(v); }
  /// Up to a constant; -infinity outside of the bounds, and of the ellipsoids that hold 99.9 % of a fitted component:
  /// no draw tells a network what is there.
  double log_density(const double* v) const;

 private:
  bool is_covered(const double* v) const;

  Config configured_, config_;
  std::unique_ptr<JointPrior> mixture_;  // null: the prior
  PriorDistribution prior_, law_;
};

}  // namespace tiller::tools
