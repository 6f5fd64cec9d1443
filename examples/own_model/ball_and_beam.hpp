#pragma once

#include "tiller/model.hpp"

/// A ball that rolls in a groove along a beam; a motor turns the beam about its middle. Position 0 is the pivot,
/// angle 0 is level, a positive angle lifts the +x end. Unstable: the ball runs off unless somebody steers.
///
/// Lagrange's equations of a solid ball (its rolling inertia adds 2/5 of its mass along the beam):
///   7/5 m x''           = m x a'^2 + m (gx cos a + gz sin a) + f_ball
///   (J + m x^2) a''     = torque - 2 m x x' a' + m x (gz cos a - gx sin a) + f_beam
template <class S>
struct BallAndBeam {
  static constexpr const char* name = "ball_and_beam";
  TILLER_FIELDS(State, S, position_m, angle_rad, velocity_m_s, rate_rad_s);
  TILLER_FIELDS(Input, S, torque_Nm);
  TILLER_FIELDS(Params, S, ball_mass_kg, beam_inertia_kgm2);
  TILLER_FIELDS(Force, S, ball_N, beam_Nm);
  static constexpr tiller_joint_t joints[] = {{"ball", 0, 2, 0, 0}, {"beam", 1, 3, 1, 0}};
  static constexpr unsigned angles = 1u << 1;

  static State dynamics(const State& x, const Input& u, const Force& f, const tiller::Body<S>& body, const Params& p) {
    const S mass = p.ball_mass_kg + body.payload_kg;
    const S sine = sin(x.angle_rad), cosine = cos(x.angle_rad);
    const S along = body.gravity_x_m_s2 * cosine + body.gravity_z_m_s2 * sine;
    const S across = body.gravity_z_m_s2 * cosine - body.gravity_x_m_s2 * sine;
    const S moment = mass * x.position_m;
    const S roll = moment * x.rate_rad_s * x.rate_rad_s + mass * along + f.ball_N;
    const S turn = u.torque_Nm + f.beam_Nm + moment * across - 2.0 * moment * x.velocity_m_s * x.rate_rad_s;
    const S inertia = p.beam_inertia_kgm2 + moment * x.position_m + body.payload_kgm2;
    return {x.velocity_m_s, x.rate_rad_s, roll / (1.4 * mass), turn / inertia};
  }
};
