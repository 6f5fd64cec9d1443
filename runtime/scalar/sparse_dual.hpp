#pragma once

// A dual number along one direction that knows where its derivative is zero. Once everything is inlined the flag is a
// constant, so only those derivatives are computed that the direction reaches, and values that nobody reads are not
// computed at all: asking a model for its response to one force costs little more than its inertia.
//
// The derivatives are those of Dual<S, 1> but for the signs of zeros.

#include <type_traits>

#include "scalar/inline.hpp"
#include "tiller/scalar.hpp"

namespace tiller {

#define TILLER_SPARSE friend TILLER_INLINE SparseDual

template <class S>
struct SparseDual {
  using value_type = S;

  S v;
  S d;  // read only where `constant` is false
  bool constant = true;

  SparseDual() = default;
  TILLER_INLINED SparseDual(const S& value) : v(value), d(S(0.0)) {}
  template <class A, class = std::enable_if_t<std::is_arithmetic<A>::value && !std::is_same<A, S>::value>>
  TILLER_INLINED SparseDual(A value) : SparseDual(S(value)) {}
  static TILLER_INLINE SparseDual seed(const S& value) { return chain(value, S(1.0)); }

  TILLER_SPARSE operator+(const SparseDual& a, const SparseDual& b) {
    if (a.constant && b.constant) return SparseDual(a.v + b.v);
    return chain(a.v + b.v, a.constant ? b.d : b.constant ? a.d : a.d + b.d);
  }
  TILLER_SPARSE operator-(const SparseDual& a, const SparseDual& b) {
    if (a.constant && b.constant) return SparseDual(a.v - b.v);
    return chain(a.v - b.v, a.constant ? -b.d : b.constant ? a.d : a.d - b.d);
  }
  TILLER_SPARSE operator*(const SparseDual& a, const SparseDual& b) {
    if (a.constant && b.constant) return SparseDual(a.v * b.v);
    return chain(a.v * b.v, a.constant ? a.v * b.d : b.constant ? a.d * b.v : a.d * b.v + a.v * b.d);
  }
  TILLER_SPARSE operator/(const SparseDual& a, const SparseDual& b) {
    const S ratio = a.v / b.v;
    if (a.constant && b.constant) return SparseDual(ratio);
    const S inverse = S(1.0) / b.v;
    return chain(ratio, (a.constant ? -ratio * b.d : b.constant ? a.d : a.d - ratio * b.d) * inverse);
  }
  TILLER_SPARSE operator-(const SparseDual& a) { return a.constant ? SparseDual(-a.v) : chain(-a.v, -a.d); }
  SparseDual& operator+=(const SparseDual& b) { return *this = *this + b; }
  SparseDual& operator-=(const SparseDual& b) { return *this = *this - b; }
  SparseDual& operator*=(const SparseDual& b) { return *this = *this * b; }
  SparseDual& operator/=(const SparseDual& b) { return *this = *this / b; }

  friend auto operator<(const SparseDual& a, const SparseDual& b) { return a.v < b.v; }
  friend auto operator<=(const SparseDual& a, const SparseDual& b) { return a.v <= b.v; }
  friend auto operator>(const SparseDual& a, const SparseDual& b) { return a.v > b.v; }
  friend auto operator>=(const SparseDual& a, const SparseDual& b) { return a.v >= b.v; }
  friend auto operator==(const SparseDual& a, const SparseDual& b) { return a.v == b.v; }
  friend auto operator!=(const SparseDual& a, const SparseDual& b) { return a.v != b.v; }

  template <class Mask>
  TILLER_SPARSE select(const Mask& m, const SparseDual& a, const SparseDual& b) {
    if (a.constant && b.constant) return SparseDual(select(m, a.v, b.v));
    return chain(select(m, a.v, b.v), select(m, a.slope(), b.slope()));
  }
  TILLER_SPARSE min(const SparseDual& a, const SparseDual& b) { return select(a.v < b.v, a, b); }
  TILLER_SPARSE max(const SparseDual& a, const SparseDual& b) { return select(a.v > b.v, a, b); }
  friend TILLER_INLINE void sincos(const SparseDual& a, SparseDual& sine, SparseDual& cosine) {
    S s, c;
    sincos(a.v, s, c);
    sine = a.constant ? SparseDual(s) : chain(s, c * a.d);
    cosine = a.constant ? SparseDual(c) : chain(c, -s * a.d);
  }
  TILLER_SPARSE sin(const SparseDual& a) {
    SparseDual s, c;
    sincos(a, s, c);
    return s;
  }
  TILLER_SPARSE cos(const SparseDual& a) {
    SparseDual s, c;
    sincos(a, s, c);
    return c;
  }
  TILLER_SPARSE exp(const SparseDual& a) {
    const S e = exp(a.v);
    return a.constant ? SparseDual(e) : chain(e, e * a.d);
  }
  TILLER_SPARSE log(const SparseDual& a) { return a.constant ? SparseDual(log(a.v)) : chain(log(a.v), a.d / a.v); }
  TILLER_SPARSE tanh(const SparseDual& a) {
    const S t = tanh(a.v);
    return a.constant ? SparseDual(t) : chain(t, (S(1.0) - t * t) * a.d);
  }
  TILLER_SPARSE sqrt(const SparseDual& a) {
    const S root = sqrt(a.v);
    if (a.constant) return SparseDual(root);
    return chain(root, select(root > S(0.0), S(0.5) / root, S(0.0)) * a.d);
  }
  TILLER_SPARSE abs(const SparseDual& a) {
    if (a.constant) return SparseDual(abs(a.v));
    return chain(abs(a.v), select(a.v > S(0.0), S(1.0), select(a.v < S(0.0), S(-1.0), S(0.0))) * a.d);
  }
  TILLER_SPARSE copysign(const SparseDual& a, const SparseDual& b) {
    const S value = copysign(a.v, b.v);
    return a.constant ? SparseDual(value) : chain(value, select(value == a.v, S(1.0), S(-1.0)) * a.d);
  }
  TILLER_SPARSE atan2(const SparseDual& y, const SparseDual& x) {
    const S value = atan2(y.v, x.v);
    if (x.constant && y.constant) return SparseDual(value);
    const S square = x.v * x.v + y.v * y.v;
    const S inverse = select(square > S(0.0), S(1.0) / square, S(0.0));
    return chain(value, (x.v * y.slope() - y.v * x.slope()) * inverse);
  }
  TILLER_SPARSE floor(const SparseDual& a) { return SparseDual(floor(a.v)); }
  TILLER_SPARSE nearest(const SparseDual& a) { return SparseDual(nearest(a.v)); }

  TILLER_INLINE S slope() const { return constant ? S(0.0) : d; }
  static TILLER_INLINE SparseDual chain(const S& value, const S& slope) {
    SparseDual r;
    r.v = value;
    r.d = slope;
    r.constant = false;
    return r;
  }
};
#undef TILLER_SPARSE

}  // namespace tiller
