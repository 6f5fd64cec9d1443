#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A spring between the motor's rotor and the joint: a harmonic drive, a belt, a long shaft. The command turns the
/// rotor, a second body with its own velocity; the twisted spring turns the joint. States: the twist, the rotor's
/// velocity, and whether it has begun (it begins untwisted at the joint's velocity). Twist, both velocities and the
/// spring's force are solved together by the implicit midpoint rule, which keeps the energy of the resonance at any
/// step; the limit of a stiff spring is a rotor that moves with the joint. stiffness 0 or inertia 0: what the command
/// says acts.
template <class S>
struct ElasticJoint {
  static constexpr Hook hook = Hook::drive;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "elastic_joint";
    i.port = PortKind::input;
    i.param_count = 3;
    i.params[0] = {"stiffness_SI",          "N/m or N m/rad", 0.0, __builtin_huge_val(), Scale::stiffness, 4,
                   {2.0, 10.0, 50.0, 300.0}};
    i.params[1] = {"rotor_inertia_SI",      "kg or kg m^2", 0.0, __builtin_huge_val(), Scale::inertia, 4,
                   {0.25, 0.05, 0.25, 0.05}};
    i.params[2] = {"damping_SI", "N s/m or N m s/rad", 0.0, __builtin_huge_val(), Scale::force_per_velocity, 1, {0.1}};
    i.paired_starts = true;
    i.state_count = 3;
    i.needs_drive = true;
    i.help = "a spring between rotor and joint: a harmonic drive, a belt";
    i.equation = "rotor: J dw/dt = u - f; joint: + f; f = stiffness twist + damping dtwist/dt, dtwist/dt = w - v";
    i.source = "Spong (1987), Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109";
    i.aliases[0] = "joint_inertia";  // where the spring hardly gives
    i.aliases[1] = "backlash";
    i.separation =
        "an encoder at the motor, or an excitation that reaches the resonance: a spring rings, a lag does not";
    return i;
  }();
  /// The force at the joint that replaces the drive force, as a force to add.
  static S force(const JointStep<S>& in, S* state, const S* p) {
    const auto present = min(p[0], p[1]) > S(0.0);
    const S inverse = in.dt_s / select(present, p[1], S(1.0));
    const auto begun = state[2] > S(0.5);
    const S rotor = select(begun, state[1], in.velocity);
    const S joint_free = in.free - in.gain * in.drive;  // the drive force is part of the free step
    const S rotor_free = rotor + inverse * in.drive;
    // rate of twist in the middle of the step: that without the spring less (gain + inverse) f / 2
    const S rate_free = S(0.5) * (rotor - in.velocity + rotor_free - joint_free);
    const S both = S(0.5) * (in.gain + inverse), resist = S(0.5) * in.dt_s * p[0] + p[2];
    const S spring = (p[0] * state[0] + resist * rate_free) / (S(1.0) + resist * both);
    state[0] = select(present, state[0] + in.dt_s * (rate_free - both * spring), S(0.0));
    state[1] = select(present, rotor_free - inverse * spring, in.free);
    state[2] = S(1.0);
    return select(present, spring - in.drive, S(0.0));
  }
};

}  // namespace tiller
