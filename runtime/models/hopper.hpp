#pragma once

#include "tiller/model.hpp"

namespace tiller {

/// One-legged hopper in a vertical plane (after Raibert 1986, Legged robots that balance), +x to the right and z up: a
/// body with a hip at its centre of mass, a leg that turns about the hip and changes its length, a point mass as foot.
/// The leg itself has no mass. Angles are counter-clockwise; pitch 0 is level, hip 0 points the leg along the body's
/// own -z axis. A spring with a damper stands beside the leg's motor, so the leg pushes with
/// stiffness (rest - length) - damping length' + force. The ground is z = 0. The payload sits at the body's centre.
///
/// Body and foot are two masses that pull at each other along the leg (e_r) and across it (e_t), so nothing has to be
/// inverted: with F the leg's push, T the hip's torque, l the length, q = pitch + hip and R the ground's push,
///
///   body: m a = m g - F e_r - T/l e_t,   foot: m a = m g + F e_r + T/l e_t + R,   pitch: J pitch'' = -T,
///   l'' = (a_foot - a_body) e_r + l q'^2,   l q'' = (a_foot - a_body) e_t - 2 l' q'.
///
/// Contact is a closed form (no complementarity, no iteration; the idea of Jin 2024, arXiv 2408.07855): the ground
/// pushes as hard as it takes to bring the foot's predicted gap, height + settle * speed, to 0 within the time
/// settle, and never pulls; across, as hard as it takes to bring the slip to 0 in that time, within the cone of
/// ground_friction. What the leg pushes with is cancelled exactly, so a foot on the ground neither sinks in nor creeps
/// under load. Maximum and clamp are smooth (hyperbolas, kSmooth_N from their corners), so derivatives exist through
/// touchdown, sticking and slipping. Stiffness and damping follow from the foot's mass and settle alone:
/// the steps stay stable up to 1.2 settle (semi-implicit Euler), 2 settle (midpoint), 2.6 settle (RK4), whatever the
/// robot weighs. Forces of effects at the joints are not cancelled: 1 N lets a foot of 0.5 kg sink by 0.02 mm.
template <class S>
struct Hopper {
  static constexpr const char* name = "hopper";
  TILLER_FIELDS(State, S, x_m, z_m, pitch_rad, hip_rad, leg_m, x_m_s, z_m_s, pitch_rad_s, hip_rad_s, leg_m_s);
  TILLER_FIELDS(Input, S, hip_Nm, leg_N);
  TILLER_FIELDS(Params, S, body_mass_kg, body_inertia_kgm2, foot_mass_kg, leg_rest_m, leg_stiffness_N_m,
                leg_damping_Ns_m, ground_friction);
  TILLER_FIELDS(Force, S, x_N, z_N, pitch_Nm, hip_Nm, leg_N);
  static constexpr tiller_joint_t joints[] = {
      {"x", 0, 5, 0, 0}, {"z", 1, 6, 1, 0}, {"pitch", 2, 7, 2, 0}, {"hip", 3, 8, 3, 1}, {"leg", 4, 9, 4, 2}};
  static constexpr unsigned angles = (1u << 2) | (1u << 3);
  static constexpr bool long_dynamics = true;
  TILLER_FIELDS(Output, S, foot_x_m, foot_z_m);

  static constexpr double kSettle_s = 0.003;
  static constexpr double kSmooth_N = 2.0;
  static constexpr double kShortest_m = 0.05;  // a shorter leg turns at finite rates, too
  static constexpr double kDeepest_m = 0.02;   // what is deeper in the ground is not thrown out faster

  static Output outputs(const State& x, const Params&) {
    S sine, cosine;
    sincos(x.pitch_rad + x.hip_rad, sine, cosine);
    return {x.x_m + x.leg_m * sine, x.z_m - x.leg_m * cosine};
  }

  /// max(y, 0) with a corner that is kSmooth_N wide; below 0 in a form that does not lose its digits.
  static S push_only(const S& y) {
    const S root = sqrt(y * y + kSmooth_N * kSmooth_N);
    return select(y > S(0.0), (y + root) * 0.5, S(0.5 * kSmooth_N * kSmooth_N) / (root + abs(y)));
  }
  /// y between -most and most, corners as wide: half the difference of two hyperbolas.
  static S within(const S& y, const S& most) {
    const S above = y + most, below = y - most;
    const S roots = sqrt(above * above + kSmooth_N * kSmooth_N) + sqrt(below * below + kSmooth_N * kSmooth_N);
    return y * most * 2.0 / roots;
  }

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    constexpr double rate = 1.0 / kSettle_s;
    S sine, cosine;
    sincos(x.pitch_rad + x.hip_rad, sine, cosine);  // e_r = (sine, -cosine), e_t = (cosine, sine)
    const S turn = x.pitch_rad_s + x.hip_rad_s;
    const S inverse_leg = x.leg_m / max(x.leg_m * x.leg_m, S(kShortest_m * kShortest_m));
    const S inverse_body = S(1.0) / (p.body_mass_kg + body.payload_kg);
    const S inverse_foot = S(1.0) / p.foot_mass_kg;

    // what the leg does to the foot
    const S push = p.leg_stiffness_N_m * (p.leg_rest_m - x.leg_m) - p.leg_damping_Ns_m * x.leg_m_s + u.leg_N;
    const S across = u.hip_Nm * inverse_leg;
    const S pull_x = push * sine + across * cosine + p.foot_mass_kg * body.gravity_x_m_s2;
    const S pull_z = across * sine - push * cosine + p.foot_mass_kg * body.gravity_z_m_s2;

    const S swing = x.leg_m * turn;
    const S foot_z = x.z_m - x.leg_m * cosine;
    const S foot_x_m_s = x.x_m_s + x.leg_m_s * sine + swing * cosine;
    const S foot_z_m_s = x.z_m_s - x.leg_m_s * cosine + swing * sine;
    const S stop = p.foot_mass_kg * rate;
    const S normal = push_only(-(stop * (foot_z_m_s + max(foot_z, S(-kDeepest_m)) * rate) + pull_z));
    const S grip = within(stop * foot_x_m_s + pull_x, p.ground_friction * normal);

    const S more_across = across + f.hip_Nm * inverse_leg, more_push = push + f.leg_N;
    const S body_x = (f.x_N - more_push * sine - more_across * cosine) * inverse_body + body.gravity_x_m_s2;
    const S body_z = (f.z_N + more_push * cosine - more_across * sine) * inverse_body + body.gravity_z_m_s2;
    const S extra_across = f.hip_Nm * inverse_leg;
    const S apart_x = (pull_x - grip + f.leg_N * sine + extra_across * cosine) * inverse_foot - body_x;
    const S apart_z = (pull_z + normal - f.leg_N * cosine + extra_across * sine) * inverse_foot - body_z;
    const S pitch = (f.pitch_Nm - u.hip_Nm - f.hip_Nm) / (p.body_inertia_kgm2 + body.payload_kgm2);
    const S leg_turn = (apart_x * cosine + apart_z * sine - x.leg_m_s * turn * 2.0) * inverse_leg;
    return {x.x_m_s, x.z_m_s, x.pitch_rad_s, x.hip_rad_s,      x.leg_m_s,
            body_x,  body_z,  pitch,         leg_turn - pitch, apart_x * sine - apart_z * cosine + swing * turn};
  }
};

}  // namespace tiller
