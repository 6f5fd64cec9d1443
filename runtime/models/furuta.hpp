#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// Furuta pendulum (rotary inverted pendulum): a motor turns a level arm about the vertical z axis; a pendulum swings
/// about the arm's own direction at the arm's end. Counter-clockwise from above is positive for the arm, which lies
/// along +x at 0. The pendulum's angle is 0 where it hangs, pi where it stands, and positive on the side to which a
/// positive turn of the arm moves. The payload sits at the pendulum's tip and is felt as a ball.
///
/// Lagrange's equations from the velocity of a point at distance r on the pendulum, with a the arm's angle, p the
/// pendulum's, L the arm's length: (L a' + r cos p p') along the arm's motion, -r sin p a' towards the axis,
/// r sin p p' upwards (as in Cazzolato and Prime 2011, On the dynamics of the Furuta pendulum, whose pendulum turns the
/// same way seen along the arm):
///
///   (J + M L^2 + I sin^2 p) a'' + h cos p p'' + 2 I sin p cos p a' p' - h sin p p'^2 = torque
///    h cos p a''                + I p''       -   I sin p cos p a'^2               = mu (gz sin p - gx sin a cos p)
///
/// M: pendulum and payload; mu: their mass times distance from the hinge; h = mu L; I: their inertia about the hinge;
/// J: the arm's about its axis. The pendulum is slender: it has no inertia about its own length. pendulum_inertia is
/// about its centre of mass. A tilted table (gx) also pulls at the arm, whose mass times the distance of its centre of
/// mass from the axis is arm_moment; on a level table nothing depends on it.
template <class S>
struct Furuta {
  static constexpr const char* name = "furuta";
  TILLER_FIELDS(State, S, arm_rad, pendulum_rad, arm_rad_s, pendulum_rad_s);
  TILLER_FIELDS(Input, S, arm_Nm);
  TILLER_FIELDS(Params, S, arm_length_m, arm_inertia_kgm2, arm_moment_kgm, pendulum_mass_kg, pendulum_length_m,
                pendulum_com_m, pendulum_inertia_kgm2);
  TILLER_FIELDS(Force, S, arm_Nm, pendulum_Nm);
  static constexpr tiller_joint_t joints[] = {{"arm", 0, 2, 0, 1}, {"pendulum", 1, 3, 1, 0}};
  static constexpr unsigned angles = (1u << 0) | (1u << 1);
  static constexpr bool long_dynamics = true;
  TILLER_FIELDS(Output, S, tip_x_m, tip_y_m, tip_z_m);  // of the pendulum, from where the arm meets its axis

  static Output outputs(const State& x, const Params& p) {
    S sine_a, cosine_a, sine, cosine;
    sincos(x.arm_rad, sine_a, cosine_a);
    sincos(x.pendulum_rad, sine, cosine);
    const S aside = p.pendulum_length_m * sine;
    return {p.arm_length_m * cosine_a - aside * sine_a, p.arm_length_m * sine_a + aside * cosine_a,
            -(p.pendulum_length_m * cosine)};
  }

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    S sine_a, cosine_a, sine, cosine;
    sincos(x.arm_rad, sine_a, cosine_a);
    sincos(x.pendulum_rad, sine, cosine);
    const S mass = p.pendulum_mass_kg + body.payload_kg;
    const S moment = p.pendulum_mass_kg * p.pendulum_com_m + body.payload_kg * p.pendulum_length_m;
    const S swing = p.pendulum_inertia_kgm2 + p.pendulum_mass_kg * p.pendulum_com_m * p.pendulum_com_m +
                    body.payload_kg * p.pendulum_length_m * p.pendulum_length_m;
    const S h = moment * p.arm_length_m, swirl = swing * sine * cosine;
    const S m11 = p.arm_inertia_kgm2 + mass * p.arm_length_m * p.arm_length_m + swing * sine * sine + body.payload_kgm2;
    const S m12 = h * cosine, m22 = swing + body.payload_kgm2;
    const S gx = body.gravity_x_m_s2, gz = body.gravity_z_m_s2;
    const S arm_pull = -gx * ((p.arm_moment_kgm + mass * p.arm_length_m) * sine_a + moment * sine * cosine_a);
    const S turn1 =
        u.arm_Nm + f.arm_Nm + arm_pull + x.pendulum_rad_s * (h * sine * x.pendulum_rad_s - swirl * x.arm_rad_s * 2.0);
    const S turn2 = f.pendulum_Nm + moment * (gz * sine - gx * sine_a * cosine) + swirl * x.arm_rad_s * x.arm_rad_s;
    const S inverse = S(1.0) / (m11 * m22 - m12 * m12);
    return {x.arm_rad_s, x.pendulum_rad_s, (m22 * turn1 - m12 * turn2) * inverse,
            (m11 * turn2 - m12 * turn1) * inverse};
  }
};

}  // namespace tiller
