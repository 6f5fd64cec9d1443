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
// A kinematic model has no forces: it leaves Force and joints out, and dynamics(x, u, body, p) takes none. It may leave
// angles out where no state wraps, and Params where there is nothing to know: dynamics(x, u, body). Effects at a joint
// are refused then; those of inputs, sensors and the body remain.
//
//     template <class S>
//     struct Unicycle {
//       static constexpr const char* name = "unicycle";
//       TILLER_FIELDS(State, S, x_m, y_m, heading_rad);
//       TILLER_FIELDS(Input, S, speed_m_s, turn_rad_s);
//       TILLER_FIELDS(Params, S, speed_gain, turn_gain);
//       static constexpr unsigned angles = 1u << 2;
//
//       static State dynamics(const State& x, const Input& u, const tiller::Body<S>&, const Params& p) {
//         const S speed = p.speed_gain * u.speed_m_s;
//         return {speed * cos(x.heading_rad), speed * sin(x.heading_rad), p.turn_gain * u.turn_rad_s};
//       }
//     };
//
// Rules: branches are select(condition, a, b), so that lanes agree; call sin, cos, exp, sqrt, tanh, abs, min, max,
// atan2, select without `std::` (they are found for lanes and duals by argument; outside namespace tiller add
// `using namespace tiller;` for min, max and select of plain numbers). The dynamics are affine in the forces, and
// a joint's velocity is the derivative of its position. Field names carry SI units and become the names in robot
// files, logs, plots and reports.
//
// An attitude in space is a unit quaternion in four states that follow each other, w first (Hamilton's, body to world):
//
//       TILLER_FIELDS(State, S, attitude_w, attitude_x, attitude_y, attitude_z, roll_rad_s, pitch_rad_s, yaw_rad_s);
//       static constexpr unsigned quaternions = 1u << 0;          // bit i: states i to i + 3
//
// The stepper brings it back to unit length after every step, and its differences are rotations (tiller/rotation.hpp,
// which has the functions for such equations).
//
// `static constexpr bool long_dynamics = true;` says that the equations are long (a double pendulum's are): they are
// then differentiated in one text that all integrators share. It compiles in two thirds of the time; derivatives by RK4
// take a tenth less, by the other integrators a third more.
//
// A model of many joints may say how they answer to forces, for effects that act implicitly (friction, backlash, more
// inertia); where it does not, the answers are derivatives of its dynamics, one sweep a joint:
//
//       /// column[j][i]: acceleration of joint i for a unit force at joint j, everything else at rest.
//       static void responses(const State& x, const tiller::Body<S>& body, const Params& p, S (*column)[kJoints]);
//
// and, where every state is a joint's position or speed, in the joints' order, how its forces answer to both. Gradient
// planners and filters then take derivatives from there in the place of dual numbers: the tick of a seven-joint arm
// takes a third of the time.
//
//       /// acceleration[i] as dynamics has it; column as in responses; by_position[i][j], by_speed[i][j]: derivative
//       /// of the force of joint i (by Newton and Euler, at these accelerations) by the position and speed of joint j;
//       /// input_gain[i]: force of joint i for a unit of the input that drives it.
//       static void slopes(const State& x, const Input& u, const Force& f, const tiller::Body<S>& body,
//                          const Params& p, S* acceleration, S (*column)[kJoints], S (*by_position)[kJoints],
//                          S (*by_speed)[kJoints], S* input_gain);
//
// A model may tell of itself what its state does not say at once, the pose of a tool or the distance of two parts.
// Costs take these outputs as they take states (docs/reference/costs.md), and pages draw them:
//
//       TILLER_FIELDS(Output, S, tip_x_m, tip_z_m);
//       static Output outputs(const State& x, const Params& p);   // without Params: outputs(x)
//
// A cost of your own stands beside the model, under the same rules; the second derivatives that gradient planners need
// follow from the same text (docs/reference/costs.md):
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

/// External influences on the body: see tiller_body_t.
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

/// In the place of fields that a model leaves out.
struct NoFields {
  static constexpr const char* const* names = nullptr;
  static constexpr int count = 0;
};

/// Optional members of a model template: Force with joints, Params, angles.
template <class Model, class = void>
struct ForceOf {
  using type = NoFields;
  static constexpr int joint_count = 0;
  static constexpr const tiller_joint_t* joints = nullptr;
};
template <class Model>
struct ForceOf<Model, std::void_t<typename Model::Force>> {
  using type = typename Model::Force;
  static constexpr int joint_count = static_cast<int>(sizeof(Model::joints) / sizeof(tiller_joint_t));
  static constexpr const tiller_joint_t* joints = Model::joints;
};
template <class Model, class = void>
struct HasJoints : std::false_type {};
template <class Model>
struct HasJoints<Model, std::void_t<decltype(Model::joints)>> : std::true_type {};
template <class Model, class = void>
struct ParamsOf {
  using type = NoFields;
};
template <class Model>
struct ParamsOf<Model, std::void_t<typename Model::Params>> {
  using type = typename Model::Params;
};
template <class Model, class = void>
struct AnglesOf {
  static constexpr unsigned mask = 0;
};
template <class Model>
struct AnglesOf<Model, std::void_t<decltype(Model::angles)>> {
  static constexpr unsigned mask = Model::angles;
};
template <class Model, class = void>
struct QuaternionsOf {
  static constexpr unsigned mask = 0;
};
template <class Model>
struct QuaternionsOf<Model, std::void_t<decltype(Model::quaternions)>> {
  static constexpr unsigned mask = Model::quaternions;
};
/// Optional: outputs.
template <class Model, class = void>
struct OutputOf {
  using type = NoFields;
};
template <class Model>
struct OutputOf<Model, std::void_t<typename Model::Output>> {
  using type = typename Model::Output;
};
/// Optional: the inverse of the inertia matrix, written out.
template <class Model, class = void>
struct HasResponses : std::false_type {};
template <class Model>
struct HasResponses<Model, std::void_t<decltype(&Model::responses)>> : std::true_type {};
template <class Model, class = void>
struct HasSlopes : std::false_type {};
template <class Model>
struct HasSlopes<Model, std::void_t<decltype(&Model::slopes)>> : std::true_type {};
template <class Model, class = void>
struct LongDynamics {
  static constexpr bool value = false;
};
template <class Model>
struct LongDynamics<Model, std::void_t<decltype(Model::long_dynamics)>> {
  static constexpr bool value = Model::long_dynamics;
};

}  // namespace tiller

/// Names that one TILLER_FIELDS takes.
#define TILLER_MAX_FIELDS 64

// m(S, a) for each name: the preprocessor has no loop.
// clang-format off
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
#define TILLER_FOR_13(m, S, a, ...) m(S, a) TILLER_FOR_12(m, S, __VA_ARGS__)
#define TILLER_FOR_14(m, S, a, ...) m(S, a) TILLER_FOR_13(m, S, __VA_ARGS__)
#define TILLER_FOR_15(m, S, a, ...) m(S, a) TILLER_FOR_14(m, S, __VA_ARGS__)
#define TILLER_FOR_16(m, S, a, ...) m(S, a) TILLER_FOR_15(m, S, __VA_ARGS__)
#define TILLER_FOR_17(m, S, a, ...) m(S, a) TILLER_FOR_16(m, S, __VA_ARGS__)
#define TILLER_FOR_18(m, S, a, ...) m(S, a) TILLER_FOR_17(m, S, __VA_ARGS__)
#define TILLER_FOR_19(m, S, a, ...) m(S, a) TILLER_FOR_18(m, S, __VA_ARGS__)
#define TILLER_FOR_20(m, S, a, ...) m(S, a) TILLER_FOR_19(m, S, __VA_ARGS__)
#define TILLER_FOR_21(m, S, a, ...) m(S, a) TILLER_FOR_20(m, S, __VA_ARGS__)
#define TILLER_FOR_22(m, S, a, ...) m(S, a) TILLER_FOR_21(m, S, __VA_ARGS__)
#define TILLER_FOR_23(m, S, a, ...) m(S, a) TILLER_FOR_22(m, S, __VA_ARGS__)
#define TILLER_FOR_24(m, S, a, ...) m(S, a) TILLER_FOR_23(m, S, __VA_ARGS__)
#define TILLER_FOR_25(m, S, a, ...) m(S, a) TILLER_FOR_24(m, S, __VA_ARGS__)
#define TILLER_FOR_26(m, S, a, ...) m(S, a) TILLER_FOR_25(m, S, __VA_ARGS__)
#define TILLER_FOR_27(m, S, a, ...) m(S, a) TILLER_FOR_26(m, S, __VA_ARGS__)
#define TILLER_FOR_28(m, S, a, ...) m(S, a) TILLER_FOR_27(m, S, __VA_ARGS__)
#define TILLER_FOR_29(m, S, a, ...) m(S, a) TILLER_FOR_28(m, S, __VA_ARGS__)
#define TILLER_FOR_30(m, S, a, ...) m(S, a) TILLER_FOR_29(m, S, __VA_ARGS__)
#define TILLER_FOR_31(m, S, a, ...) m(S, a) TILLER_FOR_30(m, S, __VA_ARGS__)
#define TILLER_FOR_32(m, S, a, ...) m(S, a) TILLER_FOR_31(m, S, __VA_ARGS__)
#define TILLER_FOR_33(m, S, a, ...) m(S, a) TILLER_FOR_32(m, S, __VA_ARGS__)
#define TILLER_FOR_34(m, S, a, ...) m(S, a) TILLER_FOR_33(m, S, __VA_ARGS__)
#define TILLER_FOR_35(m, S, a, ...) m(S, a) TILLER_FOR_34(m, S, __VA_ARGS__)
#define TILLER_FOR_36(m, S, a, ...) m(S, a) TILLER_FOR_35(m, S, __VA_ARGS__)
#define TILLER_FOR_37(m, S, a, ...) m(S, a) TILLER_FOR_36(m, S, __VA_ARGS__)
#define TILLER_FOR_38(m, S, a, ...) m(S, a) TILLER_FOR_37(m, S, __VA_ARGS__)
#define TILLER_FOR_39(m, S, a, ...) m(S, a) TILLER_FOR_38(m, S, __VA_ARGS__)
#define TILLER_FOR_40(m, S, a, ...) m(S, a) TILLER_FOR_39(m, S, __VA_ARGS__)
#define TILLER_FOR_41(m, S, a, ...) m(S, a) TILLER_FOR_40(m, S, __VA_ARGS__)
#define TILLER_FOR_42(m, S, a, ...) m(S, a) TILLER_FOR_41(m, S, __VA_ARGS__)
#define TILLER_FOR_43(m, S, a, ...) m(S, a) TILLER_FOR_42(m, S, __VA_ARGS__)
#define TILLER_FOR_44(m, S, a, ...) m(S, a) TILLER_FOR_43(m, S, __VA_ARGS__)
#define TILLER_FOR_45(m, S, a, ...) m(S, a) TILLER_FOR_44(m, S, __VA_ARGS__)
#define TILLER_FOR_46(m, S, a, ...) m(S, a) TILLER_FOR_45(m, S, __VA_ARGS__)
#define TILLER_FOR_47(m, S, a, ...) m(S, a) TILLER_FOR_46(m, S, __VA_ARGS__)
#define TILLER_FOR_48(m, S, a, ...) m(S, a) TILLER_FOR_47(m, S, __VA_ARGS__)
#define TILLER_FOR_49(m, S, a, ...) m(S, a) TILLER_FOR_48(m, S, __VA_ARGS__)
#define TILLER_FOR_50(m, S, a, ...) m(S, a) TILLER_FOR_49(m, S, __VA_ARGS__)
#define TILLER_FOR_51(m, S, a, ...) m(S, a) TILLER_FOR_50(m, S, __VA_ARGS__)
#define TILLER_FOR_52(m, S, a, ...) m(S, a) TILLER_FOR_51(m, S, __VA_ARGS__)
#define TILLER_FOR_53(m, S, a, ...) m(S, a) TILLER_FOR_52(m, S, __VA_ARGS__)
#define TILLER_FOR_54(m, S, a, ...) m(S, a) TILLER_FOR_53(m, S, __VA_ARGS__)
#define TILLER_FOR_55(m, S, a, ...) m(S, a) TILLER_FOR_54(m, S, __VA_ARGS__)
#define TILLER_FOR_56(m, S, a, ...) m(S, a) TILLER_FOR_55(m, S, __VA_ARGS__)
#define TILLER_FOR_57(m, S, a, ...) m(S, a) TILLER_FOR_56(m, S, __VA_ARGS__)
#define TILLER_FOR_58(m, S, a, ...) m(S, a) TILLER_FOR_57(m, S, __VA_ARGS__)
#define TILLER_FOR_59(m, S, a, ...) m(S, a) TILLER_FOR_58(m, S, __VA_ARGS__)
#define TILLER_FOR_60(m, S, a, ...) m(S, a) TILLER_FOR_59(m, S, __VA_ARGS__)
#define TILLER_FOR_61(m, S, a, ...) m(S, a) TILLER_FOR_60(m, S, __VA_ARGS__)
#define TILLER_FOR_62(m, S, a, ...) m(S, a) TILLER_FOR_61(m, S, __VA_ARGS__)
#define TILLER_FOR_63(m, S, a, ...) m(S, a) TILLER_FOR_62(m, S, __VA_ARGS__)
#define TILLER_FOR_64(m, S, a, ...) m(S, a) TILLER_FOR_63(m, S, __VA_ARGS__)
#define TILLER_PICK( \
  _1, _2, _3, _4, _5, _6, _7, _8, _9, _10, _11, _12, _13, _14, _15, _16, _17, _18, _19, _20, _21, _22, _23, _24, \
  _25, _26, _27, _28, _29, _30, _31, _32, _33, _34, _35, _36, _37, _38, _39, _40, _41, _42, _43, _44, _45, _46, \
  _47, _48, _49, _50, _51, _52, _53, _54, _55, _56, _57, _58, _59, _60, _61, _62, _63, _64, n, ...) n
#define TILLER_FOR_EACH(m, S, ...) \
  TILLER_PICK(__VA_ARGS__, \
    TILLER_FOR_64, TILLER_FOR_63, TILLER_FOR_62, TILLER_FOR_61, TILLER_FOR_60, TILLER_FOR_59, TILLER_FOR_58, \
    TILLER_FOR_57, TILLER_FOR_56, TILLER_FOR_55, TILLER_FOR_54, TILLER_FOR_53, TILLER_FOR_52, TILLER_FOR_51, \
    TILLER_FOR_50, TILLER_FOR_49, TILLER_FOR_48, TILLER_FOR_47, TILLER_FOR_46, TILLER_FOR_45, TILLER_FOR_44, \
    TILLER_FOR_43, TILLER_FOR_42, TILLER_FOR_41, TILLER_FOR_40, TILLER_FOR_39, TILLER_FOR_38, TILLER_FOR_37, \
    TILLER_FOR_36, TILLER_FOR_35, TILLER_FOR_34, TILLER_FOR_33, TILLER_FOR_32, TILLER_FOR_31, TILLER_FOR_30, \
    TILLER_FOR_29, TILLER_FOR_28, TILLER_FOR_27, TILLER_FOR_26, TILLER_FOR_25, TILLER_FOR_24, TILLER_FOR_23, \
    TILLER_FOR_22, TILLER_FOR_21, TILLER_FOR_20, TILLER_FOR_19, TILLER_FOR_18, TILLER_FOR_17, TILLER_FOR_16, \
    TILLER_FOR_15, TILLER_FOR_14, TILLER_FOR_13, TILLER_FOR_12, TILLER_FOR_11, TILLER_FOR_10, TILLER_FOR_9, \
    TILLER_FOR_8, TILLER_FOR_7, TILLER_FOR_6, TILLER_FOR_5, TILLER_FOR_4, TILLER_FOR_3, TILLER_FOR_2, TILLER_FOR_1, \
    TILLER_TOO_MANY_FIELDS)(m, S, __VA_ARGS__)
// clang-format on
#define TILLER_FIELD_DECLARE(S, a) S a;
#define TILLER_FIELD_NAME(S, a) #a,
#define TILLER_FIELD_POINTER(S, a) &Fields::a,

/// A struct of 1 to 64 named numbers of type S that also knows its names and can be walked by index.
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
