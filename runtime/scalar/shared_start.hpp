#pragma once

// Lanes that start from a state which all of them share, for one-step residuals. Beside its value a number knows, by
// flags that are constants once everything is inlined,
//   - whether it depends on the shared state alone: then its sines, cosines and the like are the same in every lane and
//     are read from a tape that was recorded once;
//   - how far a state variable has moved from its start, so that the change of a state need not be recovered from a
//     difference of two nearly equal numbers.

#include "scalar/inline.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

/// Results of functions of the shared state in the order of their calls: row i, column c is the i-th result of step c.
/// Recording works on a register of steps at a time, reading on one step and all lanes.
struct Tape {
  static constexpr int kRows = 12;
  float* at;     // row 0 at the step (recording: the first of the register of steps)
  int stride;    // between rows
  bool record;   // a constant
  int next = 0;  // row of the next result; a constant once inlined
  TILLER_INLINE bool has(int rows) const { return next + rows <= kRows; }
  TILLER_INLINE void write(const Pack<float>& value) { value.store(at + next++ * stride); }
  TILLER_INLINE Pack<float> read() { return Pack<float>(at[next++ * stride]); }
};

#define TILLER_SHARED friend TILLER_INLINE SharedStart

struct SharedStart {
  using P = Pack<float>;
  using value_type = float;
  enum Spread { kConstant, kShared, kLane };  // what the value depends on; the larger wins
  enum Kind { kPlain, kStart, kMoved };       // kStart: a state where it began; kMoved: start + change

  P v;
  P start;   // read only of a state
  P change;  // read only where kind is kMoved
  Tape* tape = nullptr;
  Spread spread = kConstant;
  Kind kind = kPlain;

  SharedStart() = default;
  template <class A, class = std::enable_if_t<std::is_arithmetic<A>::value>>
  TILLER_INLINE SharedStart(A value) : SharedStart(P(value), kConstant) {}
  /// By default a value of every lane's own.
  TILLER_INLINE SharedStart(const P& value, Spread s = kLane, Tape* t = nullptr)
      : v(value), start(value), change(value), tape(t), spread(s) {}
  /// A variable of the shared state where the step begins.
  static TILLER_INLINE SharedStart of_state(const P& value, Tape* tape) {
    SharedStart r(value, kShared, tape);
    r.kind = kStart;
    return r;
  }
  /// How far a state has moved from `from`, where it began.
  TILLER_INLINE P moved(const P& from) const { return kind == kMoved ? change : kind == kStart ? P(0.0) : v - from; }

  TILLER_SHARED operator+(const SharedStart& a, const SharedStart& b) {
    if (a.kind != kPlain && b.kind == kPlain) return a.kind == kMoved ? a.move(a.change + b.v, b) : a.move(b.v, b);
    if (a.kind == kPlain && b.kind != kPlain) return b.kind == kMoved ? b.move(b.change + a.v, a) : b.move(a.v, a);
    return plain(a.v + b.v, a, b);
  }
  TILLER_SHARED operator-(const SharedStart& a, const SharedStart& b) {
    if (a.kind != kPlain && b.kind == kPlain) return a.kind == kMoved ? a.move(a.change - b.v, b) : a.move(-b.v, b);
    return plain(a.v - b.v, a, b);
  }
  TILLER_SHARED operator*(const SharedStart& a, const SharedStart& b) { return plain(a.v * b.v, a, b); }
  TILLER_SHARED operator/(const SharedStart& a, const SharedStart& b) { return plain(a.v / b.v, a, b); }
  TILLER_SHARED operator-(const SharedStart& a) { return plain(-a.v, a, a); }
  TILLER_INLINE SharedStart& operator+=(const SharedStart& b) { return *this = *this + b; }
  TILLER_INLINE SharedStart& operator-=(const SharedStart& b) { return *this = *this - b; }
  TILLER_INLINE SharedStart& operator*=(const SharedStart& b) { return *this = *this * b; }
  TILLER_INLINE SharedStart& operator/=(const SharedStart& b) { return *this = *this / b; }

  friend TILLER_INLINE auto operator<(const SharedStart& a, const SharedStart& b) { return a.v < b.v; }
  friend TILLER_INLINE auto operator<=(const SharedStart& a, const SharedStart& b) { return a.v <= b.v; }
  friend TILLER_INLINE auto operator>(const SharedStart& a, const SharedStart& b) { return a.v > b.v; }
  friend TILLER_INLINE auto operator>=(const SharedStart& a, const SharedStart& b) { return a.v >= b.v; }
  friend TILLER_INLINE auto operator==(const SharedStart& a, const SharedStart& b) { return a.v == b.v; }
  friend TILLER_INLINE auto operator!=(const SharedStart& a, const SharedStart& b) { return a.v != b.v; }

  // a mask may differ by lane whatever it chooses from
  template <class Mask>
  TILLER_SHARED select(const Mask& m, const SharedStart& a, const SharedStart& b) {
    return SharedStart(select(m, a.v, b.v), kLane);
  }
  TILLER_SHARED min(const SharedStart& a, const SharedStart& b) { return plain(min(a.v, b.v), a, b); }
  TILLER_SHARED max(const SharedStart& a, const SharedStart& b) { return plain(max(a.v, b.v), a, b); }
  TILLER_SHARED abs(const SharedStart& a) { return plain(abs(a.v), a, a); }
  TILLER_SHARED floor(const SharedStart& a) { return plain(floor(a.v), a, a); }
  TILLER_SHARED nearest(const SharedStart& a) { return plain(nearest(a.v), a, a); }
  TILLER_SHARED sqrt(const SharedStart& a) { return plain(sqrt(a.v), a, a); }
  TILLER_SHARED copysign(const SharedStart& a, const SharedStart& b) { return plain(copysign(a.v, b.v), a, b); }
  TILLER_SHARED atan2(const SharedStart& y, const SharedStart& x) { return plain(atan2(y.v, x.v), y, x); }

  friend TILLER_INLINE void sincos(const SharedStart& a, SharedStart& sine, SharedStart& cosine) {
    P s, c;
    if (a.taped(2) && !a.tape->record) {
      s = a.tape->read();
      c = a.tape->read();
    } else {
      sincos(a.v, s, c);
      if (a.taped(2)) {
        a.tape->write(s);
        a.tape->write(c);
      }
    }
    sine = plain(s, a, a);
    cosine = plain(c, a, a);
  }
  TILLER_SHARED sin(const SharedStart& a) {
    return on_tape(a, [](const P& v) { return sin(v); });
  }
  TILLER_SHARED cos(const SharedStart& a) {
    return on_tape(a, [](const P& v) { return cos(v); });
  }
  TILLER_SHARED exp(const SharedStart& a) {
    return on_tape(a, [](const P& v) { return exp(v); });
  }
  TILLER_SHARED log(const SharedStart& a) {
    return on_tape(a, [](const P& v) { return log(v); });
  }
  TILLER_SHARED tanh(const SharedStart& a) {
    return on_tape(a, [](const P& v) { return tanh(v); });
  }

 private:
  TILLER_INLINE bool taped(int rows) const { return spread == kShared && tape->has(rows); }
  template <class F>
  static TILLER_INLINE SharedStart on_tape(const SharedStart& a, const F& f) {
    if (!a.taped(1)) return plain(f(a.v), a, a);
    if (!a.tape->record) return plain(a.tape->read(), a, a);
    const P value = f(a.v);
    a.tape->write(value);
    return plain(value, a, a);
  }
  static TILLER_INLINE SharedStart plain(const P& value, const SharedStart& a, const SharedStart& b) {
    return SharedStart(value, a.spread > b.spread ? a.spread : b.spread, a.tape ? a.tape : b.tape);
  }
  /// This state, `by` away from its start on account of `other`.
  TILLER_INLINE SharedStart move(const P& by, const SharedStart& other) const {
    SharedStart r = plain(start + by, *this, other);
    r.start = start;
    r.change = by;
    r.kind = kMoved;
    return r;
  }
};
#undef TILLER_SHARED

TILLER_ISA_NAMESPACE_END
