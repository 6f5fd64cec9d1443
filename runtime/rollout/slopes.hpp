#pragma once

// One period of the free step with its derivatives by state and input.
//
// Looped: the dynamics are differentiated by dual numbers, in one text out of line; through the integrator the chain
// rule goes in loops, past the entries of the dynamics' Jacobian that are zero for every state: with D the state's own
// derivatives,
//
//   k = f(x, u),   dk/d(x, u) = f_x D + [0 f_u]
//
// Many directions: columns of the dynamics' Jacobian that share no row are told apart by it, so they go along one
// derivative (Curtis, Powell and Reid, 1974). A chain of sixteen carts, 36 columns, takes eight derivatives at once.
//
// In one piece: the whole step in dual numbers whose zeros are known to the compiler. That is up to a half faster, and
// its text grows with the square of the states and with the equations: models of few states and short equations have
// it, for one substep. With long ones the loops' call costs less than what they save.

#include "rollout/step.hpp"
#include "scalar/depends.hpp"
#include "scalar/dual.hpp"
#include "scalar/masked_dual.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

template <class Model>
struct Slopes {
  using P = Pack<double>;
  static constexpr int kStates = Model::kStates, kDirections = Model::kStates + Model::kInputs;
  using State = typename Model::template State<P>;
  using Input = typename Model::template Input<P>;
  using Force = typename Model::template Force<P>;
  using Params = typename Model::template Params<P>;
  using Jacobian = P[kStates][kDirections];

  static constexpr bool kColoured = kDirections > 16;
  /// Derivatives that a pass of a coloured Jacobian carries. The equations of a robot with many joints have some ten
  /// thousand terms with eight, which no first-level cache holds.
  static constexpr int kPass = Model::kLongDynamics ? 4 : 8;

  /// The dependencies of each state's rate: states, then inputs. Columns of one colour share no row.
  struct Pattern {
    std::uint8_t count[kStates], states[kStates], column[kStates][kDirections];
    std::uint8_t colour[kDirections], colours;
    __attribute__((noinline)) void find() {
      static_assert(kDirections <= 64, "Depends has one bit a direction");
      if constexpr (Model::kKnowsSlopes) return find_joints();
      typename Model::template State<Depends> x;
      typename Model::template Input<Depends> u;
      each(Model::nx(), [&](auto i) { x[i] = Depends::variable(i); });
      each(Model::nu(), [&](auto i) { u[i] = Depends::variable(kStates + i); });
      const auto dx = Model::template dynamics<Depends>(x, u, {}, {}, {});
      std::uint64_t rows[kDirections] = {};
      each(Model::nx(), [&](auto i) {
        count[i] = states[i] = 0;
        for (int c = 0; c < kDirections; ++c) {
          if (!dx[i].has(c)) continue;
          column[i][count[i]++] = static_cast<std::uint8_t>(c);
          if (c < kStates) states[i] = count[i];
          rows[c] |= std::uint64_t{1} << i;
        }
      });
      if (kColoured) choose_colours(rows);
    }

   private:
    /// A position's rate is its speed; a speed's depends on everything.
    void find_joints() {
      each(Model::nf(), [&](auto j) {
        const int speed = Model::velocity_index(j), place = Model::position_index(j);
        count[place] = states[place] = 1;
        column[place][0] = static_cast<std::uint8_t>(speed);
        count[speed] = static_cast<std::uint8_t>(kDirections);
        states[speed] = static_cast<std::uint8_t>(kStates);
        for (int c = 0; c < kDirections; ++c) column[speed][c] = static_cast<std::uint8_t>(c);
      });
    }
    void choose_colours(const std::uint64_t* rows) {
      std::uint64_t taken[kDirections] = {};
      colours = 0;
      for (int c = 0; c < kDirections; ++c) {
        int k = 0;
        while (taken[k] & rows[c]) ++k;
        taken[k] |= rows[c];
        colour[c] = static_cast<std::uint8_t>(k);
        if (k >= colours) colours = static_cast<std::uint8_t>(k + 1);
      }
    }
  };

  const StepSetup& setup;
  double period_s;
  Body<P> body;
  Pattern pattern;  // found only where it is used
  Input u;          // of the period; set by the caller, as are the parameters
  Params p;

  Slopes(const StepSetup& with, double period) : setup(with), period_s(period), body(Body<P>::from(with.body)) {
    if (!in_one_piece()) pattern.find();
  }

  /// Where results go: rows of `stride` numbers, a register wide each.
  struct Rows {
    double *next, *a, *b;  // (nx), (nx x nx), (nx x nu); a and b nullable
    std::size_t stride;

    TILLER_INLINE void put(int i, const P& value) const { value.store(next + i * stride); }
    template <class SlopeAt>
    TILLER_INLINE void put_slopes(int i, const SlopeAt& slope) const {
      if (a)
#pragma GCC unroll 16
        for (int c = 0; c < kStates; ++c) slope(c).store(a + (i * kStates + c) * stride);
      if (b)
#pragma GCC unroll 16
        for (int c = 0; c < Model::kInputs; ++c) slope(kStates + c).store(b + (i * Model::kInputs + c) * stride);
    }
  };

  /// The dynamics' Jacobian by state (a) and input (b), of the first lane.
  static void store_rates(const State& x, const Input& u, const Force& f, const Body<P>& body, const Params& p,
                          double* a, double* b) {
    State dx;
    Jacobian j;
    rates_by_model(x, u, f, body, p, dx, j);
    for (int i = 0; i < kStates; ++i)
      for (int c = 0; c < kDirections; ++c) {
        alignas(64) double lanes[P::width];
        j[i][c].store(lanes);
        (c < kStates ? a[i * kStates + c] : b[i * Model::kInputs + c - kStates]) = lanes[0];
      }
  }

  /// The period from x.
  TILLER_INLINE void advance(const State& x, const Rows& to) const {
    if constexpr (kShort)
      if (in_one_piece()) switch (setup.integrator) {
          case tiller_integrator_semi_implicit_euler: return whole<tiller_integrator_semi_implicit_euler>(x, to);
          case tiller_integrator_midpoint: return whole<tiller_integrator_midpoint>(x, to);
          default: return whole<tiller_integrator_rk4>(x, to);
        }
    looped(x, to);
  }

 private:
  static constexpr bool kShort = Model::kFewStates && !Model::kLongDynamics;
  bool in_one_piece() const { return kShort && setup.substeps == 1; }

  template <tiller_integrator_t kIntegrator>
  __attribute__((flatten, noinline)) void whole(const State& x, const Rows& to) const {
    using D = MaskedDual<P, kDirections>;
    const Stepper<Model, D> stepper({}, setup, period_s);
    typename Model::template State<D> xd;
    typename Model::template Input<D> ud;
    typename Model::template Params<D> pd;
    each(Model::nx(), [&](auto i) { xd[i] = D::seed(x[i], i); });
    each(Model::nu(), [&](auto i) { ud[i] = D::seed(u[i], kStates + i); });
    each(Model::np(), [&](auto i) { pd[i] = D(p[i]); });
    xd = stepper.free_step(kIntegrator, xd, ud, stepper.no_force(), pd);
    each(Model::nx(), [&](auto i) {
      to.put(i, xd[i].v);
      to.put_slopes(i, [&](int c) TILLER_INLINED { return xd[i].slope(c); });
    });
  }

  __attribute__((noinline)) void looped(const State& from, const Rows& to) const {
    const double h = period_s / setup.substeps;
    State x = from, next;
    Jacobian d;
    step<true>(h, x, next, d);
    normalise(next, d);
    for (std::uint32_t k = 1; k < setup.substeps; ++k) {
      x = next;
      step<false>(h, x, next, d);
      normalise(next, d);
    }
    each(Model::looped_nx(), [&](auto i) {
      to.put(i, element(next, i));
      to.put_slopes(i, [&](int c) TILLER_INLINED { return d[i][c]; });
    });
  }

  /// Quaternions come back to unit length, and their derivatives lose the part along them: with n = q / |q|,
  /// dn = (1 - n n') dq / |q|.
  TILLER_INLINE void normalise(State& x, Jacobian& d) const {
    each_quaternion(Model{}, [&](auto index) {
      constexpr int first = decltype(index)::value;
      const Quaternion<P> q = quaternion_of<P>([&](auto i) { return x[i]; }, index), n = normalised(q);
      put_quaternion(x, index, n);
      const P length = dot(n, q), unit[4] = {n.w, n.x, n.y, n.z};
      const P shrink = P(1.0) / select(length > P(0.0), length, P(1.0));
      for (int c = 0; c < kDirections; ++c) {
        P along = unit[0] * d[first][c];
        for (int k = 1; k < 4; ++k) along = along + unit[k] * d[first + k][c];
        for (int k = 0; k < 4; ++k) d[first + k][c] = shrink * (d[first + k][c] - unit[k] * along);
      }
    });
  }

  /// dx = f(x, u) and its Jacobian.
  TILLER_INLINE void rates(const State& x, State& dx, Jacobian& j) const {
    if constexpr (Model::kKnowsSlopes)
      rates_by_model(x, dx, j);
    else if constexpr (kColoured)
      rates_by_colour(x, dx, j);
    else
      rates_at_once(x, dx, j);
  }
  __attribute__((noinline)) void rates_by_model(const State& x, State& dx, Jacobian& j) const {
    Force none;
    each(Model::nf(), [&](auto i) { none[i] = P(0.0); });
    rates_by_model(x, u, none, body, p, dx, j);
  }
  static __attribute__((noinline)) void rates_by_model(const State& x, const Input& u, const Force& f,
                                                       const Body<P>& body, const Params& p, State& dx, Jacobian& j) {
    typename Model::template JointSlopes<P> s;
    Model::template slopes<P>(x, u, f, body, p, s);
    for (auto& row : j)
      for (P& slope : row) slope = P(0.0);
    each(Model::joints(), [&](auto i) {
      const int speed = Model::velocity_index(i), place = Model::position_index(i);
      element(dx, place) = element(x, speed);
      element(dx, speed) = s.acceleration[i];
      j[place][speed] = P(1.0);
      for (int c = 0; c < kStates; ++c) j[speed][c] = s.by_state[i][c];
      each(Model::joints(), [&](auto m) {
        if (const int input = Model::drive(static_cast<int>(m)); input > 0)
          j[speed][kStates + input - 1] = s.column[m][i] * s.input_gain[m];
      });
    });
  }
  __attribute__((noinline)) void rates_by_colour(const State& x, State& dx, Jacobian& j) const {
    using D = Dual<P, kPass>;
    for (auto& row : j)
      for (P& slope : row) slope = P(0.0);
    for (int first = 0; first < pattern.colours; first += kPass) {
      typename Model::template State<D> xd;
      typename Model::template Input<D> ud;
      typename Model::template Force<D> fd;
      typename Model::template Params<D> pd;
      const auto in_pass = [&](int c) { return static_cast<unsigned>(pattern.colour[c] - first) < kPass; };
      const auto seeded = [&](const P& value, int c) {
        return in_pass(c) ? D::seed(value, pattern.colour[c] - first) : D(value);
      };
      each(Model::nx(), [&](auto i) { xd[i] = seeded(x[i], i); });
      each(Model::nu(), [&](auto i) { ud[i] = seeded(u[i], kStates + i); });
      each(Model::nf(), [&](auto i) { fd[i] = D(0.0); });
      each(Model::np(), [&](auto i) { pd[i] = D(p[i]); });
      const auto rate = Model::template dynamics<D>(
          xd, ud, fd, {D(body.gravity_x_m_s2), D(body.gravity_z_m_s2), D(body.payload_kg), D(body.payload_kgm2)}, pd);
      each(Model::nx(), [&](auto i) {
        dx[i] = rate[i].v;
        for (int q = 0; q < pattern.count[i]; ++q)
          if (const int c = pattern.column[i][q]; in_pass(c)) j[i][c] = rate[i].d[pattern.colour[c] - first];
      });
    }
  }
  __attribute__((flatten, noinline)) void rates_at_once(const State& x, State& dx, Jacobian& j) const {
    using D = MaskedDual<P, kDirections>;
    typename Model::template State<D> xd;
    typename Model::template Input<D> ud;
    typename Model::template Force<D> fd;
    typename Model::template Params<D> pd;
    each(Model::nx(), [&](auto i) { xd[i] = D::seed(x[i], i); });
    each(Model::nu(), [&](auto i) { ud[i] = D::seed(u[i], kStates + i); });
    each(Model::nf(), [&](auto i) { fd[i] = D(0.0); });
    each(Model::np(), [&](auto i) { pd[i] = D(p[i]); });
    const auto rate = Model::template dynamics<D>(
        xd, ud, fd, {D(body.gravity_x_m_s2), D(body.gravity_z_m_s2), D(body.payload_kg), D(body.payload_kgm2)}, pd);
    each(Model::nx(), [&](auto i) {
      dx[i] = rate[i].v;
#pragma GCC unroll 32
      for (int c = 0; c < kDirections; ++c) j[i][c] = rate[i].slope(c);
    });
  }
  /// The same where the state has derivatives d of its own.
  TILLER_INLINE void rates_along(const State& x, const Jacobian& d, State& dx, Jacobian& k) const {
    Jacobian j;
    rates(x, dx, j);
    for (int i = 0; i < kStates; ++i) {
      P row[kDirections];
      for (int c = 0; c < kStates; ++c) row[c] = P(0.0);
      for (int c = kStates; c < kDirections; ++c) row[c] = j[i][c];
      for (int q = 0; q < pattern.states[i]; ++q) {
        const int m = pattern.column[i][q];
        const P slope = j[i][m];
#pragma GCC unroll 8
        for (int c = 0; c < kDirections; ++c) row[c] = row[c] + slope * d[m][c];
      }
      for (int c = 0; c < kDirections; ++c) k[i][c] = row[c];
    }
  }

  /// e = d + h k; kUnit: d is the unit matrix, and not read.
  template <bool kUnit>
  static TILLER_INLINE void along(const Jacobian& d, const P& h, const Jacobian& k, Jacobian& e) {
    for (int i = 0; i < kStates; ++i)
      for (int c = 0; c < kDirections; ++c)
        if constexpr (kUnit)
          e[i][c] = i == c ? P(1.0) + h * k[i][c] : h * k[i][c];
        else
          e[i][c] = d[i][c] + h * k[i][c];
  }
  static TILLER_INLINE void along(const State& x, const P& h, const State& dx, State& next) {
    each(Model::looped_nx(), [&](auto i) { element(next, i) = element(x, i) + h * element(dx, i); });
  }

  /// One substep of `h` seconds from x to next; d, the derivatives of x (kUnit: the unit matrix, d is not read), become
  /// those of next.
  template <bool kUnit>
  __attribute__((noinline)) void step(double h, const State& x, State& next, Jacobian& d) const {
    State k1, y;
    Jacobian s1, e;
    if constexpr (kUnit)
      rates(x, k1, s1);
    else
      rates_along(x, d, k1, s1);
    if (setup.integrator == tiller_integrator_semi_implicit_euler) {
      if constexpr (!kUnit) copy(d, e);
      along(x, P(h), k1, next);
      along<kUnit>(d, P(h), s1, d);
      State before = x;
      each(Model::joints(), [&](auto joint) {
        P* const q = Model::template position<P>(next, joint);
        if (!q) return;
        const P& v = Model::template velocity<P>(next, joint);
        *q = *Model::template position<P>(before, joint) + P(h) * v;
        const auto i = q - &element(next, 0), of_v = &v - &element(next, 0);
        for (int c = 0; c < kDirections; ++c) d[i][c] = (kUnit ? P(i == c ? 1.0 : 0.0) : e[i][c]) + P(h) * d[of_v][c];
      });
      return;
    }
    State k2;
    Jacobian s2;
    along(x, P(0.5 * h), k1, y);
    along<kUnit>(d, P(0.5 * h), s1, e);
    rates_along(y, e, k2, s2);
    if (setup.integrator == tiller_integrator_midpoint) {
      along(x, P(h), k2, next);
      along<kUnit>(d, P(h), s2, d);
      return;
    }
    State k3, k4;
    Jacobian s3;
    along(x, P(0.5 * h), k2, y);
    along<kUnit>(d, P(0.5 * h), s2, e);
    rates_along(y, e, k3, s3);
    along(x, P(h), k3, y);
    along<kUnit>(d, P(h), s3, e);
    for (int i = 0; i < kStates; ++i)
      for (int c = 0; c < kDirections; ++c) s1[i][c] = s1[i][c] + P(2.0) * (s2[i][c] + s3[i][c]);
    rates_along(y, e, k4, s3);
    each(Model::looped_nx(), [&](auto i) {
      element(next, i) =
          element(x, i) + P(h / 6.0) * (element(k1, i) + P(2.0) * (element(k2, i) + element(k3, i)) + element(k4, i));
    });
    for (int i = 0; i < kStates; ++i)
      for (int c = 0; c < kDirections; ++c) s1[i][c] = s1[i][c] + s3[i][c];
    along<kUnit>(d, P(h / 6.0), s1, d);
  }
  static TILLER_INLINE void copy(const Jacobian& from, Jacobian& to) {
    for (int i = 0; i < kStates; ++i)
      for (int c = 0; c < kDirections; ++c) to[i][c] = from[i][c];
  }
};

TILLER_ISA_NAMESPACE_END
