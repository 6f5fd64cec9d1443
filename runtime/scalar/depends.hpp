#pragma once

// A number that carries nothing but what it depends on: one bit per variable. A function evaluated on it tells which
// entries of its Jacobian may differ from zero.

#include <cstdint>
#include <type_traits>

#include "scalar/isa.hpp"
#include "tiller/scalar.hpp"

TILLER_ISA_NAMESPACE_BEGIN  // what is instantiated with it is of one instruction set

    struct Depends {
  std::uint64_t on = 0;

  Depends() = default;
  template <class A, class = std::enable_if_t<std::is_arithmetic<A>::value>>
  Depends(A) {}
  static Depends variable(int i) {
    Depends d;
    d.on = std::uint64_t{1} << i;
    return d;
  }
  bool has(int i) const { return (on >> i) & 1u; }

  Depends& operator+=(const Depends& b) { return *this = both(*this, b); }
  Depends& operator-=(const Depends& b) { return *this = both(*this, b); }
  Depends& operator*=(const Depends& b) { return *this = both(*this, b); }
  Depends& operator/=(const Depends& b) { return *this = both(*this, b); }
  friend Depends operator-(const Depends& a) { return a; }
  friend Depends operator+(const Depends& a, const Depends& b) { return both(a, b); }
  friend Depends operator-(const Depends& a, const Depends& b) { return both(a, b); }
  friend Depends operator*(const Depends& a, const Depends& b) { return both(a, b); }
  friend Depends operator/(const Depends& a, const Depends& b) { return both(a, b); }

  // a choice depends on both of its results, whichever way it goes here
  friend bool operator<(const Depends&, const Depends&) { return true; }
  friend bool operator<=(const Depends&, const Depends&) { return true; }
  friend bool operator>(const Depends&, const Depends&) { return true; }
  friend bool operator>=(const Depends&, const Depends&) { return true; }
  friend bool operator==(const Depends&, const Depends&) { return true; }
  friend bool operator!=(const Depends&, const Depends&) { return true; }
  friend Depends select(bool, const Depends& a, const Depends& b) { return both(a, b); }
  friend Depends min(const Depends& a, const Depends& b) { return both(a, b); }
  friend Depends max(const Depends& a, const Depends& b) { return both(a, b); }

  friend Depends sin(const Depends& a) { return a; }
  friend Depends cos(const Depends& a) { return a; }
  friend void sincos(const Depends& a, Depends& sine, Depends& cosine) { sine = cosine = a; }
  friend Depends exp(const Depends& a) { return a; }
  friend Depends log(const Depends& a) { return a; }
  friend Depends tanh(const Depends& a) { return a; }
  friend Depends sqrt(const Depends& a) { return a; }
  friend Depends abs(const Depends& a) { return a; }
  friend Depends copysign(const Depends& a, const Depends&) { return a; }
  friend Depends atan2(const Depends& y, const Depends& x) { return both(y, x); }
  friend Depends floor(const Depends&) { return {}; }
  friend Depends nearest(const Depends&) { return {}; }

 private:
  static Depends both(const Depends& a, const Depends& b) {
    Depends r;
    r.on = a.on | b.on;
    return r;
  }
};

TILLER_ISA_NAMESPACE_END
