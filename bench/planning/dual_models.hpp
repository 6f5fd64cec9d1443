#pragma once

// Models of the tasks of bench_dual: each has a parameter that its own motion does not show before it matters.

#include "tiller/model.hpp"

namespace tiller {

/// A car on a straight road whose tyres hold so much: the drive's and the brakes' acceleration is cut to grip * g.
///
///   v' = cut(u, +- grip * g) + f / 1000 kg
template <class S>
struct BrakingCar {
  static constexpr const char* name = "braking_car";
  TILLER_FIELDS(State, S, position_m, speed_m_s);
  TILLER_FIELDS(Input, S, drive_m_s2);
  TILLER_FIELDS(Params, S, grip);
  TILLER_FIELDS(Force, S, along_N);
  static constexpr tiller_joint_t joints[] = {{"road", 0, 1, 0, 1}};
  static constexpr unsigned angles = 0;
  static constexpr double kMass_kg = 1000.0, kGravity_m_s2 = 9.81;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S most = p.grip * S(kGravity_m_s2);
    const S held = min(max(u.drive_m_s2, -most), most);
    return {x.speed_m_s, held + f.along_N / S(kMass_kg) + body.gravity_x_m_s2};
  }
};

/// A rod on a hinge at its lower end, and a motor whose wires may be the wrong way round: of `side` below 0 the torque
/// is reversed. 0 is upright.
///
///   angle'' = growth^2 sin angle + gain u + f,   gain = +- (0.6 + 0.4 |side|)
template <class S>
struct SignedBalancer {
  static constexpr const char* name = "signed_balancer";
  TILLER_FIELDS(State, S, angle_rad, rate_rad_s);
  TILLER_FIELDS(Input, S, motor_rad_s2);
  TILLER_FIELDS(Params, S, side);
  TILLER_FIELDS(Force, S, hinge_Nm);
  static constexpr tiller_joint_t joints[] = {{"hinge", 0, 1, 0, 1}};
  static constexpr unsigned angles = 1u << 0;
  static constexpr double kGrowth = 3.0;  // 1/s

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>&, const Params& p) {
    const S size = S(0.6) + S(0.4) * abs(p.side);
    const S gain = select(p.side < S(0.0), -size, size);
    return {x.rate_rad_s, S(kGrowth * kGrowth) * sin(x.angle_rad) + gain * u.motor_rad_s2 + f.hinge_Nm};
  }
};

/// A telescopic arm on a lift. Springs carry its weight, so that only what the load weighs bends it: the tip hangs
/// below the lift by compliance * load * reach^2, which nothing measures. In a wall at kWall_m is a slot at height 0.
template <class S>
struct SaggingArm {
  static constexpr const char* name = "sagging_arm";
  TILLER_FIELDS(State, S, reach_m, lift_m, reach_m_s, lift_m_s);
  TILLER_FIELDS(Input, S, reach_N, lift_N);
  TILLER_FIELDS(Params, S, load_kg);
  TILLER_FIELDS(Force, S, along_N, up_N);
  TILLER_FIELDS(Output, S, off_slot_m);  // of the tip from the slot's middle, where it passes the wall; else towards 0
  static constexpr tiller_joint_t joints[] = {{"reach", 0, 2, 0, 1}, {"lift", 1, 3, 1, 2}};
  static constexpr unsigned angles = 0;
  static constexpr double kArm_kg = 1.0, kCompliance = 0.12, kWall_m = 0.7, kThickness_m = 0.12;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S inverse = S(1.0) / (S(kArm_kg) + p.load_kg + body.payload_kg);
    return {x.reach_m_s, x.lift_m_s, (u.reach_N + f.along_N) * inverse, (u.lift_N + f.up_N) * inverse};
  }
  static Output outputs(const State& x, const Params& p) {
    const S sag = S(kCompliance) * p.load_kg * x.reach_m * x.reach_m;
    const S away = (x.reach_m - S(kWall_m)) * S(1.0 / kThickness_m);
    return {(x.lift_m - sag) * exp(-(away * away))};
  }
};

/// The planar quadrotor (axes and signs of PlanarQuadrotor, 0.5 kg) whose left rotor gives no more than `most_N`,
/// whatever is asked of it: in hover it is as good as the other one.
template <class S>
struct WeakQuadrotor {
  static constexpr const char* name = "weak_quadrotor";
  TILLER_FIELDS(State, S, x_m, z_m, tilt_rad, x_m_s, z_m_s, tilt_rad_s);
  TILLER_FIELDS(Input, S, left_N, right_N);
  TILLER_FIELDS(Params, S, most_N);
  TILLER_FIELDS(Force, S, along_x_N, along_z_N, tilt_Nm);
  static constexpr tiller_joint_t joints[] = {{"x", 0, 3, 0, 0}, {"z", 1, 4, 1, 0}, {"tilt", 2, 5, 2, 0}};
  static constexpr unsigned angles = 1u << 2;
  static constexpr double kMass_kg = 0.5, kArm_m = 0.15, kInertia_kgm2 = 0.005, kDrag_Ns_m = 0.1;

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    const S inverse = S(1.0) / (S(kMass_kg) + body.payload_kg), left = min(u.left_N, p.most_N);
    S sine, cosine;
    sincos(x.tilt_rad, sine, cosine);
    const S thrust = left + u.right_N;
    return {x.x_m_s,
            x.z_m_s,
            x.tilt_rad_s,
            (f.along_x_N - thrust * sine - S(kDrag_Ns_m) * x.x_m_s) * inverse + body.gravity_x_m_s2,
            (f.along_z_N + thrust * cosine - S(kDrag_Ns_m) * x.z_m_s) * inverse + body.gravity_z_m_s2,
            (f.tilt_Nm + S(kArm_m) * (u.right_N - left)) / (S(kInertia_kgm2) + body.payload_kgm2)};
  }
};

namespace bench {

const tiller_model_t& braking_car_model();
const tiller_model_t& signed_balancer_model();
const tiller_model_t& sagging_arm_model();
const tiller_model_t& weak_quadrotor_model();

}  // namespace bench
}  // namespace tiller
