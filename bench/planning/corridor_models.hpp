#pragma once

// Models of the tasks of bench_corridors, with the obstacles that their outputs measure the distance to.

#include "tiller/model.hpp"

namespace tiller {

/// A point mass with a force along each axis, between the sixteen squares of the map of Barcelos et al. (RSS 2021):
/// 2.1 m wide, their centres at -6, -2, 2 and 6 m in x and y.
///
///   m (x'', y'') = force - damping (x', y') + m (gx, 0)
template <class S>
struct GridPointMass {
  static constexpr const char* name = "grid_point_mass";
  TILLER_FIELDS(State, S, x_m, y_m, x_m_s, y_m_s);
  TILLER_FIELDS(Input, S, x_N, y_N);
  TILLER_FIELDS(Params, S, mass_kg, damping_Ns_m);
  TILLER_FIELDS(Force, S, along_x_N, along_y_N);
  TILLER_FIELDS(Output, S, depth_m);  // below the nearest side of the nearest square; negative outside
  static constexpr tiller_joint_t joints[] = {{"x", 0, 2, 0, 1}, {"y", 1, 3, 1, 2}};
  static constexpr unsigned angles = 0;
  static constexpr double kHalfWidth_m = 1.05, kInner_m = 2.0, kOuter_m = 6.0;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S inverse = S(1.0) / (p.mass_kg + body.payload_kg);
    return {x.x_m_s, x.y_m_s, (u.x_N + f.along_x_N - p.damping_Ns_m * x.x_m_s) * inverse + body.gravity_x_m_s2,
            (u.y_N + f.along_y_N - p.damping_Ns_m * x.y_m_s) * inverse};
  }
  static Output outputs(const State& x, const Params&) {
    return {S(kHalfWidth_m) - max(from_centre(x.x_m), from_centre(x.y_m))};
  }

 private:
  /// Distance to the nearest row of centres: the rows lie alike on both sides of zero.
  static S from_centre(const S& along) {
    const S a = abs(along);
    return min(abs(a - S(kInner_m)), abs(a - S(kOuter_m)));
  }
};

/// Round posts that leave one gap in each of two walls.
struct GatePosts {
  static constexpr int kCount = 8;
  static constexpr double kRadius_m = 0.3;
  static constexpr double x_m[kCount] = {-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0};
  static constexpr double z_m[kCount] = {1.8, 1.2, -0.7, -1.3, 1.5, 0.9, 0.3, -1.6};
};

/// A quadrotor in a vertical plane (axes and signs of PlanarQuadrotor) with a load on a massless, taut cable from its
/// centre of mass. The cable's angle is 0 where the load hangs below; a positive angle brings it to +x.
///
/// Lagrange's equations with P the rotors' push, e = (cos a, sin a), q = (sin a, -cos a) and w the acceleration less
/// gravity:
///   (M + m) w + m l (a'' e - a'^2 q) = P
///   m l e w + m l^2 a''              = torque at the cable's hinge
/// solved by hand: a'' from the first along e, then w.
template <class S>
struct SlungQuadrotor {
  static constexpr const char* name = "slung_quadrotor";
  TILLER_FIELDS(State, S, x_m, z_m, tilt_rad, cable_rad, x_m_s, z_m_s, tilt_rad_s, cable_rad_s);
  TILLER_FIELDS(Input, S, left_N, right_N);
  TILLER_FIELDS(Params, S, mass_kg, inertia_kgm2, load_kg, cable_m);
  TILLER_FIELDS(Force, S, along_x_N, along_z_N, tilt_Nm, cable_Nm);
  TILLER_FIELDS(Output, S, load_gap_m);  // from the load's centre to the nearest post
  static constexpr tiller_joint_t joints[] = {
      {"x", 0, 4, 0, 0}, {"z", 1, 5, 1, 0}, {"tilt", 2, 6, 2, 0}, {"cable", 3, 7, 3, 0}};
  static constexpr unsigned angles = 1u << 2 | 1u << 3;
  static constexpr double kArm_m = 0.15;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S mass = p.mass_kg + body.payload_kg;
    S sine, cosine, sine_cable, cosine_cable;
    sincos(x.tilt_rad, sine, cosine);
    sincos(x.cable_rad, sine_cable, cosine_cable);
    const S thrust = u.left_N + u.right_N;
    const S push_x = f.along_x_N - thrust * sine, push_z = f.along_z_N + thrust * cosine;
    const S all = mass + p.load_kg, moment = p.load_kg * p.cable_m;
    const S swing = (all * f.cable_Nm / moment - push_x * cosine_cable - push_z * sine_cable) / (mass * p.cable_m);
    const S pull = x.cable_rad_s * x.cable_rad_s;
    const S inverse = S(1.0) / all;
    return {x.x_m_s,
            x.z_m_s,
            x.tilt_rad_s,
            x.cable_rad_s,
            (push_x - moment * (swing * cosine_cable - pull * sine_cable)) * inverse + body.gravity_x_m_s2,
            (push_z - moment * (swing * sine_cable + pull * cosine_cable)) * inverse + body.gravity_z_m_s2,
            (f.tilt_Nm + kArm_m * (u.right_N - u.left_N)) / (p.inertia_kgm2 + body.payload_kgm2),
            swing};
  }
  static Output outputs(const State& x, const Params& p) {
    S sine, cosine;
    sincos(x.cable_rad, sine, cosine);
    const S load_x = x.x_m + p.cable_m * sine, load_z = x.z_m - p.cable_m * cosine;
    S nearest = S(1e6);
    for (int i = 0; i < GatePosts::kCount; ++i) {
      const S dx = load_x - S(GatePosts::x_m[i]), dz = load_z - S(GatePosts::z_m[i]);
      nearest = min(nearest, dx * dx + dz * dz);
    }
    return {sqrt(nearest) - S(GatePosts::kRadius_m)};
  }
};

namespace bench {

const tiller_model_t& grid_point_mass_model();
const tiller_model_t& slung_quadrotor_model();

}  // namespace bench
}  // namespace tiller
