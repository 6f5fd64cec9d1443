#pragma once

// Forces that fade and swing over a horizon: what a planner expects of a force that wanders (StepSetup::fading). With w
// its real part, of z now z exp((i omega - 1 / tau) k h) is left after k periods h. From `fading_param` on the
// parameters have w of each force (each the strength of a constant_offset effect), then their imaginary parts, then h /
// tau and omega h.

#include "rollout/step.hpp"
#include "rollout/turn.hpp"

namespace tiller {

template <class S>
TILLER_INLINE Turn<S> turn_after(const S& fades, const S& turns, const S& periods) {
  S sine, cosine;
  sincos(turns * periods, sine, cosine);
  const S left = exp(S(0.0) - fades * periods);
  return {left * cosine, left * sine};
}

template <class Model, class S>
TILLER_INLINE S* fading_rows(const Model& model, const StepSetup& setup, Parameters<Model, S>& p) {
  return p.effect + setup.fading_param - static_cast<std::uint32_t>(static_cast<int>(model.np()));
}

/// Over so many periods.
template <class Model, class S>
TILLER_INLINE Turn<S> turn_after(const Model& model, const StepSetup& setup, Parameters<Model, S>& p,
                                 const S& periods) {
  const S* const rates = fading_rows(model, setup, p) + 2 * setup.fading;
  return turn_after(rates[0], rates[1], periods);
}

template <class Model, class S>
TILLER_INLINE void fade(const Model& model, const StepSetup& setup, const Turn<S>& turn, Parameters<Model, S>& p) {
  turn_forces(turn, setup.fading, fading_rows(model, setup, p));
}

}  // namespace tiller
