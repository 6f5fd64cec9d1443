#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// A drive that is told where to go: a hobby or smart servo in position mode, a joint controller. The command is the
/// goal of the joint's position; the force is that of a spring and a damper between the two, solved with the joint's
/// motion by the implicit midpoint rule, so that any stiffness is stable at any step. Friction that goes with the drive
/// force feels this force. The free step has no part of the command. stiffness 0: what the command says acts.
template <class S>
struct PositionServo {
  static constexpr Hook hook = Hook::servo;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "position_servo";
    i.port = PortKind::input;
    i.param_count = 3;
    i.params[0] = {"stiffness_SI", "N/m or N m/rad", 0.0, __builtin_huge_val(), Scale::stiffness, 1, {10.0}};
    i.params[1] = {"damping_SI", "N s/m or N m s/rad", 0.0, __builtin_huge_val(), Scale::force_per_velocity, 1, {0.1}};
    i.params[2] = {"limit_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 1, {2.0}};
    i.needs_drive = true;
    i.needs_position = true;
    i.unnamed = true;
    i.help = "the command is a goal of the joint's position: a servo in position mode; limit 0: none";
    i.equation = "u is a position; the drive force is clamp(stiffness (u - q) - damping v, -limit, limit)";
    i.source = "Spong, Hutchinson, Vidyasagar (2006), Robot modeling and control, ch. 6: independent joint control";
    i.aliases[0] = "linear_spring";
    i.separation = "the goal moves and a spring's rest does not; a known force at rest gives the stiffness";
    return i;
  }();
  /// What of the command acts in the free step.
  static S free_command(const S& command, const S* p) { return select(p[0] > S(0.0), S(0.0), command); }
  /// The rest of the drive force. in.drive is the command.
  static S force(const JointStep<S>& in, const S* p) {
    const S resist = S(1.0) + p[0] * yield(in) + S(0.5) * p[1] * in.gain;
    const S asked = (p[0] * (in.drive - in.middle) - S(0.5) * p[1] * (in.velocity + in.free)) / resist;
    const S within = select(p[2] > S(0.0), max(min(asked, p[2]), -p[2]), asked);
    return select(p[0] > S(0.0), within, S(0.0));
  }
};

}  // namespace tiller
