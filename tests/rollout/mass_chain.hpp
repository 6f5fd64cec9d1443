#pragma once

// A model of more states than a shipped build takes: what the kernel makes of it is compiled and tested with limits of
// its own.

#include "tiller/model.hpp"

namespace tiller {

/// Sixteen carts in a row on stiffening springs with dampers, the first one tied to a wall; forces on four of them. A
/// damper between the last cart and the centre of mass makes one row of the Jacobian full.
template <class S>
struct MassChain {
  static constexpr const char* name = "mass_chain";
  TILLER_FIELDS(State, S, x0_m, x1_m, x2_m, x3_m, x4_m, x5_m, x6_m, x7_m, x8_m, x9_m, x10_m, x11_m, x12_m, x13_m, x14_m,
                x15_m, v0_m_s, v1_m_s, v2_m_s, v3_m_s, v4_m_s, v5_m_s, v6_m_s, v7_m_s, v8_m_s, v9_m_s, v10_m_s, v11_m_s,
                v12_m_s, v13_m_s, v14_m_s, v15_m_s);
  TILLER_FIELDS(Input, S, force0_N, force5_N, force10_N, force15_N);
  TILLER_FIELDS(Params, S, mass_kg, stiffness_N_m, stiffening_N_m3, damping_Ns_m);
  TILLER_FIELDS(Force, S, f0_N, f1_N, f2_N, f3_N, f4_N, f5_N, f6_N, f7_N, f8_N, f9_N, f10_N, f11_N, f12_N, f13_N, f14_N,
                f15_N);
  static constexpr tiller_joint_t joints[] = {
      {"cart0", 0, 16, 0, 0},    {"cart1", 1, 17, 1, 0},    {"cart2", 2, 18, 2, 0},    {"cart3", 3, 19, 3, 0},
      {"cart4", 4, 20, 4, 0},    {"cart5", 5, 21, 5, 0},    {"cart6", 6, 22, 6, 0},    {"cart7", 7, 23, 7, 0},
      {"cart8", 8, 24, 8, 0},    {"cart9", 9, 25, 9, 0},    {"cart10", 10, 26, 10, 0}, {"cart11", 11, 27, 11, 0},
      {"cart12", 12, 28, 12, 0}, {"cart13", 13, 29, 13, 0}, {"cart14", 14, 30, 14, 0}, {"cart15", 15, 31, 15, 0}};

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S inverse = S(1.0) / p.mass_kg;
    const auto link = [&](const S& stretch_m, const S& rate_m_s) {
      return stretch_m * (p.stiffness_N_m + p.stiffening_N_m3 * stretch_m * stretch_m) + p.damping_Ns_m * rate_m_s;
    };
    const S l0 = link(x.x0_m, x.v0_m_s);
    const S l1 = link(x.x1_m - x.x0_m, x.v1_m_s - x.v0_m_s);
    const S l2 = link(x.x2_m - x.x1_m, x.v2_m_s - x.v1_m_s);
    const S l3 = link(x.x3_m - x.x2_m, x.v3_m_s - x.v2_m_s);
    const S l4 = link(x.x4_m - x.x3_m, x.v4_m_s - x.v3_m_s);
    const S l5 = link(x.x5_m - x.x4_m, x.v5_m_s - x.v4_m_s);
    const S l6 = link(x.x6_m - x.x5_m, x.v6_m_s - x.v5_m_s);
    const S l7 = link(x.x7_m - x.x6_m, x.v7_m_s - x.v6_m_s);
    const S l8 = link(x.x8_m - x.x7_m, x.v8_m_s - x.v7_m_s);
    const S l9 = link(x.x9_m - x.x8_m, x.v9_m_s - x.v8_m_s);
    const S l10 = link(x.x10_m - x.x9_m, x.v10_m_s - x.v9_m_s);
    const S l11 = link(x.x11_m - x.x10_m, x.v11_m_s - x.v10_m_s);
    const S l12 = link(x.x12_m - x.x11_m, x.v12_m_s - x.v11_m_s);
    const S l13 = link(x.x13_m - x.x12_m, x.v13_m_s - x.v12_m_s);
    const S l14 = link(x.x14_m - x.x13_m, x.v14_m_s - x.v13_m_s);
    const S l15 = link(x.x15_m - x.x14_m, x.v15_m_s - x.v14_m_s);
    const S centre_m_s =
        S(0.0625) * (x.v0_m_s + x.v1_m_s + x.v2_m_s + x.v3_m_s + x.v4_m_s + x.v5_m_s + x.v6_m_s + x.v7_m_s + x.v8_m_s +
                     x.v9_m_s + x.v10_m_s + x.v11_m_s + x.v12_m_s + x.v13_m_s + x.v14_m_s + x.v15_m_s);
    const auto speed_up = [&](const S& force_N) { return force_N * inverse + body.gravity_x_m_s2; };
    return {x.v0_m_s,
            x.v1_m_s,
            x.v2_m_s,
            x.v3_m_s,
            x.v4_m_s,
            x.v5_m_s,
            x.v6_m_s,
            x.v7_m_s,
            x.v8_m_s,
            x.v9_m_s,
            x.v10_m_s,
            x.v11_m_s,
            x.v12_m_s,
            x.v13_m_s,
            x.v14_m_s,
            x.v15_m_s,
            speed_up(f.f0_N - l0 + l1 + u.force0_N),
            speed_up(f.f1_N - l1 + l2),
            speed_up(f.f2_N - l2 + l3),
            speed_up(f.f3_N - l3 + l4),
            speed_up(f.f4_N - l4 + l5),
            speed_up(f.f5_N - l5 + l6 + u.force5_N),
            speed_up(f.f6_N - l6 + l7),
            speed_up(f.f7_N - l7 + l8),
            speed_up(f.f8_N - l8 + l9),
            speed_up(f.f9_N - l9 + l10),
            speed_up(f.f10_N - l10 + l11 + u.force10_N),
            speed_up(f.f11_N - l11 + l12),
            speed_up(f.f12_N - l12 + l13),
            speed_up(f.f13_N - l13 + l14),
            speed_up(f.f14_N - l14 + l15),
            speed_up(f.f15_N - l15 + u.force15_N - p.damping_Ns_m * (x.v15_m_s - centre_m_s))};
  }
};

}  // namespace tiller
