#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// More inertia at the joint: a rotor behind a gear. force = -inertia dv/dt, solved with the model's own inertia (a
/// rank-one change of it), and friction that follows feels the sum.
template <class S>
struct JointInertia {
  static constexpr Hook hook = Hook::inertia;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "joint_inertia";
    i.param_count = 1;
    i.params[0] = {"inertia_SI", "kg or kg m^2", 0.0, __builtin_huge_val(), Scale::inertia, 2, {0.05, 0.2}};
    i.help = "more inertia at the joint: armature, a coupled wheel";
    i.equation = "force = -inertia dv/dt";
    i.source = "Featherstone (2008), Rigid body dynamics algorithms, ch. 9.6";
    i.aliases[0] = "payload";
    i.aliases[1] = "actuator_gain";
    i.separation = "the same motion under a known extra load, or a known mass";
    return i;
  }();
  /// The share of the joint's acceleration that is lost, per response: see Stepper::weigh_down.
  static S per_acceleration(const S& response, const S* p) { return p[0] / (S(1.0) + p[0] * response); }
};

}  // namespace tiller
