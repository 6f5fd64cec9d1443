#pragma once

// Authoring a model in C++: one text for numbers, SIMD lanes and derivatives.
//
//     #include "tiller/model.hpp"
//
//     /// Damped pendulum. angle 0 hangs down; counter-clockwise is positive.
//     template <class S>
//     struct Pendulum {
//       static constexpr const char* name = "pendulum";
//       TILLER_FIELDS(State, S, angle_rad, rate_rad_s);
//       TILLER_FIELDS(Input, S, torque_Nm);
//       TILLER_FIELDS(Params, S, mass_kg, length_m, damping_Nms);
//       TILLER_FIELDS(Force, S, joint_Nm);                        // where effects may push
//       static constexpr tiller_joint_t joints[] = {{"joint", 0, 1, 0, 1}};  // position, velocity, force, 1 + input
//       static constexpr unsigned angles = 1u << 0;               // states that wrap at +-pi
//
//       static State dynamics(const State& x, const Input& u, const Force& f, const tiller::Body<S>& body,
//                             const Params& p) {
//         const S inertia = p.mass_kg * p.length_m * p.length_m;
//         ...
//         return {x.rate_rad_s, (u.torque_Nm + f.joint_Nm - ...) / inertia};
//       }
//     };
//
// Rules: branches are select(condition, a, b), so that lanes agree; call sin, cos, exp, sqrt, tanh, abs, min, max,
// atan2, select without `std::` (they are found for lanes and duals by argument; outside namespace tiller add
// `using namespace tiller;` for min, max and select of plain numbers). The dynamics are affine in the forces, and
// a joint's velocity is the derivative of its position. Field names carry SI units and become the names in robot
// files, logs, plots and reports.
//
// A cost of your own stands beside the model, under the same rules; the second derivatives that gradient planners need
// follow from the same text (docs/costs.md):
//
//     template <class S>
//     struct KeepSlow {
//       using M = Pendulum<S>;
//       /// Cost of one control period; time_s counts from the beginning of the task.
//       static S stage(const typename M::State& x, const typename M::Input& u, const typename M::Params& p,
//                      const S& time_s) {
//         return p.mass_kg * x.rate_rad_s * x.rate_rad_s;
//       }
//       /// Cost of the horizon's last state.
//       static S terminal(const typename M::State& x, const typename M::Params& p, const S& time_s) { return S(0.0); }
//     };

#include <type_traits>
#include <utility>

#include "tiller/model.h"
#include "tiller/scalar.hpp"

namespace tiller {

/// What acts on the body from outside: see tiller_body_t.
template <class S>
struct Body {
  S gravity_x_m_s2, gravity_z_m_s2, payload_kg, payload_kgm2;
  static Body from(const tiller_body_t& b) {
    return {S(b.gravity_x_m_s2), S(b.gravity_z_m_s2), S(b.payload_kg), S(b.payload_kgm2)};
  }
};

/// A compile-time index: x[Index<2>{}] costs what x.field costs.
template <int I>
using Index = std::integral_constant<int, I>;

}  // namespace tiller

#define TILLER_FOR_1(m, S, a) m(S, a)
#define TILLER_FOR_2(m, S, a, ...) m(S, a) TILLER_FOR_1(m, S, __VA_ARGS__)
#define TILLER_FOR_3(m, S, a, ...) m(S, a) TILLER_FOR_2(m, S, __VA_ARGS__)
#define TILLER_FOR_4(m, S, a, ...) m(S, a) TILLER_FOR_3(m, S, __VA_ARGS__)
#define TILLER_FOR_5(m, S, a, ...) m(S, a) TILLER_FOR_4(m, S, __VA_ARGS__)
#define TILLER_FOR_6(m, S, a, ...) m(S, a) TILLER_FOR_5(m, S, __VA_ARGS__)
#define TILLER_FOR_7(m, S, a, ...) m(S, a) TILLER_FOR_6(m, S, __VA_ARGS__)
#define TILLER_FOR_8(m, S, a, ...) m(S, a) TILLER_FOR_7(m, S, __VA_ARGS__)
#define TILLER_FOR_9(m, S, a, ...) m(S, a) TILLER_FOR_8(m, S, __VA_ARGS__)
#define TILLER_FOR_10(m, S, a, ...) m(S, a) TILLER_FOR_9(m, S, __VA_ARGS__)
#define TILLER_FOR_11(m, S, a, ...) m(S, a) TILLER_FOR_10(m, S, __VA_ARGS__)
#define TILLER_FOR_12(m, S, a, ...) m(S, a) TILLER_FOR_11(m, S, __VA_ARGS__)
#define TILLER_PICK(_1, _2, _3, _4, _5, _6, _7, _8, _9, _10, _11, _12, n, ...) n
#define TILLER_FOR_EACH(m, S, ...)                                                                                \
  TILLER_PICK(__VA_ARGS__, TILLER_FOR_12, TILLER_FOR_11, TILLER_FOR_10, TILLER_FOR_9, TILLER_FOR_8, TILLER_FOR_7, \
              TILLER_FOR_6, TILLER_FOR_5, TILLER_FOR_4, TILLER_FOR_3, TILLER_FOR_2, TILLER_FOR_1)                 \
  (m, S, __VA_ARGS__)
#define TILLER_FIELD_DECLARE(S, a) S a;
#define TILLER_FIELD_NAME(S, a) #a,
#define TILLER_FIELD_POINTER(S, a) &Fields::a,

/// A struct of named numbers of type S that also knows its names and can be walked by index.
#define TILLER_FIELDS(Name, S, ...)                                                              \
  struct Name {                                                                                  \
    TILLER_FOR_EACH(TILLER_FIELD_DECLARE, S, __VA_ARGS__)                                        \
    using Fields = Name;                                                                         \
    static constexpr const char* names[] = {TILLER_FOR_EACH(TILLER_FIELD_NAME, S, __VA_ARGS__)}; \
    static constexpr int count = static_cast<int>(sizeof(names) / sizeof(names[0]));             \
    template <int I>                                                                             \
    S& operator[](::tiller::Index<I>) {                                                          \
      constexpr S Fields::*at[] = {TILLER_FOR_EACH(TILLER_FIELD_POINTER, S, __VA_ARGS__)};       \
      return this->*at[I];                                                                       \
    }                                                                                            \
    template <int I>                                                                             \
    const S& operator[](::tiller::Index<I>) const {                                              \
      constexpr S Fields::*at[] = {TILLER_FOR_EACH(TILLER_FIELD_POINTER, S, __VA_ARGS__)};       \
      return this->*at[I];                                                                       \
    }                                                                                            \
  }
