#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// Cart on a rail with a uniform rod hinged to it. Angle 0 stands upright, pi hangs; a positive angle leans towards
/// +x. The payload sits at the rod's tip.
///
/// Lagrange's equations with A the whole mass, h the rod's first moment and J its inertia, both about the hinge:
///   A x'' + h cos(a) a'' = F + A gx + h sin(a) a'^2
///   h cos(a) x'' + J a'' = torque + h (gx cos(a) - gz sin(a))
/// solved by hand: one division a call.
template <class S>
struct CartPole {
  static constexpr const char* name = "cart_pole";
  TILLER_FIELDS(State, S, position_m, angle_rad, velocity_m_s, rate_rad_s);
  TILLER_FIELDS(Input, S, force_N);
  TILLER_FIELDS(Params, S, cart_mass_kg, pole_mass_kg, half_length_m);
  TILLER_FIELDS(Force, S, cart_N, pole_Nm);
  static constexpr tiller_joint_t joints[] = {{"cart", 0, 2, 0, 1}, {"pole", 1, 3, 1, 0}};
  static constexpr unsigned angles = 1u << 1;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S tip = p.half_length_m * 2.0;
    const S all = p.cart_mass_kg + p.pole_mass_kg + body.payload_kg;
    const S moment = p.pole_mass_kg * p.half_length_m + body.payload_kg * tip;
    const S inertia = p.pole_mass_kg * p.half_length_m * p.half_length_m * (4.0 / 3.0) + body.payload_kg * tip * tip +
                      body.payload_kgm2;
    S sine, cosine;
    sincos(x.angle_rad, sine, cosine);
    const S coupling = moment * cosine;
    const S push = u.force_N + f.cart_N + all * body.gravity_x_m_s2 + moment * sine * x.rate_rad_s * x.rate_rad_s;
    const S turn = f.pole_Nm + moment * (body.gravity_x_m_s2 * cosine - body.gravity_z_m_s2 * sine);
    const S inverse = S(1.0) / (all * inertia - coupling * coupling);
    return {x.velocity_m_s, x.rate_rad_s, (inertia * push - coupling * turn) * inverse,
            (all * turn - coupling * push) * inverse};
  }
};

}  // namespace tiller
