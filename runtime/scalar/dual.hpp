#pragma once

// A dual number is a value with its derivatives along N directions; arithmetic carries both, so evaluating a
// model once at a dual state gives its Jacobian, exact to rounding. With S a Pack it differentiates several
// lanes at once; with S a Dual it nests.
//
//     Dual<double, 2> x = Dual<double, 2>::seed(3.0, 0), y = Dual<double, 2>::seed(4.0, 1);
//     auto z = x * sin(y);   // z.v = 3 sin 4, z.d[0] = sin 4, z.d[1] = 3 cos 4
//
// Comparisons and select act on values: the derivative is that of the branch taken. At the kinks the choice is:
// d|x|/dx = 0 at 0; sqrt'(0) = 0 and the derivative of atan2 at the origin = 0, in the place of an infinity that
// would poison a whole Jacobian.

#include <type_traits>

#include "scalar/inline.hpp"
#include "tiller/scalar.hpp"

namespace tiller {

/// f(0) ... f(N-1). Many directions stay a loop: unrolled, as GCC does with up to sixteen, they gain nothing and their
/// text takes a model of many joints half of its compile time.
template <int N, class F>
TILLER_INLINE void each_direction(F&& f) {
  if constexpr (N > 8) {
#pragma GCC unroll 1
    for (int i = 0; i < N; ++i) f(i);
  } else {
    for (int i = 0; i < N; ++i) f(i);
  }
}

template <class S, int N>
struct Dual {
  using value_type = S;
  static constexpr int directions = N;

  S v;
  S d[N];

  Dual() = default;
  Dual(const S& value) : v(value) {
    each_direction<N>([&](int i) TILLER_INLINED { d[i] = S(0.0); });
  }
  template <class A, class = std::enable_if_t<std::is_arithmetic<A>::value && !std::is_same<A, S>::value>>
  Dual(A value) : Dual(S(value)) {}
  static Dual seed(const S& value, int direction) {
    Dual x(value);
    x.d[direction] = S(1.0);
    return x;
  }

  friend Dual operator+(const Dual& a, const Dual& b) {
    Dual r;
    r.v = a.v + b.v;
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = a.d[i] + b.d[i]; });
    return r;
  }
  friend Dual operator-(const Dual& a, const Dual& b) {
    Dual r;
    r.v = a.v - b.v;
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = a.d[i] - b.d[i]; });
    return r;
  }
  friend Dual operator*(const Dual& a, const Dual& b) {
    Dual r;
    r.v = a.v * b.v;
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = a.d[i] * b.v + a.v * b.d[i]; });
    return r;
  }
  friend Dual operator/(const Dual& a, const Dual& b) {
    Dual r;
    const S inverse = S(1.0) / b.v;
    r.v = a.v / b.v;  // not a.v * inverse: the value stays that of plain arithmetic, to the last bit
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = (a.d[i] - r.v * b.d[i]) * inverse; });
    return r;
  }
  friend Dual operator-(const Dual& a) {
    Dual r;
    r.v = -a.v;
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = -a.d[i]; });
    return r;
  }
  Dual& operator+=(const Dual& b) { return *this = *this + b; }
  Dual& operator-=(const Dual& b) { return *this = *this - b; }
  Dual& operator*=(const Dual& b) { return *this = *this * b; }
  Dual& operator/=(const Dual& b) { return *this = *this / b; }

  friend auto operator<(const Dual& a, const Dual& b) { return a.v < b.v; }
  friend auto operator<=(const Dual& a, const Dual& b) { return a.v <= b.v; }
  friend auto operator>(const Dual& a, const Dual& b) { return a.v > b.v; }
  friend auto operator>=(const Dual& a, const Dual& b) { return a.v >= b.v; }
  friend auto operator==(const Dual& a, const Dual& b) { return a.v == b.v; }
  friend auto operator!=(const Dual& a, const Dual& b) { return a.v != b.v; }

  /// value with derivative `slope` of the outer function (chain rule)
  static Dual chain(const S& value, const S& slope, const Dual& inner) {
    Dual r;
    r.v = value;
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = slope * inner.d[i]; });
    return r;
  }

  template <class Mask>
  friend Dual select(const Mask& m, const Dual& a, const Dual& b) {
    Dual r;
    r.v = select(m, a.v, b.v);
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = select(m, a.d[i], b.d[i]); });
    return r;
  }
  friend Dual min(const Dual& a, const Dual& b) { return select(a.v < b.v, a, b); }
  friend Dual max(const Dual& a, const Dual& b) { return select(a.v > b.v, a, b); }
  friend Dual sin(const Dual& a) {
    S s, c;
    sincos(a.v, s, c);
    return chain(s, c, a);
  }
  friend Dual cos(const Dual& a) {
    S s, c;
    sincos(a.v, s, c);
    return chain(c, -s, a);
  }
  friend void sincos(const Dual& a, Dual& sine, Dual& cosine) {
    S s, c;
    sincos(a.v, s, c);
    sine = chain(s, c, a);
    cosine = chain(c, -s, a);
  }
  friend Dual exp(const Dual& a) {
    const S e = exp(a.v);
    return chain(e, e, a);
  }
  friend Dual log(const Dual& a) { return chain(log(a.v), S(1.0) / a.v, a); }
  friend Dual tanh(const Dual& a) {
    const S t = tanh(a.v);
    return chain(t, S(1.0) - t * t, a);
  }
  friend Dual sqrt(const Dual& a) {
    const S root = sqrt(a.v);
    const S slope = select(root > S(0.0), S(0.5) / root, S(0.0));
    return chain(root, slope, a);
  }
  friend Dual abs(const Dual& a) {
    const S slope = select(a.v > S(0.0), S(1.0), select(a.v < S(0.0), S(-1.0), S(0.0)));
    return chain(abs(a.v), slope, a);
  }
  friend Dual copysign(const Dual& a, const Dual& b) {
    const S value = copysign(a.v, b.v);
    return chain(value, select(value == a.v, S(1.0), S(-1.0)), a);
  }
  friend Dual atan2(const Dual& y, const Dual& x) {
    const S square = x.v * x.v + y.v * y.v;
    const S inverse = select(square > S(0.0), S(1.0) / square, S(0.0));
    Dual r;
    r.v = atan2(y.v, x.v);
    each_direction<N>([&](int i) TILLER_INLINED { r.d[i] = (x.v * y.d[i] - y.v * x.d[i]) * inverse; });
    return r;
  }
  /// Steps: derivative zero.
  friend Dual floor(const Dual& a) { return Dual(floor(a.v)); }
  friend Dual nearest(const Dual& a) { return Dual(nearest(a.v)); }
};

/// The plain value under any depth of duals: what a bound or a branch looks at.
inline double value_of(double x) { return x; }
template <class S>
const S& value_of(const S& x) {
  return x;
}
template <class S, int N>
auto value_of(const Dual<S, N>& x) -> decltype(value_of(x.v)) {
  return value_of(x.v);
}

}  // namespace tiller
