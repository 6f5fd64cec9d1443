#pragma once

// The functions through which kernels call effects, of every kind of the catalogue: one per hook's arguments and scalar
// type.

#include "effects/catalogue.hpp"
#include "networks/evaluate.hpp"
#include "rollout/effect_calls.hpp"

namespace tiller {

#define TILLER_INLINED_KIND(name, Type) kind == tiller_effect_##name ||
/// Whether the stepper has the kind in its loops.
constexpr bool stands_in_loops(std::uint32_t kind) { return TILLER_INLINED_EFFECTS(TILLER_INLINED_KIND) false; }
#undef TILLER_INLINED_KIND
#define TILLER_EFFECT(name, Type, ...)                                                               \
  static_assert(InlinedEffect<Type<double>, double>::value == stands_in_loops(tiller_effect_##name), \
                "TILLER_INLINED_EFFECTS has the effects that say `inlined`");
#include "tiller/effects.def"
#undef TILLER_EFFECT

template <class L>
__attribute__((noinline)) L called_force(std::uint32_t kind, const JointStep<L>& in, L* state, const L* p) {
  switch (kind) {
#define TILLER_EFFECT(name, Type, ...)                                                     \
  case tiller_effect_##name:                                                               \
    if constexpr (!InlinedEffect<Type<L>, L>::value &&                                     \
                  (Type<L>::hook == Hook::force ||                                         \
                   (Type<L>::hook > Hook::inertia && Type<L>::hook <= Hook::dissipation))) \
      return joint_force<Type<L>>(in, state, p);                                           \
    break;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: break;
  }
  return L(0.0);
}

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

template <class L>
__attribute__((noinline)) void called_network(const tiller_network_t& network, const L& member, const L* in, L* out) {
  evaluate_network(network, member, in, out);
}

}  // namespace tiller
