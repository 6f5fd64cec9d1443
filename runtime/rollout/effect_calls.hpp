#pragma once

// How the stepper calls an effect. Those that say `inlined` are compiled into the kernel's loops; all others stand in
// one function per hook's arguments and scalar type, so that a kernel's compile time does not grow with the catalogue.

#include <type_traits>

#include "effects/catalogue.hpp"
#include "networks/evaluate.hpp"
#include "scalar/inline.hpp"
#include "tiller/model.hpp"

namespace tiller {

/// Hooks that the stepper calls; a sensor's is none of them.
constexpr int kHooks = static_cast<int>(Hook::body) + 1;

/// Where the kernel calls an effect.
TILLER_INLINE Hook hook_of(std::uint32_t kind) {
  switch (kind) {
#define TILLER_EFFECT(name, Type, ...) \
  case tiller_effect_##name:           \
    return Type<double>::hook;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: return Hook::sensor;  // no effect: nobody calls it
  }
}

/// How many states of its own an effect has.
TILLER_INLINE int state_count_of(std::uint32_t kind) {
  switch (kind) {
#define TILLER_EFFECT(name, Type, ...) \
  case tiller_effect_##name:           \
    return static_cast<int>(Type<double>::info.state_count);
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: return 0;
  }
}

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

/// Force of any effect of the hooks force, drive, elastic and dissipation that is not inlined.
template <class L>
__attribute__((noinline)) L called_force(std::uint32_t kind, const JointStep<L>& in, L* state, const L* p) {
  switch (kind) {
#define TILLER_EFFECT(name, Type, ...)                                                                               \
  case tiller_effect_##name:                                                                                         \
    if constexpr (!InlinedEffect<Type<L>, L>::value &&                                                               \
                  (Type<L>::hook == Hook::force || Type<L>::hook == Hook::drive || Type<L>::hook == Hook::elastic || \
                   Type<L>::hook == Hook::dissipation))                                                              \
      return joint_force<Type<L>>(in, state, p);                                                                     \
    break;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: break;
  }
  return L(0.0);
}

/// The force after an input effect that is not inlined.
template <class L>
__attribute__((noinline)) L called_input(std::uint32_t kind, const InputStep<L>& in, L* state, const L* p) {
  switch (kind) {
#define TILLER_EFFECT(name, Type, ...)                                               \
  case tiller_effect_##name:                                                         \
    if constexpr (!InlinedEffect<Type<L>, L>::value && Type<L>::hook == Hook::input) \
      return Type<L>::apply(in, state, p);                                           \
    break;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: break;
  }
  return in.command;
}

template <class L>
__attribute__((noinline)) void called_body(std::uint32_t kind, Body<L>& body, const L* p) {
  switch (kind) {
#define TILLER_EFFECT(name, Type, ...)                                   \
  case tiller_effect_##name:                                             \
    if constexpr (Type<L>::hook == Hook::body) Type<L>::change(body, p); \
    break;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: break;
  }
}

/// Forces of a network, in one function per scalar type: no model makes it longer.
template <class L>
__attribute__((noinline)) void called_network(const tiller_network_t& network, const L& member, const L* in, L* out) {
  evaluate_network(network, member, in, out);
}

/// Type: an effect's, or Called.
template <class Type, class S>
TILLER_INLINE S call_force(std::uint32_t kind, const JointStep<S>& in, S* state, const S* p) {
  if constexpr (std::is_same<Type, Called>::value)
    return called_force<S>(kind, in, state, p);
  else
    return joint_force<Type>(in, state, p);
}

}  // namespace tiller
