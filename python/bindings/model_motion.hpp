#pragma once

#include <vector>

#include "rollout/rollout.hpp"

namespace tiller::python {

/// The configuration's model with these parameters, one lane, without input delays.
class ModelMotion {
 public:
  /// `setup` outlives it; params (np).
  ModelMotion(const tiller_config_t& config, const StepSetup& setup, std::vector<double> params);

  void start(const double* state);                                     ///< (nx); effects at rest
  void step(const double* command);                                    ///< (nu) held for one period
  void move(const double* off);                                        ///< (nx) added to the state
  const double* state() const { return state_.data(); }                // (nx)
  const double* effect_state() const { return effect_state_.data(); }  // (ns)

 private:
  const tiller_config_t& config_;
  const StepSetup& setup_;
  const RolloutTable& table_;
  std::vector<double> params_, state_, effect_state_, next_, next_effects_;
};

}  // namespace tiller::python
