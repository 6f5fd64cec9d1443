#pragma once

#include "models/acrobot.hpp"

namespace tiller {

/// The acrobot of two uniform rods: each rod's centre stands at half its length and its inertia about it is
/// m l^2 / 12, so that a length or a mass acts through everything that it decides. (Gym's acrobot has no term with the
/// lower link's length, and keeps centres and inertias where they were when a length or a mass is set.)
template <class S>
struct RodAcrobot {
  static constexpr const char* name = "rod_acrobot";
  using State = typename Acrobot<S>::State;
  using Input = typename Acrobot<S>::Input;
  using Force = typename Acrobot<S>::Force;
  TILLER_FIELDS(Params, S, upper_mass_kg, lower_mass_kg, upper_length_m, lower_length_m);
  static constexpr tiller_joint_t joints[] = {{"shoulder", 0, 2, 0, 0}, {"elbow", 1, 3, 1, 1}};
  static constexpr unsigned angles = (1u << 0) | (1u << 1);
  static constexpr bool long_dynamics = true;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S upper_inertia = p.upper_mass_kg * p.upper_length_m * p.upper_length_m * (1.0 / 12.0);
    const S lower_inertia = p.lower_mass_kg * p.lower_length_m * p.lower_length_m * (1.0 / 12.0);
    return Acrobot<S>::dynamics(x, u, f, body,
                                {p.upper_mass_kg, p.lower_mass_kg, p.upper_length_m, p.lower_length_m,
                                 p.upper_length_m * 0.5, p.lower_length_m * 0.5, upper_inertia, lower_inertia});
  }
};

}  // namespace tiller
