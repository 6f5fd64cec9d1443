#pragma once

// Forces that fade over a horizon: what a planner expects of a force that wanders (StepSetup::fading). Of w now, w
// exp(-k h / tau) is left after k periods h; the setup has a constant_offset effect for each, and a row of parameters
// for h / tau.

#include "rollout/step.hpp"

namespace tiller {

template <class Model, class S>
TILLER_INLINE S fading_rate(const Model& model, const StepSetup& setup, const Parameters<Model, S>& p) {
  return p.effect[setup.fading_param + setup.fading - static_cast<std::uint32_t>(static_cast<int>(model.np()))];
}

/// The forces, times `kept`.
template <class Model, class S>
TILLER_INLINE void fade(const Model& model, const StepSetup& setup, const S& kept, Parameters<Model, S>& p) {
  S* const force = p.effect + setup.fading_param - static_cast<std::uint32_t>(static_cast<int>(model.np()));
  for (std::uint32_t j = 0; j < setup.fading; ++j) force[j] = force[j] * kept;
}

}  // namespace tiller
