#pragma once

// The interface of a model to the stepper, for models written as templates (StaticModel: every count and index is a
// constant, loops unroll, fields stay in registers) and as C tables (TableModel: loops with run-time counts).

#include <cstdint>
#include <type_traits>
#include <utility>

#include "scalar/dual.hpp"
#include "scalar/inline.hpp"
#include "scalar/sparse_dual.hpp"
#include "tiller/model.hpp"

namespace tiller {

template <class S>
struct IsDual : std::false_type {
  static constexpr int directions = 0;
};
template <class S, int N>
struct IsDual<Dual<S, N>> : std::true_type {
  static constexpr int directions = N;
};

template <class Fields, class = void>
struct HasCount : std::false_type {};
template <class Fields>
struct HasCount<Fields, std::void_t<decltype(Fields::count)>> : std::true_type {};

/// f(Index<0>{}) ... f(Index<N-1>{}), unrolled by the language, or f(0) ... f(n-1), a loop.
template <class F, int... I>
TILLER_INLINE void each_of(F&& f, std::integer_sequence<int, I...>) {
  (f(Index<I>{}), ...);
}
template <int N, class F>
TILLER_INLINE void each(Index<N>, F&& f) {
  each_of(f, std::make_integer_sequence<int, N>{});
}
template <class F>
TILLER_INLINE void each(int n, F&& f) {
  for (int i = 0; i < n; ++i) f(i);
}

/// Field i, a constant or not. The fields of TILLER_FIELDS are numbers of one type and nothing else.
template <class Fields, int I>
TILLER_INLINE auto& element(Fields& f, Index<I> i) {
  return f[i];
}
template <class Fields>
TILLER_INLINE auto& element(Fields& f, int i) {
  if constexpr (HasCount<Fields>::value) {
    using S = std::remove_reference_t<decltype(f[Index<0>{}])>;
    static_assert(sizeof(Fields) == sizeof(S) * Fields::count && std::is_standard_layout<Fields>::value, "an array");
    return reinterpret_cast<S*>(&f)[i];
  } else {
    return f[i];
  }
}

/// Bit i: state i is neither a joint's position nor its velocity, but may follow from the velocities.
constexpr std::uint32_t states_of_no_joint(const tiller_joint_t* joints, int count, int states) {
  std::uint32_t mask = ~std::uint32_t{0} >> (TILLER_MAX_STATES - states);
  for (int j = 0; j < count; ++j) {
    mask &= ~(1u << joints[j].velocity);
    if (joints[j].position != TILLER_NO_POSITION) mask &= ~(1u << joints[j].position);
  }
  return mask;
}
template <class M, int kStates, bool kJoints>
struct OthersOf {
  static constexpr std::uint32_t mask = 0;
};
template <class M, int kStates>
struct OthersOf<M, kStates, true> {
  static constexpr std::uint32_t mask =
      states_of_no_joint(M::joints, static_cast<int>(sizeof(M::joints) / sizeof(M::joints[0])), kStates);
};

/// Whether quaternions lie within the states, apart from each other and from the angles.
constexpr bool quaternions_fit(std::uint32_t quaternions, std::uint32_t states, std::uint32_t angles) {
  std::uint64_t taken = angles;
  for (std::uint32_t i = 0; i < 32; ++i) {
    if (!((quaternions >> i) & 1u)) continue;
    const std::uint64_t four = std::uint64_t{15} << i;
    if (i + 4 > states || (taken & four) != 0) return false;
    taken |= four;
  }
  return true;
}

/// A model written as a template.
template <template <class> class M>
struct StaticModel {
  template <class S>
  using State = typename M<S>::State;
  template <class S>
  using Input = typename M<S>::Input;
  template <class S>
  using Params = typename ParamsOf<M<S>>::type;
  template <class S>
  using Force = typename ForceOf<M<S>>::type;
  template <class S>
  using Output = typename OutputOf<M<S>>::type;

  static constexpr int kStates = State<double>::count;
  static constexpr int kInputs = Input<double>::count;
  static constexpr int kParams = Params<double>::count;
  static constexpr int kForces = Force<double>::count;
  static constexpr int kOutputs = Output<double>::count;
  static constexpr int kMostInputs = kInputs > 0 ? kInputs : 1;
  static constexpr int kMostForces = kForces > 0 ? kForces : 1;
  static constexpr bool kKnowsResponses = HasResponses<M<double>>::value;
  static constexpr bool kKnowsSlopes = HasSlopes<M<double>>::value;
  static_assert(!kKnowsSlopes || (kKnowsResponses && kStates == 2 * kForces),
                "slopes ask for responses and joints alone");
  static constexpr Index<kStates> nx() { return {}; }
  static constexpr Index<kInputs> nu() { return {}; }
  static constexpr Index<kParams> np() { return {}; }
  static constexpr Index<kForces> nf() { return {}; }
  static constexpr Index<kOutputs> ny() { return {}; }
  /// Joints as effects go through them: constants for up to three, which stay in registers; more are a loop, or every
  /// effect's text would stand in the kernel once a joint.
  static constexpr auto joints() {
    if constexpr (kForces > 3)
      return kForces;
    else
      return Index<kForces>{};
  }
  /// Unrolling over the states pays for few of them: its text grows faster than its gain.
  static constexpr bool kFewStates = kStates <= 6;
  /// The same where what is done to each is long or done once: a loop for many.
  static constexpr auto looped_nx() { return looped(nx()); }
  static constexpr auto looped_nu() { return looped(nu()); }
  template <int N>
  static constexpr auto looped(Index<N> count) {
    if constexpr (kFewStates)
      return count;
    else
      return N;
  }
  static constexpr bool kLongDynamics = LongDynamics<M<double>>::value;
  static_assert(ForceOf<M<double>>::joint_count == kForces, "one joint for each force, in order");
  static_assert(kForces > 0 || !HasJoints<M<double>>::value, "joints ask for TILLER_FIELDS(Force, ...)");
  static_assert(kStates <= TILLER_MAX_STATES && kInputs <= TILLER_MAX_INPUTS && kParams <= TILLER_MAX_PARAMS &&
                    kForces <= TILLER_MAX_JOINTS && kOutputs <= TILLER_MAX_OUTPUTS,
                "the model is larger than docs/reference/limits.md allows");

  /// Bit i: states i to i + 3 are a unit quaternion.
  static constexpr unsigned kQuaternions = QuaternionsOf<M<double>>::mask;
  static constexpr bool kMayTurn = kQuaternions != 0;
  static constexpr unsigned quaternions() { return kQuaternions; }
  /// Joints have forces instead (StepSetup::slip_states).
  static constexpr bool kMaySlip = kForces == 0;
  static_assert(quaternions_fit(kQuaternions, kStates, AnglesOf<M<double>>::mask),
                "quaternions: bit i says that states i to i + 3 are one, and none of them an angle");

  static constexpr std::uint32_t kOthers = OthersOf<M<double>, kStates, (kForces > 0)>::mask;
  static constexpr bool kMayHaveOthers = kOthers != 0;
  static constexpr std::uint32_t others() { return kOthers; }

  template <int I>
  static constexpr bool is_angle(Index<I>) {
    return (AnglesOf<M<double>>::mask >> I) & 1u;
  }
  template <class S, int J>
  static TILLER_INLINE S* position(State<S>& x, Index<J>) {
    if constexpr (M<double>::joints[J].position == TILLER_NO_POSITION)
      return nullptr;
    else
      return &x[Index<M<double>::joints[J].position>{}];
  }
  template <class S, int J>
  static TILLER_INLINE S& velocity(State<S>& x, Index<J>) {
    return x[Index<M<double>::joints[J].velocity>{}];
  }
  template <int J>
  static constexpr auto force_index(Index<J>) {
    return Index<M<double>::joints[J].force>{};
  }

  /// The input that drives joint j, counted from 1; 0: none.
  template <int J>
  static constexpr int drive(Index<J>) {
    return M<double>::joints[J].drive;
  }
  // the same of a joint that only run time knows
  template <class S>
  static TILLER_INLINE S* position(State<S>& x, int j) {
    const auto at = M<double>::joints[j].position;
    return at == TILLER_NO_POSITION ? nullptr : &element(x, at);
  }
  template <class S>
  static TILLER_INLINE S& velocity(State<S>& x, int j) {
    return element(x, M<double>::joints[j].velocity);
  }
  static constexpr int force_index(int j) { return M<double>::joints[j].force; }
  static constexpr int drive(int j) { return M<double>::joints[j].drive; }
  static constexpr int position_index(int j) { return M<double>::joints[j].position; }
  static constexpr int velocity_index(int j) { return M<double>::joints[j].velocity; }

  /// With the arguments that the model takes.
  template <class S>
  static TILLER_INLINE State<S> dynamics(const State<S>& x, const Input<S>& u, [[maybe_unused]] const Force<S>& f,
                                         const Body<S>& body, [[maybe_unused]] const Params<S>& p) {
    if constexpr (kKnowsSlopes && IsDual<S>::value)
      return sloped_dynamics<S>(x, u, f, body, p);
    else if constexpr (kForces > 0 && kParams > 0)
      return M<S>::dynamics(x, u, f, body, p);
    else if constexpr (kForces > 0)
      return M<S>::dynamics(x, u, f, body);
    else if constexpr (kParams > 0)
      return M<S>::dynamics(x, u, body, p);
    else
      return M<S>::dynamics(x, u, body);
  }

  /// Derivatives of the accelerations of a model that knows its slopes, rows joints: with W the inverse inertia and ID
  /// the forces for given accelerations, d a/dq = -W dID/dq (Carpentier and Mansard 2018, Analytical derivatives of
  /// rigid body dynamics algorithms).
  template <class S>
  struct JointSlopes {
    S acceleration[kMostForces], column[kMostForces][kMostForces], input_gain[kMostForces];
    S by_state[kMostForces][kStates];
  };
  template <class S>
  static __attribute__((noinline)) void slopes(const State<S>& x, const Input<S>& u, const Force<S>& f,
                                               const Body<S>& body, [[maybe_unused]] const Params<S>& p,
                                               JointSlopes<S>& s) {
    S by_position[kMostForces][kMostForces], by_speed[kMostForces][kMostForces];
    if constexpr (kParams > 0)
      M<S>::slopes(x, u, f, body, p, s.acceleration, s.column, by_position, by_speed, s.input_gain);
    else
      M<S>::slopes(x, u, f, body, s.acceleration, s.column, by_position, by_speed, s.input_gain);
    for (int i = 0; i < kForces; ++i) {
      S row[2 * kMostForces];
      for (int c = 0; c < 2 * kForces; ++c) row[c] = S(0.0);
      for (int m = 0; m < kForces; ++m)
        for (int c = 0; c < kForces; ++c) {
          row[c] = row[c] - s.column[m][i] * by_position[m][c];
          row[kForces + c] = row[kForces + c] - s.column[m][i] * by_speed[m][c];
        }
      for (int c = 0; c < kForces; ++c) {
        s.by_state[i][M<double>::joints[c].position] = row[c];
        s.by_state[i][M<double>::joints[c].velocity] = row[kForces + c];
      }
    }
  }
  /// The dynamics on dual numbers by the chain rule. Parameters and the body are taken for constants: nothing that
  /// differentiates a step moves them.
  template <class D>
  static __attribute__((noinline)) State<D> sloped_dynamics(const State<D>& x, const Input<D>& u, const Force<D>& f,
                                                            const Body<D>& body, const Params<D>& p) {
    using S = typename D::value_type;
    State<S> xv;
    Input<S> uv;
    Force<S> fv;
    Params<S> pv;
    each(nx(), [&](auto i) { xv[i] = x[i].v; });
    each(nu(), [&](auto i) { uv[i] = u[i].v; });
    each(nf(), [&](auto i) { fv[i] = f[i].v; });
    each(np(), [&](auto i) { pv[i] = p[i].v; });
    JointSlopes<S> s;
    slopes<S>(xv, uv, fv, {body.gravity_x_m_s2.v, body.gravity_z_m_s2.v, body.payload_kg.v, body.payload_kgm2.v}, pv,
              s);
    D force[kMostForces];  // what pushes each joint beside its own motion
    each(nf(), [&](auto j) {
      const int input = drive(static_cast<int>(j)) - 1;
      const int place = force_index(static_cast<int>(j));
      force[j] = element(f, place);
      if (input >= 0)
        for (int k = 0; k < D::directions; ++k)
          force[j].d[k] = force[j].d[k] + s.input_gain[j] * element(u, input).d[k];
    });
    State<D> out;
    for (int i = 0; i < kForces; ++i) {
      D& rate = element(out, M<double>::joints[i].velocity);
      rate.v = s.acceleration[i];
      for (int k = 0; k < D::directions; ++k) {
        S sum = S(0.0);
        for (int c = 0; c < kStates; ++c) sum = sum + s.by_state[i][c] * element(x, c).d[k];
        rate.d[k] = sum;
      }
      element(out, M<double>::joints[i].position) = element(x, M<double>::joints[i].velocity);
    }
    for (int j = 0; j < kForces; ++j)
      for (int k = 0; k < D::directions; ++k) {
        if (!any(force[j].d[k] != S(0.0))) continue;  // most are: an input pushes its own joint
        for (int i = 0; i < kForces; ++i) {
          S& slope = element(out, M<double>::joints[i].velocity).d[k];
          slope = slope + s.column[j][i] * force[j].d[k];
        }
      }
    return out;
  }

  /// What the model tells of itself; out of line, for a pose's text is long and nothing is gained by copies of it.
  template <class S>
  static __attribute__((noinline)) Output<S> outputs(const State<S>& x, [[maybe_unused]] const Params<S>& p) {
    if constexpr (kParams > 0)
      return M<S>::outputs(x, p);
    else
      return M<S>::outputs(x);
  }

  /// The inverse inertia of a model that has it written out: column[j][i], the acceleration of joint i for a unit force
  /// at joint j.
  template <class S>
  static __attribute__((noinline)) void responses(const State<S>& x, const Body<S>& body, const Params<S>& p,
                                                  S (*column)[kMostForces]) {
    if constexpr (kParams > 0)
      M<S>::responses(x, body, p, column);
    else
      M<S>::responses(x, body, column);
  }

  /// Accelerations (nf) of all joints for a unit force at joint j: a column of the inverse inertia, by a dual number
  /// along that force. A difference of two calls would lose it to rounding in f32 where other forces are large; and of
  /// the sparse dual only the inertia is left to compute, everything that does not depend on the force falls away.
  template <class S, int J>
  static TILLER_INLINE void force_response(const State<S>& x, const Input<S>& u, const Force<S>& f, const Body<S>& body,
                                           const Params<S>& p, Index<J> j, S* column) {
    using D = SparseDual<S>;
    State<D> xd;
    Input<D> ud;
    Force<D> fd;
    Params<D> pd;
    each(nx(), [&](auto i) { xd[i] = D(x[i]); });
    each(nu(), [&](auto i) { ud[i] = D(u[i]); });
    each(nf(), [&](auto i) { fd[i] = D(f[i]); });
    each(np(), [&](auto i) { pd[i] = D(p[i]); });
    fd[force_index(j)] = D::seed(f[force_index(j)]);
    const Body<D> bd = {D(body.gravity_x_m_s2), D(body.gravity_z_m_s2), D(body.payload_kg), D(body.payload_kgm2)};
    // not through dynamics(): GCC inlines less of a call in a call
    if constexpr (kParams > 0) {
      State<D> dx = M<D>::dynamics(xd, ud, fd, bd, pd);
      each(nf(), [&](auto i) { column[i] = velocity<D>(dx, i).slope(); });
    } else {
      State<D> dx = M<D>::dynamics(xd, ud, fd, bd);
      each(nf(), [&](auto i) { column[i] = velocity<D>(dx, i).slope(); });
    }
  }
  /// One text for all joints: what depends on the force is not known to the compiler then. Where it is, above, sharing
  /// the copies below made steps with friction half as slow again.
  template <class S>
  static __attribute__((noinline)) void force_response(const State<S>& x, const Input<S>& u, const Force<S>& f,
                                                       const Body<S>& body, const Params<S>& p, int j, S* column) {
    using D = Dual<S, 1>;
    State<D> xd;
    Input<D> ud;
    Force<D> fd;
    Params<D> pd;
    each(nx(), [&](auto i) { xd[i] = D(x[i]); });
    each(nu(), [&](auto i) { ud[i] = D(u[i]); });
    each(nf(), [&](auto i) { fd[i] = D(f[i]); });
    each(np(), [&](auto i) { pd[i] = D(p[i]); });
    element(fd, force_index(j)).d[0] = S(1.0);
    State<D> dx = dynamics<D>(
        xd, ud, fd, {D(body.gravity_x_m_s2), D(body.gravity_z_m_s2), D(body.payload_kg), D(body.payload_kgm2)}, pd);
    each(nf(), [&](auto i) { column[i] = velocity<D>(dx, i).d[0]; });
  }
};

/// Fields by run-time index, for C tables.
template <class S, int Max>
struct FieldArray {
  S v[Max];
  S& operator[](int i) { return v[i]; }
  const S& operator[](int i) const { return v[i]; }
};

/// A model written in C: double only.
struct TableModel {
  template <class S>
  using State = FieldArray<S, TILLER_MAX_STATES>;
  template <class S>
  using Input = FieldArray<S, TILLER_MAX_INPUTS>;
  template <class S>
  using Params = FieldArray<S, TILLER_MAX_PARAMS>;
  template <class S>
  using Force = FieldArray<S, TILLER_MAX_JOINTS>;
  template <class S>
  using Output = FieldArray<S, TILLER_MAX_OUTPUTS>;

  static constexpr int kOutputs = TILLER_MAX_OUTPUTS;
  static constexpr int kMostInputs = TILLER_MAX_INPUTS;
  static constexpr int kMostForces = TILLER_MAX_JOINTS;
  static constexpr bool kKnowsResponses = false, kKnowsSlopes = false;

  const tiller_model_t* table;
  explicit TableModel(const tiller_model_t& model) : table(&model) {}

  int nx() const { return static_cast<int>(table->state_count); }
  int nu() const { return static_cast<int>(table->input_count); }
  int np() const { return static_cast<int>(table->param_count); }
  int nf() const { return static_cast<int>(table->joint_count); }
  int ny() const { return static_cast<int>(table->output_count); }
  int joints() const { return nf(); }
  bool is_angle(int i) const { return (table->angle_mask >> i) & 1u; }
  static constexpr bool kMayTurn = true, kMaySlip = true, kMayHaveOthers = true;
  std::uint32_t others() const { return nf() > 0 ? states_of_no_joint(table->joints, nf(), nx()) : 0u; }
  std::uint32_t quaternions() const { return table->quaternion_mask; }
  template <class S>
  S* position(State<S>& x, int j) const {
    return table->joints[j].position == TILLER_NO_POSITION ? nullptr : &x[table->joints[j].position];
  }
  template <class S>
  S& velocity(State<S>& x, int j) const {
    return x[table->joints[j].velocity];
  }
  int force_index(int j) const { return table->joints[j].force; }
  int drive(int j) const { return table->joints[j].drive; }

  static tiller_body_t plain(const Body<double>& b) {
    return {b.gravity_x_m_s2, b.gravity_z_m_s2, b.payload_kg, b.payload_kgm2};
  }
  template <class S>
  State<S> dynamics(const State<S>& x, const Input<S>& u, const Force<S>& f, const Body<S>& body,
                    const Params<S>& p) const {
    const tiller_body_t b = plain(body);
    State<S> dx;
    table->dynamics(x.v, u.v, f.v, &b, p.v, dx.v);
    return dx;
  }
  template <class S>
  Output<S> outputs(const State<S>& x, const Params<S>& p) const {
    Output<S> y{};
    table->outputs(x.v, p.v, y.v);
    return y;
  }
  /// The dynamics are affine in the force: one difference is exact but for rounding, which double bears.
  template <class S>
  void force_response(const State<S>& x, const Input<S>& u, const Force<S>& f, const Body<S>& body, const Params<S>& p,
                      int j, S* column) const {
    Force<S> more = f, less = f;
    more[force_index(j)] += 1.0;
    less[force_index(j)] -= 1.0;
    State<S> a = dynamics<S>(x, u, more, body, p), b = dynamics<S>(x, u, less, body, p);
    for (int i = 0; i < nf(); ++i) column[i] = 0.5 * (velocity<S>(a, i) - velocity<S>(b, i));
  }
};

}  // namespace tiller
