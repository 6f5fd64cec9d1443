#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// Quadrotor in a vertical plane: a rigid body with a rotor at each end of its arms, +x to the right and z up. The
/// tilt is 0 where the rotors push straight up; counter-clockwise is positive, so a positive tilt pushes towards -x.
/// Each rotor pushes along the body's own z axis. Drag is a linear force against the velocity (0 for none). The
/// payload sits at the centre of mass.
///
///   m (x'', z'') = (left + right) (-sin tilt, cos tilt) + m (gx, gz) - drag (x', z')
///   J tilt''     = arm (right - left)
template <class S>
struct PlanarQuadrotor {
  static constexpr const char* name = "planar_quadrotor";
  TILLER_FIELDS(State, S, x_m, z_m, tilt_rad, x_m_s, z_m_s, tilt_rad_s);
  TILLER_FIELDS(Input, S, left_N, right_N);
  TILLER_FIELDS(Params, S, mass_kg, arm_m, inertia_kgm2, drag_Ns_m);
  TILLER_FIELDS(Force, S, x_N, z_N, tilt_Nm);
  static constexpr tiller_joint_t joints[] = {{"x", 0, 3, 0, 0}, {"z", 1, 4, 1, 0}, {"tilt", 2, 5, 2, 0}};
  static constexpr unsigned angles = 1u << 2;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S inverse = S(1.0) / (p.mass_kg + body.payload_kg);
    const S inertia = p.inertia_kgm2 + body.payload_kgm2;
    S sine, cosine;
    sincos(x.tilt_rad, sine, cosine);
    const S thrust = u.left_N + u.right_N;
    return {x.x_m_s,
            x.z_m_s,
            x.tilt_rad_s,
            (f.x_N - thrust * sine - p.drag_Ns_m * x.x_m_s) * inverse + body.gravity_x_m_s2,
            (f.z_N + thrust * cosine - p.drag_Ns_m * x.z_m_s) * inverse + body.gravity_z_m_s2,
            (f.tilt_Nm + p.arm_m * (u.right_N - u.left_N)) / inertia};
  }
};

}  // namespace tiller
