#pragma once

#include <cstdint>

#include "posterior/posterior.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// Forces beyond the model that a posterior tells of, as a rollout has them: effects behind the configuration's own,
/// whose parameters stand behind the configuration's. At each joint viscous and dry friction, if joints are few, and
/// the force that wanders, which fades and swings (StepSetup::fading). Of a model without joints the slips of its
/// states, which fade likewise and are no effects (StepSetup::slip_states).
class PlannedForces {
 public:
  PlannedForces() = default;
  /// None where the effects or their parameters would be too many.
  PlannedForces(const tiller_config_t& config, const StepSetup& setup);

  std::uint32_t count() const { return count_; }  ///< the first joints, or the states that slip; 0: none
  bool slip() const { return setup_.slip_states != 0; }
  const StepSetup& setup() const { return setup_; }
  /// Into the rows (of `count`) behind the configuration's parameters: friction as far as it is sure, the mean of the
  /// others. Cost: O(N) a joint or state.
  void fill(const Posterior& posterior, std::uint32_t count, float* params) const;

 private:
  void take_effects(std::uint32_t joints);

  std::uint32_t count_ = 0, kinds_ = 0, first_param_ = 0;
  double period_s_ = 0.0;
  StepSetup setup_;
};

}  // namespace tiller
