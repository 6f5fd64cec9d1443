#pragma once

#include "tiller/model.hpp"

/// A pendulum whose drive swallows the first part of every torque: within +-dead_zone_Nm the joint gets nothing, and
/// beyond it the rest. An alternative to dry friction for gears, and hard to tell from it: friction takes its torque
/// only where the joint moves, a dead zone wherever the motor pushes.
template <class S>
struct DeadZonePendulum {
  static constexpr const char* name = "dead_zone_pendulum";
  TILLER_FIELDS(State, S, angle_rad, rate_rad_s);
  TILLER_FIELDS(Input, S, torque_Nm);
  TILLER_FIELDS(Params, S, mass_kg, length_m, dead_zone_Nm, torque_gain);
  TILLER_FIELDS(Force, S, joint_Nm);
  static constexpr tiller_joint_t joints[] = {{"joint", 0, 1, 0, 1}};
  static constexpr unsigned angles = 1u << 0;

  /// Continuous, so that sampled plans and derivatives behave: u - d above d, u + d below -d, else 0.
  static S pass_dead_zone(const S& torque, const S& half_width) {
    using namespace tiller;  // max of plain numbers
    const S zero(0.0);
    return max(torque - half_width, zero) - max(zero - torque - half_width, zero);
  }

  static State dynamics(const State& x, const Input& u, const Force& f, const tiller::Body<S>& body, const Params& p) {
    const S mass = p.mass_kg + body.payload_kg;
    const S inertia = mass * p.length_m * p.length_m + body.payload_kgm2;
    const S gravity =
        mass * p.length_m * (body.gravity_x_m_s2 * cos(x.angle_rad) + body.gravity_z_m_s2 * sin(x.angle_rad));
    const S drive = p.torque_gain * pass_dead_zone(u.torque_Nm, p.dead_zone_Nm);
    return {x.rate_rad_s, (drive + f.joint_Nm + gravity) / inertia};
  }
};
