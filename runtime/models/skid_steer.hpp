#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// Skid-steer base, as its wheels' speeds drive it: both wheels of a side turn together, and to turn the base they slip
/// (Mandow et al. 2007, Experimental kinematics for wheeled skid-steer mobile robots; the three parameters are those of
/// Barcelos et al. 2020, DISCO). Kinematic: no forces, no joints. Heading 0 is along x; counter-clockwise is positive.
///
///   v_x = radius (left + right) / 2,  heading' = radius (right - left) / axle,  v_y = -icr_offset heading'
///
/// v_x and v_y are the velocities of the base's origin along its own axes. `axle_m` is the distance of the sides'
/// instantaneous centres of rotation, which slip moves out beyond the wheels: it is larger than the track.
/// `icr_offset_m` is the x of these centres, positive ahead of the origin: the point (icr_offset, 0) of the base does
/// not move sideways, so in a turn to the left the origin drifts to the right where it is positive.
template <class S>
struct SkidSteer {
  static constexpr const char* name = "skid_steer";
  TILLER_FIELDS(State, S, x_m, y_m, heading_rad);
  TILLER_FIELDS(Input, S, left_rad_s, right_rad_s);
  TILLER_FIELDS(Params, S, wheel_radius_m, axle_m, icr_offset_m);
  static constexpr unsigned angles = 1u << 2;

  static State dynamics(const State& x, const Input& u, const Body<S>&, const Params& p) {
    S sine, cosine;
    sincos(x.heading_rad, sine, cosine);
    const S turn = p.wheel_radius_m * (u.right_rad_s - u.left_rad_s) / p.axle_m;
    const S ahead = p.wheel_radius_m * (u.left_rad_s + u.right_rad_s) * 0.5;
    const S aside = -p.icr_offset_m * turn;
    return {ahead * cosine - aside * sine, ahead * sine + aside * cosine, turn};
  }
};

}  // namespace tiller
