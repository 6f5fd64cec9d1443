#pragma once

#include <cmath>
#include <cstdint>

#include "rollout/rollout.hpp"

namespace tiller {

/// A wheel that has turned a million times stands at 6e6 rad, of which single precision keeps half a radian. Lanes
/// therefore see angles less whole turns, removed in double precision. Up to this many turns they stay as they are:
/// single precision resolves 8 urad there, below what encoders tell, and ordinary robots never go further.
constexpr double kFarTurns = 16.0;
constexpr double kTurn_rad = 6.283185307179586;

/// The whole turns of an angle that is far away, as an angle; 0 for one that is not.
inline double far_turns(double angle_rad) {
  return std::fabs(angle_rad) > kFarTurns * kTurn_rad ? kTurn_rad * std::nearbyint(angle_rad / kTurn_rad) : 0.0;
}

/// Angles (bits, as tiller_model_t.angle_mask) in which the whole robot repeats with every turn: its dynamics, effects
/// included, and an own cost. A spring or a cam on an angle does not; there whole turns have to stay. Tried out on 64
/// random states with four draws of inputs and of the prior's parameters, over two periods; about 15 kB of the stack.
std::uint32_t periodic_angles(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);

/// Bounds and the catalogue's terms, which stand in unwrapped states, for states that come less `origin` (nx).
template <class T>
void move_cost_terms(const tiller_cost_config_t& cost, std::uint32_t states, const double* origin, CostTerms<T>& terms);

}  // namespace tiller
