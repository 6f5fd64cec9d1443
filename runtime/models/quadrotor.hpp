#pragma once

#include "tiller/model.hpp"
#include "tiller/rotation.hpp"

namespace tiller {

/// Quadrotor in space: a rigid body with four rotors in an X, at arm_m from the centre of mass and 45 degrees off the
/// body's axes (x forward, y left, z up). The attitude takes vectors of the body to the world, whose z points up; rates
/// are along the body's axes. Each rotor pushes along the body's z and turns the body against its own sense: front left
/// and rear right turn clockwise as seen from above, so they yaw the body to the left. Drag is a linear force against
/// the velocity (0 for none). The payload sits at the centre of mass.
///
///   m v'      = R (0, 0, T) + m g - drag v,  T the sum of thrusts
///   q'        = 1/2 q (x) (0, rate)
///   J rate'   = torque - rate x J rate
///   torque    = (arm / sqrt 2) (fl - fr + rl - rr, rl + rr - fl - fr), yaw_moment (fl - fr - rl + rr)
///
/// (Mahony, Kumar and Corke 2012, Multirotor Aerial Vehicles, equations 1, 2 and 7.) Forces act at the centre of mass
/// along the world's axes, torques along the body's. Only x, y and z are joints with a position: a rate is no
/// quaternion's derivative, so roll, pitch and yaw are ports on velocities.
template <class S>
struct Quadrotor {
  static constexpr const char* name = "quadrotor";
  TILLER_FIELDS(State, S, x_m, y_m, z_m, attitude_w, attitude_x, attitude_y, attitude_z, x_m_s, y_m_s, z_m_s,
                roll_rad_s, pitch_rad_s, yaw_rad_s);
  TILLER_FIELDS(Input, S, front_left_N, front_right_N, rear_left_N, rear_right_N);
  TILLER_FIELDS(Params, S, mass_kg, arm_m, inertia_x_kgm2, inertia_y_kgm2, inertia_z_kgm2, yaw_moment_m, drag_Ns_m);
  TILLER_FIELDS(Force, S, x_N, y_N, z_N, roll_Nm, pitch_Nm, yaw_Nm);
  static constexpr tiller_joint_t joints[] = {{"x", 0, 7, 0, 0},
                                              {"y", 1, 8, 1, 0},
                                              {"z", 2, 9, 2, 0},
                                              {"roll", TILLER_NO_POSITION, 10, 3, 0},
                                              {"pitch", TILLER_NO_POSITION, 11, 4, 0},
                                              {"yaw", TILLER_NO_POSITION, 12, 5, 0}};
  static constexpr unsigned quaternions = 1u << 3;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const Quaternion<S> attitude = {x.attitude_w, x.attitude_x, x.attitude_y, x.attitude_z};
    const Vector3<S> rate = {x.roll_rad_s, x.pitch_rad_s, x.yaw_rad_s};
    const Quaternion<S> turning = attitude_rate(attitude, rate);
    // the body's z axis in the world
    const S up_x = S(2.0) * (attitude.x * attitude.z + attitude.w * attitude.y);
    const S up_y = S(2.0) * (attitude.y * attitude.z - attitude.w * attitude.x);
    const S up_z = S(1.0) - S(2.0) * (attitude.x * attitude.x + attitude.y * attitude.y);
    const S left = u.front_left_N + u.rear_left_N, right = u.front_right_N + u.rear_right_N;
    const S across = u.front_left_N + u.rear_right_N - u.front_right_N - u.rear_left_N;
    const S thrust = left + right, lever = S(0.70710678118654752) * p.arm_m;
    const S inverse = S(1.0) / (p.mass_kg + body.payload_kg);
    const S jx = p.inertia_x_kgm2 + body.payload_kgm2, jy = p.inertia_y_kgm2 + body.payload_kgm2;
    const S jz = p.inertia_z_kgm2 + body.payload_kgm2;
    const S roll_Nm = f.roll_Nm + lever * (left - right);
    const S pitch_Nm = f.pitch_Nm + lever * (u.rear_left_N + u.rear_right_N - u.front_left_N - u.front_right_N);
    const S yaw_Nm = f.yaw_Nm + p.yaw_moment_m * across;
    return {x.x_m_s,
            x.y_m_s,
            x.z_m_s,
            turning.w,
            turning.x,
            turning.y,
            turning.z,
            (f.x_N + thrust * up_x - p.drag_Ns_m * x.x_m_s) * inverse + body.gravity_x_m_s2,
            (f.y_N + thrust * up_y - p.drag_Ns_m * x.y_m_s) * inverse,
            (f.z_N + thrust * up_z - p.drag_Ns_m * x.z_m_s) * inverse + body.gravity_z_m_s2,
            (roll_Nm + (jy - jz) * rate.y * rate.z) / jx,
            (pitch_Nm + (jz - jx) * rate.z * rate.x) / jy,
            (yaw_Nm + (jx - jy) * rate.x * rate.y) / jz};
  }
};

}  // namespace tiller
