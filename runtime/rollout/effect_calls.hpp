#pragma once

// How the stepper calls an effect. Those of TILLER_INLINED_EFFECTS are compiled into the kernel's loops; all others
// stand in one function per hook's arguments and scalar type (effect_texts.hpp), so that neither a kernel's compile
// time nor what a change of one effect compiles anew grows with the catalogue.

#include <type_traits>

#include "effects/actuator_lag.hpp"
#include "effects/constant_offset.hpp"
#include "effects/coulomb_friction.hpp"
#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"
#include "effects/input_delay.hpp"
#include "effects/viscous_friction.hpp"
#include "scalar/inline.hpp"
#include "tiller/model.hpp"

namespace tiller {

/// Hooks that the stepper calls; a sensor's is none of them.
constexpr int kHooks = static_cast<int>(Hook::body) + 1;

/// The effects that say `inlined`: effect_texts.hpp checks that they all stand here.
#define TILLER_INLINED_EFFECTS(X)      \
  X(viscous_friction, ViscousFriction) \
  X(coulomb_friction, CoulombFriction) \
  X(constant_offset, ConstantOffset)   \
  X(actuator_lag, ActuatorLag)         \
  X(input_delay, InputDelay)

/// Whether the kernel's loops have the effect's text in them: where it says so and the scalar carries no derivatives,
/// whose arithmetic is long.
template <class Effect, class L, class = void>
struct InlinedEffect : std::false_type {};
template <class Effect, class L>
struct InlinedEffect<Effect, L, std::void_t<decltype(Effect::inlined)>> {
  template <class T>
  static constexpr auto derived(int) -> decltype(T::directions > 0) {
    return true;
  }
  template <class T>
  static constexpr bool derived(...) {
    return false;
  }
  static constexpr bool value = !derived<L>(0);
};

/// In the place of an effect's type: look it up by slot.kind.
struct Called {};

template <class Effect, class L>
TILLER_INLINE L joint_force(const JointStep<L>& in, L* state, const L* p) {
  if constexpr (Effect::info.state_count > 0)
    return Effect::force(in, state, p);
  else
    return Effect::force(in, p);
}

/// Force of any effect of the hooks force, servo, drive, elastic and dissipation that is not inlined.
template <class L>
L called_force(std::uint32_t kind, const JointStep<L>& in, L* state, const L* p);
/// The force after an input effect that is not inlined.
template <class L>
L called_input(std::uint32_t kind, const InputStep<L>& in, L* state, const L* p);
template <class L>
void called_body(std::uint32_t kind, Body<L>& body, const L* p);
/// Forces of a network.
template <class L>
void called_network(const tiller_network_t& network, const L& member, const L* in, L* out);

/// Type: an effect's, or Called.
template <class Type, class S>
TILLER_INLINE S call_force(std::uint32_t kind, const JointStep<S>& in, S* state, const S* p) {
  if constexpr (std::is_same<Type, Called>::value)
    return called_force<S>(kind, in, state, p);
  else
    return joint_force<Type>(in, state, p);
}

}  // namespace tiller

#ifndef TILLER_EFFECTS_ARE_SHARED
#include "rollout/effect_texts.hpp"
#endif
