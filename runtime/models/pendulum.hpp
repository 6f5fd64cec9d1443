#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// Damped pendulum: a bob on a massless rod. Angle 0 hangs down; counter-clockwise is positive. The payload sits at
/// the bob. Gravity may be tilted: torque = m l (gx cos angle + gz sin angle), gz = -9.81 on level ground.
template <class S>
struct Pendulum {
  static constexpr const char* name = "pendulum";
  TILLER_FIELDS(State, S, angle_rad, rate_rad_s);
  TILLER_FIELDS(Input, S, torque_Nm);
  TILLER_FIELDS(Params, S, mass_kg, length_m, damping_Nms);
  TILLER_FIELDS(Force, S, joint_Nm);
  static constexpr tiller_joint_t joints[] = {{"joint", 0, 1, 0, 1}};
  static constexpr unsigned angles = 1u << 0;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S mass = p.mass_kg + body.payload_kg;
    const S inertia = mass * p.length_m * p.length_m + body.payload_kgm2;
    S sine, cosine;
    sincos(x.angle_rad, sine, cosine);
    const S gravity = mass * p.length_m * (body.gravity_x_m_s2 * cosine + body.gravity_z_m_s2 * sine);
    return {x.rate_rad_s, (u.torque_Nm + f.joint_Nm - p.damping_Nms * x.rate_rad_s + gravity) / inertia};
  }
};

}  // namespace tiller
