#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// Acrobot (Spong 1995, The swing up control problem for the acrobot): two rods in a vertical plane, hinged at the
/// shoulder to the ground and at the elbow to each other, with a motor at the elbow alone. The shoulder's angle is 0
/// where the upper rod hangs down, the elbow's where the lower rod goes straight on; counter-clockwise is positive, so
/// (pi, 0) stands upright. The payload sits at the lower rod's tip.
///
/// M(q) q'' + c(q, q') = gravity + forces, by Lagrange; M is solved by hand with one division:
///   M11 = J1 + J2 + 2 h cos(q2), M12 = J2 + h cos(q2), M22 = J2,   h = l1 (m2 lc2 + payload l2)
/// where J1 and J2 are the rods' inertias about the shoulder and the elbow, with the lower rod's mass at the elbow in
/// J1. Inertias in the parameters are about the rods' own centres of mass.
template <class S>
struct Acrobot {
  static constexpr const char* name = "acrobot";
  TILLER_FIELDS(State, S, shoulder_rad, elbow_rad, shoulder_rad_s, elbow_rad_s);
  TILLER_FIELDS(Input, S, elbow_Nm);
  TILLER_FIELDS(Params, S, upper_mass_kg, lower_mass_kg, upper_length_m, lower_length_m, upper_com_m, lower_com_m,
                upper_inertia_kgm2, lower_inertia_kgm2);
  TILLER_FIELDS(Force, S, shoulder_Nm, elbow_Nm);
  static constexpr tiller_joint_t joints[] = {{"shoulder", 0, 2, 0, 0}, {"elbow", 1, 3, 1, 1}};
  static constexpr unsigned angles = (1u << 0) | (1u << 1);
  static constexpr bool long_dynamics = true;
  TILLER_FIELDS(Output, S, tip_x_m, tip_z_m);  // of the lower rod, from the shoulder

  static Output outputs(const State& x, const Params& p) {
    S sine, cosine, sine1, cosine1;
    sincos(x.elbow_rad, sine, cosine);
    sincos(x.shoulder_rad, sine1, cosine1);
    const S sine12 = sine1 * cosine + cosine1 * sine, cosine12 = cosine1 * cosine - sine1 * sine;
    return {p.upper_length_m * sine1 + p.lower_length_m * sine12,
            -(p.upper_length_m * cosine1 + p.lower_length_m * cosine12)};
  }

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S beyond = p.lower_mass_kg + body.payload_kg;  // hangs on the elbow
    const S upper_moment = p.upper_mass_kg * p.upper_com_m + beyond * p.upper_length_m;
    const S lower_moment = p.lower_mass_kg * p.lower_com_m + body.payload_kg * p.lower_length_m;
    const S j1 = p.upper_inertia_kgm2 + p.upper_mass_kg * p.upper_com_m * p.upper_com_m +
                 beyond * p.upper_length_m * p.upper_length_m;
    const S j2 = p.lower_inertia_kgm2 + p.lower_mass_kg * p.lower_com_m * p.lower_com_m + body.payload_kgm2 +
                 body.payload_kg * p.lower_length_m * p.lower_length_m;
    S sine, cosine, sine1, cosine1;
    sincos(x.elbow_rad, sine, cosine);
    sincos(x.shoulder_rad, sine1, cosine1);
    const S sine12 = sine1 * cosine + cosine1 * sine, cosine12 = cosine1 * cosine - sine1 * sine;
    const S h = p.upper_length_m * lower_moment;
    const S m11 = j1 + j2 + h * cosine * 2.0, m12 = j2 + h * cosine;
    // gravity pulls at a point l (sin q, -cos q) with the torque m l (gx cos q + gz sin q)
    const S lower_pull = lower_moment * (body.gravity_x_m_s2 * cosine12 + body.gravity_z_m_s2 * sine12);
    const S upper_pull = upper_moment * (body.gravity_x_m_s2 * cosine1 + body.gravity_z_m_s2 * sine1);
    const S swirl = h * sine;
    const S turn1 =
        f.shoulder_Nm + upper_pull + lower_pull + swirl * x.elbow_rad_s * (x.shoulder_rad_s * 2.0 + x.elbow_rad_s);
    const S turn2 = u.elbow_Nm + f.elbow_Nm + lower_pull - swirl * x.shoulder_rad_s * x.shoulder_rad_s;
    const S inverse = S(1.0) / (m11 * j2 - m12 * m12);
    return {x.shoulder_rad_s, x.elbow_rad_s, (j2 * turn1 - m12 * turn2) * inverse,
            (m11 * turn2 - m12 * turn1) * inverse};
  }
};

}  // namespace tiller
