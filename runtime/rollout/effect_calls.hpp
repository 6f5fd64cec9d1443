#pragma once

// How the stepper calls an effect. Those that say `inlined` are compiled into the kernel's loops; all others stand in
// one function per hook's arguments and scalar type, so that a kernel's compile time does not grow with the catalogue.

#include <type_traits>

#include "effects/catalogue.hpp"
#include "scalar/inline.hpp"
#include "tiller/model.hpp"

namespace tiller {

/// Hooks that the stepper calls; a sensor's is none of them.
constexpr int kHooks = static_cast<int>(Hook::body) + 1;

/// Where the kernel calls an effect.
TILLER_INLINE Hook hook_of(std::uint32_t kind) {
  switch (kind) {
#define TILLER_EFFECT(name, Type) \
  case tiller_effect_##name:      \
    return Type<double>::hook;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: return Hook::sensor;  // no effect: nobody calls it
  }
}

/// What effects work in: the scalar itself, or what it names Lane.
template <class S, class = void>
struct LaneType {
  using type = S;
  static TILLER_INLINE const S& of(const S& x) { return x; }
};
template <class S>
struct LaneType<S, std::void_t<typename S::Lane>> {
  using type = typename S::Lane;
  static TILLER_INLINE type of(const S& x) { return x.v; }
};
template <class S>
using LaneOf = typename LaneType<S>::type;

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
#define TILLER_EFFECT(name, Type)                                                                                    \
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

/// What acts after an input effect that is not inlined.
template <class L>
__attribute__((noinline)) L called_input(std::uint32_t kind, const InputStep<L>& in, L* state, const L* p) {
  switch (kind) {
#define TILLER_EFFECT(name, Type)                                                    \
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
#define TILLER_EFFECT(name, Type)                                        \
  case tiller_effect_##name:                                             \
    if constexpr (Type<L>::hook == Hook::body) Type<L>::change(body, p); \
    break;
#include "tiller/effects.def"
#undef TILLER_EFFECT
    default: break;
  }
}

/// An effect's parameters and states in lanes: as they stand, or copied where the stepper's scalar is another one.
template <class S, bool kSame = std::is_same<S, LaneOf<S>>::value>
struct LaneRows {
  const S* p;
  S* s;
  TILLER_INLINE LaneRows(std::uint32_t, const S* params, S* states) : p(params), s(states) {}
  TILLER_INLINE const S* params() const { return p; }
  TILLER_INLINE S* state() { return s; }
  TILLER_INLINE void put_back() {}
};
template <class S>
struct LaneRows<S, false> {
  using L = LaneOf<S>;
  S* rows;
  int state_count;
  L p[kMaxEffectParams], s[TILLER_MAX_EFFECT_STATES];
  TILLER_INLINE LaneRows(std::uint32_t kind, const S* params, S* states)
      : rows(states), state_count(effect_info(kind).state_count) {
    for (int i = 0; i < effect_info(kind).param_count; ++i) p[i] = LaneType<S>::of(params[i]);
    for (int i = 0; i < state_count; ++i) s[i] = LaneType<S>::of(states[i]);
  }
  TILLER_INLINE const L* params() const { return p; }
  TILLER_INLINE L* state() { return s; }
  TILLER_INLINE void put_back() {
    for (int i = 0; i < state_count; ++i) rows[i] = S(s[i]);
  }
};

/// Type: an effect's, or Called.
template <class Type, class S>
TILLER_INLINE S call_force(std::uint32_t kind, const JointStep<LaneOf<S>>& in, S* state, const S* p) {
  LaneRows<S> rows(kind, p, state);
  S push;
  if constexpr (std::is_same<Type, Called>::value)
    push = S(called_force<LaneOf<S>>(kind, in, rows.state(), rows.params()));
  else
    push = S(joint_force<Type>(in, rows.state(), rows.params()));
  rows.put_back();
  return push;
}
template <class Type, class S>
TILLER_INLINE S call_input(std::uint32_t kind, const InputStep<LaneOf<S>>& in, S* state, const S* p) {
  LaneRows<S> rows(kind, p, state);
  S acting;
  if constexpr (std::is_same<Type, Called>::value)
    acting = S(called_input<LaneOf<S>>(kind, in, rows.state(), rows.params()));
  else
    acting = S(Type::apply(in, rows.state(), rows.params()));
  rows.put_back();
  return acting;
}
template <class S>
TILLER_INLINE void call_body(std::uint32_t kind, Body<S>& body, const S* p) {
  using L = LaneOf<S>;
  LaneRows<S> rows(kind, p, nullptr);
  const auto lane = [](const S& x) { return L(LaneType<S>::of(x)); };
  Body<L> b = {lane(body.gravity_x_m_s2), lane(body.gravity_z_m_s2), lane(body.payload_kg), lane(body.payload_kgm2)};
  called_body<L>(kind, b, rows.params());
  body = {S(b.gravity_x_m_s2), S(b.gravity_z_m_s2), S(b.payload_kg), S(b.payload_kgm2)};
}

}  // namespace tiller
