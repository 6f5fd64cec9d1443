#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// One mass on a straight axis: a ball-screw drive, a gantry, a linear motor. Friction and springs are effects. Gravity
/// along the axis acts where body.gravity_x_m_s2 is not zero; the payload rides on the mass.
template <class S>
struct LinearAxis {
  static constexpr const char* name = "linear_axis";
  TILLER_FIELDS(State, S, position_m, velocity_m_s);
  TILLER_FIELDS(Input, S, force_N);
  TILLER_FIELDS(Params, S, mass_kg);
  TILLER_FIELDS(Force, S, axis_N);
  static constexpr tiller_joint_t joints[] = {{"axis", 0, 1, 0, 1}};
  static constexpr unsigned angles = 0;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    return {x.velocity_m_s, (u.force_N + f.axis_N) / (p.mass_kg + body.payload_kg) + body.gravity_x_m_s2};
  }
};

}  // namespace tiller
