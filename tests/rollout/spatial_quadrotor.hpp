#pragma once

// A model of more states than those that are shipped: what a user's own robot may have.

#include "tiller/model.hpp"

namespace tiller {

/// Quadrotor in space: position and velocity in the world's frame, roll, pitch and yaw (in this order from the body
/// outwards), rates about the body's axes; four rotors on a cross.
template <class S>
struct SpatialQuadrotor {
  static constexpr const char* name = "spatial_quadrotor";
  TILLER_FIELDS(State, S, x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad, x_m_s, y_m_s, z_m_s, roll_rad_s, pitch_rad_s,
                yaw_rad_s);
  TILLER_FIELDS(Input, S, front_N, left_N, back_N, right_N);
  TILLER_FIELDS(Params, S, mass_kg, arm_m, inertia_x_kgm2, inertia_y_kgm2, inertia_z_kgm2, drag_m);
  TILLER_FIELDS(Force, S, x_N, y_N, z_N, roll_Nm, pitch_Nm, yaw_Nm);
  static constexpr tiller_joint_t joints[] = {{"x", 0, 6, 0, 0},    {"y", 1, 7, 1, 0},      {"z", 2, 8, 2, 0},
                                              {"roll", 3, 9, 3, 0}, {"pitch", 4, 10, 4, 0}, {"yaw", 5, 11, 5, 0}};
  static constexpr unsigned angles = (1u << 3) | (1u << 5);

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    S sin_roll, cos_roll, sin_pitch, cos_pitch, sin_yaw, cos_yaw;
    sincos(x.roll_rad, sin_roll, cos_roll);
    sincos(x.pitch_rad, sin_pitch, cos_pitch);
    sincos(x.yaw_rad, sin_yaw, cos_yaw);
    const S inverse = S(1.0) / (p.mass_kg + body.payload_kg);
    const S thrust = u.front_N + u.left_N + u.back_N + u.right_N;
    const S tangent = sin_pitch / cos_pitch;
    const S turn = sin_roll * x.pitch_rad_s + cos_roll * x.yaw_rad_s;
    const S jx = p.inertia_x_kgm2, jy = p.inertia_y_kgm2, jz = p.inertia_z_kgm2;
    return {x.x_m_s,
            x.y_m_s,
            x.z_m_s,
            x.roll_rad_s + turn * tangent,
            cos_roll * x.pitch_rad_s - sin_roll * x.yaw_rad_s,
            turn / cos_pitch,
            (f.x_N + thrust * (cos_yaw * sin_pitch * cos_roll + sin_yaw * sin_roll)) * inverse + body.gravity_x_m_s2,
            (f.y_N + thrust * (sin_yaw * sin_pitch * cos_roll - cos_yaw * sin_roll)) * inverse,
            (f.z_N + thrust * cos_pitch * cos_roll) * inverse + body.gravity_z_m_s2,
            (f.roll_Nm + p.arm_m * (u.left_N - u.right_N) + (jy - jz) * x.pitch_rad_s * x.yaw_rad_s) / jx,
            (f.pitch_Nm + p.arm_m * (u.back_N - u.front_N) + (jz - jx) * x.yaw_rad_s * x.roll_rad_s) / jy,
            (f.yaw_Nm + p.drag_m * (u.front_N - u.left_N + u.back_N - u.right_N) +
             (jx - jy) * x.roll_rad_s * x.pitch_rad_s) /
                jz};
  }
};

}  // namespace tiller
