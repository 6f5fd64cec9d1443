#pragma once

// Forces that fade and swing over a horizon: what a planner expects of a force that wanders (StepSetup::fading). With w
// its real part, of z now z exp((i omega - 1 / tau) k h) is left after k periods h. From `fading_param` on the
// parameters have w of each force (each the strength of a constant_offset effect), then their imaginary parts, then h /
// tau and omega h. Slips (StepSetup::slip_states) fade alike: x += h w at the end of a period (Stepper::slip).

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

/// Known to be none while a model with joints is compiled.
template <class Model>
TILLER_INLINE bool slips(const StepSetup& setup) {
  return Model::kMaySlip && setup.slip_states != 0;
}

// A linearisation without effects steps by another text (rollout/slopes.hpp). What slips add has no slope.

TILLER_INLINE void add_slips(const LineariseJob& job) {
  const double period_s = job.period_s > 0.0 ? job.period_s : job.setup->period_s;
  std::size_t row = job.setup->fading_param;
  for (std::uint32_t i = 0; i < TILLER_MAX_STATES; ++i) {
    if (((job.setup->slip_states >> i) & 1u) == 0) continue;
    for (std::uint32_t l = 0; l < job.lanes; ++l)
      job.next_state[std::size_t{i} * job.lanes + l] +=
          period_s * (job.params.splat() ? job.params.data[row] : job.params.data[row * job.params.stride + l]);
    ++row;
  }
}
/// To one point of a path, `periods` from its start.
TILLER_INLINE void add_slips(const StepSetup& setup, double period_s, const double* params, double periods,
                             double* next) {
  const std::uint32_t count = setup.fading;
  const double* slip = params + setup.fading_param;
  const Turn<double> left = turn_after(slip[2 * count], slip[2 * count + 1], periods);
  for (std::uint32_t i = 0; i < TILLER_MAX_STATES; ++i) {
    if (((setup.slip_states >> i) & 1u) == 0) continue;
    next[i] += period_s * (left.along * slip[0] - left.across * slip[count]);
    ++slip;
  }
}

}  // namespace tiller
