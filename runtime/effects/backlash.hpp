#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Play between the drive and the joint it drives: a second body, the rotor, that the command turns and that pushes
/// the joint only at either end of the gap. States: where the rotor is in the gap, its velocity, and whether it has
/// begun (it begins in the middle at the joint's velocity). The contact force is solved with both velocities at the
/// end of the step and cannot pull: inelastic, no penetration, stable at any step. In contact the rotor's inertia
/// moves with the joint. gap 0 or inertia 0: what the command says acts.
template <class S>
struct Backlash {
  static constexpr Hook hook = Hook::drive;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "backlash";
    i.port = PortKind::input;
    i.param_count = 2;
    i.params[0] = {"gap_SI", "m or rad", 0.0, __builtin_huge_val(), Scale::position, 2, {0.02, 0.1}};
    i.params[1] = {"rotor_inertia_SI", "kg or kg m^2", 0.0, __builtin_huge_val(), Scale::inertia, 2, {0.02, 0.1}};
    i.state_count = 3;
    i.needs_drive = true;
    i.help = "play in the drive train";
    i.equation = "rotor: J dw/dt = u - c; joint: + c; c pushes only at the ends of the gap";
    i.source =
        "Nordin, Gutman (2002), Controlling mechanical systems with backlash: a survey, Automatica 38; Moreau (1988)";
    i.aliases[0] = "dead_zone";
    i.aliases[1] = "input_delay";
    i.aliases[2] = "coulomb_friction";
    i.aliases[3] = "joint_inertia";  // where the gap does not open
    i.separation = "an encoder at the motor, or slow reversals: play is a distance, a delay a time";
    return i;
  }();
  /// The force at the joint that replaces the drive force, as a force to add.
  static S force(const JointStep<S>& in, S* state, const S* p) {
    const auto present = min(p[0], p[1]) > S(0.0);
    const S half = S(0.5) * p[0], inverse = in.dt_s / select(present, p[1], S(1.0));
    const auto begun = state[2] > S(0.5);
    const S rotor = select(begun, state[1], in.velocity);
    const S place = max(min(state[0] + in.dt_s * (rotor - in.velocity), half), -half);
    const S rotor_free = rotor + inverse * in.drive;
    const S joint_free = in.free - in.gain * in.drive;  // the drive force is part of the free step
    const S apart = rotor_free - joint_free;
    const S allowed = max(min(apart, (half - place) / in.dt_s), -(half + place) / in.dt_s);
    const S contact = (apart - allowed) / (in.gain + inverse);
    state[0] = select(present, place, S(0.0));
    state[1] = select(present, rotor_free - inverse * contact, in.free);
    state[2] = S(1.0);
    return select(present, contact - in.drive, S(0.0));
  }
};

}  // namespace tiller
