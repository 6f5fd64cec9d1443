#pragma once

// A dual number that knows which of its derivatives are zero. The knowledge is a bit mask carried beside them; where
// the code is inlined and unrolled the compiler folds every mask to a constant and the arithmetic with zeros is gone.
// (It may not drop 0 * x by itself: x may be infinite.) Constants cost what they cost a plain number. Not inlined, it
// is still right, only slower than Dual.
//
// Same functions and same choices at kinks as Dual; where no derivative is dropped the bits are the same.

#include <type_traits>

#include "scalar/inline.hpp"
#include "tiller/scalar.hpp"

namespace tiller {

template <class S, int N>
struct MaskedDual {
  using value_type = S;
  static constexpr int directions = N;
  static_assert(N <= 32, "one bit a direction");

  S v;
  S d[N];         // d[i] is set where bit i of `mask` is
  unsigned mask;  // a variable to the language, a constant to the optimiser

  MaskedDual() = default;
  TILLER_INLINE MaskedDual(const S& value) : v(value), mask(0) {}
  template <class A, class = std::enable_if_t<std::is_arithmetic<A>::value && !std::is_same<A, S>::value>>
  TILLER_INLINE MaskedDual(A value) : MaskedDual(S(value)) {}
  /// value with derivative 1 along `direction`
  static TILLER_INLINE MaskedDual seed(const S& value, int direction) {
    MaskedDual x(value);
    x.d[direction] = S(1.0);
    x.mask = 1u << direction;
    return x;
  }
  TILLER_INLINE bool has(int i) const { return (mask >> i) & 1u; }
  /// The derivative along i, zero included.
  TILLER_INLINE S slope(int i) const { return has(i) ? d[i] : S(0.0); }

  /// x with derivatives f(i) where bit i of `bits` is set
  template <class F>
  static TILLER_INLINE MaskedDual make(const S& value, unsigned bits, const F& f) {
    MaskedDual r;
    r.v = value;
    r.mask = bits;
#pragma GCC unroll 32
    for (int i = 0; i < N; ++i)
      if ((bits >> i) & 1u) r.d[i] = f(i);
    return r;
  }
#define TILLER_DERIVATIVE [&](int i) TILLER_INLINED -> S
  friend TILLER_INLINE MaskedDual operator+(const MaskedDual& a, const MaskedDual& b) {
    return make(
        a.v + b.v, a.mask | b.mask, TILLER_DERIVATIVE {
          return a.has(i) && b.has(i) ? a.d[i] + b.d[i] : a.has(i) ? a.d[i] : b.d[i];
        });
  }
  friend TILLER_INLINE MaskedDual operator-(const MaskedDual& a, const MaskedDual& b) {
    return make(
        a.v - b.v, a.mask | b.mask, TILLER_DERIVATIVE {
          return a.has(i) && b.has(i) ? a.d[i] - b.d[i] : a.has(i) ? a.d[i] : -b.d[i];
        });
  }
  friend TILLER_INLINE MaskedDual operator*(const MaskedDual& a, const MaskedDual& b) {
    return make(
        a.v * b.v, a.mask | b.mask, TILLER_DERIVATIVE {
          return a.has(i) && b.has(i) ? a.d[i] * b.v + a.v * b.d[i] : a.has(i) ? a.d[i] * b.v : a.v * b.d[i];
        });
  }
  friend TILLER_INLINE MaskedDual operator/(const MaskedDual& a, const MaskedDual& b) {
    const S value = a.v / b.v;
    if (a.mask == 0 && b.mask == 0) return MaskedDual(value);
    const S inverse = S(1.0) / b.v;
    return make(
        value, a.mask | b.mask, TILLER_DERIVATIVE {
          return (a.has(i) && b.has(i) ? a.d[i] - value * b.d[i] : a.has(i) ? a.d[i] : -value * b.d[i]) * inverse;
        });
  }
  friend TILLER_INLINE MaskedDual operator-(const MaskedDual& a) {
    return make(
        -a.v, a.mask, TILLER_DERIVATIVE { return -a.d[i]; });
  }
  TILLER_INLINE MaskedDual& operator+=(const MaskedDual& b) { return *this = *this + b; }
  TILLER_INLINE MaskedDual& operator-=(const MaskedDual& b) { return *this = *this - b; }
  TILLER_INLINE MaskedDual& operator*=(const MaskedDual& b) { return *this = *this * b; }
  TILLER_INLINE MaskedDual& operator/=(const MaskedDual& b) { return *this = *this / b; }

  friend TILLER_INLINE auto operator<(const MaskedDual& a, const MaskedDual& b) { return a.v < b.v; }
  friend TILLER_INLINE auto operator<=(const MaskedDual& a, const MaskedDual& b) { return a.v <= b.v; }
  friend TILLER_INLINE auto operator>(const MaskedDual& a, const MaskedDual& b) { return a.v > b.v; }
  friend TILLER_INLINE auto operator>=(const MaskedDual& a, const MaskedDual& b) { return a.v >= b.v; }
  friend TILLER_INLINE auto operator==(const MaskedDual& a, const MaskedDual& b) { return a.v == b.v; }
  friend TILLER_INLINE auto operator!=(const MaskedDual& a, const MaskedDual& b) { return a.v != b.v; }

  static TILLER_INLINE MaskedDual chain(const S& value, const S& slope, const MaskedDual& inner) {
    return make(
        value, inner.mask, TILLER_DERIVATIVE { return slope * inner.d[i]; });
  }
  template <class Mask>
  friend TILLER_INLINE MaskedDual select(const Mask& m, const MaskedDual& a, const MaskedDual& b) {
    return make(
        select(m, a.v, b.v), a.mask | b.mask, TILLER_DERIVATIVE { return select(m, a.slope(i), b.slope(i)); });
  }
  friend TILLER_INLINE MaskedDual min(const MaskedDual& a, const MaskedDual& b) { return select(a.v < b.v, a, b); }
  friend TILLER_INLINE MaskedDual max(const MaskedDual& a, const MaskedDual& b) { return select(a.v > b.v, a, b); }
  friend TILLER_INLINE MaskedDual sin(const MaskedDual& a) {
    S s, c;
    sincos(a.v, s, c);
    return chain(s, c, a);
  }
  friend TILLER_INLINE MaskedDual cos(const MaskedDual& a) {
    S s, c;
    sincos(a.v, s, c);
    return chain(c, -s, a);
  }
  friend TILLER_INLINE void sincos(const MaskedDual& a, MaskedDual& sine, MaskedDual& cosine) {
    S s, c;
    sincos(a.v, s, c);
    sine = chain(s, c, a);
    cosine = chain(c, -s, a);
  }
  friend TILLER_INLINE MaskedDual exp(const MaskedDual& a) {
    const S e = exp(a.v);
    return chain(e, e, a);
  }
  friend TILLER_INLINE MaskedDual log(const MaskedDual& a) { return chain(log(a.v), S(1.0) / a.v, a); }
  friend TILLER_INLINE MaskedDual tanh(const MaskedDual& a) {
    const S t = tanh(a.v);
    return chain(t, S(1.0) - t * t, a);
  }
  friend TILLER_INLINE MaskedDual sqrt(const MaskedDual& a) {
    const S root = sqrt(a.v);
    return chain(root, select(root > S(0.0), S(0.5) / root, S(0.0)), a);
  }
  friend TILLER_INLINE MaskedDual abs(const MaskedDual& a) {
    const S slope = select(a.v > S(0.0), S(1.0), select(a.v < S(0.0), S(-1.0), S(0.0)));
    return chain(abs(a.v), slope, a);
  }
  friend TILLER_INLINE MaskedDual copysign(const MaskedDual& a, const MaskedDual& b) {
    const S value = copysign(a.v, b.v);
    return chain(value, select(value == a.v, S(1.0), S(-1.0)), a);
  }
  friend TILLER_INLINE MaskedDual atan2(const MaskedDual& y, const MaskedDual& x) {
    const S square = x.v * x.v + y.v * y.v;
    const S inverse = select(square > S(0.0), S(1.0) / square, S(0.0));
    return make(
        atan2(y.v, x.v), y.mask | x.mask,
        TILLER_DERIVATIVE { return (x.v * y.slope(i) - y.v * x.slope(i)) * inverse; });
  }
  /// Steps: derivative zero.
  friend TILLER_INLINE MaskedDual floor(const MaskedDual& a) { return MaskedDual(floor(a.v)); }
  friend TILLER_INLINE MaskedDual nearest(const MaskedDual& a) { return MaskedDual(nearest(a.v)); }
#undef TILLER_DERIVATIVE
};

}  // namespace tiller
