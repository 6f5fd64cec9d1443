#pragma once

// Lanes: a Pack<T> is one SIMD register of T with the operators of a number, so that a model's text runs in it
// unchanged. Usable only in sources compiled per instruction set (tiller_isa_sources): every name here stands in
// an inline namespace named after the instruction set, so that copies compiled with different flags never meet
// in the linker.
//
// xsimd supplies registers, arithmetic, exp, log, tanh and atan2. sin and cos are ours (sincos below): xsimd's
// range reduction branches and is twice as slow in a rollout, where angles stay within a few turns.

#ifndef TILLER_COMPILE_ISA
#error "scalar/pack.hpp is for sources listed with tiller_isa_sources()"
#endif

#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "scalar/inline.hpp"
#include "scalar/isa.hpp"
#include "tiller/math.hpp"

#if !defined(TILLER_COMPILE_ISA_scalar)
#include <xsimd/xsimd.hpp>
#define TILLER_PACK_XSIMD 1
#endif

TILLER_ISA_NAMESPACE_BEGIN

#ifdef TILLER_PACK_XSIMD
template <class T>
using Register = xsimd::batch<T, xsimd::default_arch>;

/// A register's bits as another register. Not xsimd::bitwise_cast: its template argument is the register up to
/// xsimd 8 and the element from xsimd 9 on. The copy compiles to nothing.
template <class To, class From>
To same_bits(const From& from) {
  static_assert(sizeof(To) == sizeof(From), "registers of one width");
  To to;
  std::memcpy(static_cast<void*>(&to), static_cast<const void*>(&from), sizeof to);
  return to;
}
#else
/// One lane, for targets without SIMD and for the reproducible build.
template <class T>
struct Register {
  T v;
  static constexpr std::size_t size = 1;
  Register() = default;
  Register(T x) : v(x) {}
};
#endif

template <class T>
struct PackMask {
#ifdef TILLER_PACK_XSIMD
  xsimd::batch_bool<T, xsimd::default_arch> m;
#else
  bool m;
#endif
  friend PackMask operator&(const PackMask& a, const PackMask& b) { return {a.m & b.m}; }
  friend PackMask operator|(const PackMask& a, const PackMask& b) { return {a.m | b.m}; }
  friend PackMask operator!(const PackMask& a) { return {!a.m}; }
};

/// `width` lanes of T (float or double).
template <class T>
struct Pack {
  using value_type = T;
  using Mask = PackMask<T>;
  static constexpr int width = static_cast<int>(Register<T>::size);

  Register<T> v;

  Pack() = default;
  Pack(const Register<T>& x) : v(x) {}
  template <class A, class = std::enable_if_t<std::is_arithmetic<A>::value>>
  Pack(A x) : v(static_cast<T>(x)) {}

#ifdef TILLER_PACK_XSIMD
  static Pack load(const T* p) { return Register<T>::load_unaligned(p); }
  void store(T* p) const { v.store_unaligned(p); }
  T lane(int i) const {
    alignas(64) T all[width];
    v.store_aligned(all);
    return all[i];
  }
  friend Pack operator+(const Pack& a, const Pack& b) { return a.v + b.v; }
  friend Pack operator-(const Pack& a, const Pack& b) { return a.v - b.v; }
  friend Pack operator*(const Pack& a, const Pack& b) { return a.v * b.v; }
  friend Pack operator/(const Pack& a, const Pack& b) { return a.v / b.v; }
  friend Pack operator-(const Pack& a) { return -a.v; }
  friend Mask operator<(const Pack& a, const Pack& b) { return {a.v < b.v}; }
  friend Mask operator<=(const Pack& a, const Pack& b) { return {a.v <= b.v}; }
  friend Mask operator>(const Pack& a, const Pack& b) { return {a.v > b.v}; }
  friend Mask operator>=(const Pack& a, const Pack& b) { return {a.v >= b.v}; }
  friend Mask operator==(const Pack& a, const Pack& b) { return {a.v == b.v}; }
  // not xsimd's !=: its AVX copies are ordered comparisons, false for NaN != NaN (8.1)
  friend Mask operator!=(const Pack& a, const Pack& b) { return {!(a.v == b.v)}; }
#else
  static Pack load(const T* p) { return Register<T>(*p); }
  void store(T* p) const { *p = v.v; }
  T lane(int) const { return v.v; }
  friend Pack operator+(const Pack& a, const Pack& b) { return a.v.v + b.v.v; }
  friend Pack operator-(const Pack& a, const Pack& b) { return a.v.v - b.v.v; }
  friend Pack operator*(const Pack& a, const Pack& b) { return a.v.v * b.v.v; }
  friend Pack operator/(const Pack& a, const Pack& b) { return a.v.v / b.v.v; }
  friend Pack operator-(const Pack& a) { return -a.v.v; }
  friend Mask operator<(const Pack& a, const Pack& b) { return {a.v.v < b.v.v}; }
  friend Mask operator<=(const Pack& a, const Pack& b) { return {a.v.v <= b.v.v}; }
  friend Mask operator>(const Pack& a, const Pack& b) { return {a.v.v > b.v.v}; }
  friend Mask operator>=(const Pack& a, const Pack& b) { return {a.v.v >= b.v.v}; }
  friend Mask operator==(const Pack& a, const Pack& b) { return {a.v.v == b.v.v}; }
  friend Mask operator!=(const Pack& a, const Pack& b) { return {a.v.v != b.v.v}; }
#endif
  Pack& operator+=(const Pack& b) { return *this = *this + b; }
  Pack& operator-=(const Pack& b) { return *this = *this - b; }
  Pack& operator*=(const Pack& b) { return *this = *this * b; }
  Pack& operator/=(const Pack& b) { return *this = *this / b; }
};

// ---- lane-wise functions ------------------------------------------------------------------------

#ifdef TILLER_PACK_XSIMD
template <class T>
bool any(const PackMask<T>& m) {
  return xsimd::any(m.m);
}
template <class T>
bool all(const PackMask<T>& m) {
  return xsimd::all(m.m);
}
#define TILLER_PACK_UNARY(name)    \
  template <class T>               \
  Pack<T> name(const Pack<T>& a) { \
    return xsimd::name(a.v);       \
  }
TILLER_PACK_UNARY(abs)
TILLER_PACK_UNARY(sqrt)
TILLER_PACK_UNARY(floor)
TILLER_PACK_UNARY(exp)
TILLER_PACK_UNARY(log)
TILLER_PACK_UNARY(tanh)
#undef TILLER_PACK_UNARY
template <class T>
Pack<T> select_pack(const PackMask<T>& m, const Pack<T>& a, const Pack<T>& b) {
  return xsimd::select(m.m, a.v, b.v);
}
template <class T>
Pack<T> fma_pack(const Pack<T>& a, const Pack<T>& b, const Pack<T>& c) {
  return xsimd::fma(a.v, b.v, c.v);
}
/// min and max return the second argument where either is NaN or both are zeros, as the x86 instructions do.
template <class T>
Pack<T> min_pack(const Pack<T>& a, const Pack<T>& b) {
#ifdef __SSE2__
  return xsimd::min(a.v, b.v);
#else
  return xsimd::select(a.v < b.v, a.v, b.v);
#endif
}
template <class T>
Pack<T> max_pack(const Pack<T>& a, const Pack<T>& b) {
#ifdef __SSE2__
  return xsimd::max(a.v, b.v);
#else
  return xsimd::select(a.v > b.v, a.v, b.v);
#endif
}
template <class T>
Pack<T> copysign_pack(const Pack<T>& a, const Pack<T>& b) {
  return xsimd::copysign(a.v, b.v);
}
template <class T>
Pack<T> atan2_pack(const Pack<T>& a, const Pack<T>& b) {
  return xsimd::atan2(a.v, b.v);
}
/// Sum of the lanes in a fixed order (lane 0 first): the same on every instruction set of equal width.
template <class T>
T reduce_add(const Pack<T>& a) {
  alignas(64) T all_lanes[Pack<T>::width];
  a.v.store_aligned(all_lanes);
  T sum = all_lanes[0];
  for (int i = 1; i < Pack<T>::width; ++i) sum += all_lanes[i];
  return sum;
}
#else
template <class T>
bool any(const PackMask<T>& m) {
  return m.m;
}
template <class T>
bool all(const PackMask<T>& m) {
  return m.m;
}
#define TILLER_PACK_UNARY(name, fn) \
  template <class T>                \
  Pack<T> name(const Pack<T>& a) {  \
    return fn(a.v.v);               \
  }
TILLER_PACK_UNARY(abs, std::abs)
TILLER_PACK_UNARY(sqrt, std::sqrt)
TILLER_PACK_UNARY(floor, std::floor)
TILLER_PACK_UNARY(exp, math::exp)
TILLER_PACK_UNARY(log, math::log)
TILLER_PACK_UNARY(tanh, math::tanh)
#undef TILLER_PACK_UNARY
template <class T>
Pack<T> select_pack(const PackMask<T>& m, const Pack<T>& a, const Pack<T>& b) {
  return m.m ? a : b;
}
template <class T>
Pack<T> fma_pack(const Pack<T>& a, const Pack<T>& b, const Pack<T>& c) {
  return a * b + c;
}
template <class T>
Pack<T> min_pack(const Pack<T>& a, const Pack<T>& b) {
  return a.v.v < b.v.v ? a : b;
}
template <class T>
Pack<T> max_pack(const Pack<T>& a, const Pack<T>& b) {
  return a.v.v > b.v.v ? a : b;
}
template <class T>
Pack<T> copysign_pack(const Pack<T>& a, const Pack<T>& b) {
  return std::copysign(a.v.v, b.v.v);
}
template <class T>
Pack<T> atan2_pack(const Pack<T>& a, const Pack<T>& b) {
  return math::atan2(a.v.v, b.v.v);
}
template <class T>
T reduce_add(const Pack<T>& a) {
  return a.v.v;
}
#endif

// Two-argument functions for each element type, not templates, so that plain numbers convert: min(x, 1.0).
#define TILLER_PACK_FUNCTIONS(T)                                                                                      \
  inline Pack<T> select(const PackMask<T>& m, const Pack<T>& a, const Pack<T>& b) { return select_pack<T>(m, a, b); } \
  inline Pack<T> fma(const Pack<T>& a, const Pack<T>& b, const Pack<T>& c) { return fma_pack<T>(a, b, c); }           \
  inline Pack<T> min(const Pack<T>& a, const Pack<T>& b) { return min_pack<T>(a, b); }                                \
  inline Pack<T> max(const Pack<T>& a, const Pack<T>& b) { return max_pack<T>(a, b); }                                \
  inline Pack<T> copysign(const Pack<T>& a, const Pack<T>& b) { return copysign_pack<T>(a, b); }                      \
  inline Pack<T> atan2(const Pack<T>& a, const Pack<T>& b) { return atan2_pack<T>(a, b); }
TILLER_PACK_FUNCTIONS(float)
TILLER_PACK_FUNCTIONS(double)
#undef TILLER_PACK_FUNCTIONS

// ---- 32-bit integers ----------------------------------------------------------------------------

/// Unsigned 32-bit lanes, as many as Pack<float> has.
struct IntPack {
  static constexpr int width = Pack<float>::width;
#ifdef TILLER_PACK_XSIMD
  using Reg = xsimd::batch<std::uint32_t, xsimd::default_arch>;
#else
  using Reg = std::uint32_t;
#endif
  Reg v;
  IntPack() = default;
  IntPack(const Reg& x) : v(x) {}
#ifdef TILLER_PACK_XSIMD
  explicit IntPack(std::uint32_t x) : v(x) {}
  static IntPack load(const std::uint32_t* p) { return Reg::load_unaligned(p); }
  void store(std::uint32_t* p) const { v.store_unaligned(p); }
#else
  static IntPack load(const std::uint32_t* p) { return Reg(*p); }
  void store(std::uint32_t* p) const { *p = v; }
#endif
  friend IntPack operator+(const IntPack& a, const IntPack& b) { return Reg(a.v + b.v); }
  friend IntPack operator*(const IntPack& a, const IntPack& b) { return Reg(a.v * b.v); }
  friend IntPack operator^(const IntPack& a, const IntPack& b) { return Reg(a.v ^ b.v); }
  friend IntPack operator&(const IntPack& a, const IntPack& b) { return Reg(a.v & b.v); }
  friend IntPack operator|(const IntPack& a, const IntPack& b) { return Reg(a.v | b.v); }
  friend IntPack operator<<(const IntPack& a, int n) { return Reg(a.v << n); }
  friend IntPack operator>>(const IntPack& a, int n) { return Reg(a.v >> n); }
};

/// first, first + 1, ...
inline IntPack counting(std::uint32_t first) {
  std::uint32_t all[IntPack::width];
  for (int i = 0; i < IntPack::width; ++i) all[i] = first + static_cast<std::uint32_t>(i);
  return IntPack::load(all);
}

/// The top 23 bits as a float in [0, 1): exponent trick, no conversion instruction (AVX2 has none for unsigned).
inline Pack<float> to_unit_float(const IntPack& a) {
  const IntPack one = (a >> 9) | IntPack(std::uint32_t{0x3f800000u});
#ifdef TILLER_PACK_XSIMD
  return Pack<float>(same_bits<xsimd::batch<float, xsimd::default_arch>>(one.v)) - 1.0f;
#else
  float f;
  std::memcpy(&f, &one.v, sizeof f);
  return Pack<float>(f) - 1.0f;
#endif
}

// ---- sine and cosine ----------------------------------------------------------------------------

namespace trig {

/// Constants for sincos by element type: pi/2 in three parts (Cody and Waite 1980) and the minimax polynomials of
/// sin(r)/r and cos(r) on |r| <= pi/4 (coefficients as tabulated in Moshier's Cephes library).
template <class T>
struct Table;
template <>
struct Table<float> {
  using Int = std::int32_t;
  static constexpr float kMagic = 12582912.0f;  // 1.5 * 2^23: adding it rounds to nearest and leaves the integer
                                                // in the low bits
  static constexpr float kPart1 = 1.5703125f, kPart2 = 4.837512969970703125e-4f, kPart3 = 7.549789948768648e-8f;
  static constexpr int kTerms = 3;
  static constexpr float kSin[3] = {-1.6666654611e-1f, 8.3321608736e-3f, -1.9515295891e-4f};
  static constexpr float kCos[3] = {4.166664568298827e-2f, -1.388731625493765e-3f, 2.443315711809948e-5f};
};
template <>
struct Table<double> {
  using Int = std::int64_t;
  static constexpr double kMagic = 6755399441055744.0;  // 1.5 * 2^52
  static constexpr double kPart1 = 1.57079625129699707031, kPart2 = 7.54978941586159635335e-8,
                          kPart3 = 5.39030285815811905290e-15;
  static constexpr int kTerms = 6;
  static constexpr double kSin[6] = {-1.66666666666666307295e-1, 8.33333333332211858878e-3,
                                     -1.98412698295895385996e-4, 2.75573136213857245213e-6,
                                     -2.50507477628578072866e-8, 1.58962301576546568060e-10};
  static constexpr double kCos[6] = {4.16666666666665929218e-2, -1.38888888888730564116e-3,
                                     2.48015872888517045348e-5, -2.75573141792967388112e-7,
                                     2.08757008419747316778e-9, -1.13585365213876817300e-11};
};

template <class T>
Pack<T> polynomial(const T (&c)[Table<T>::kTerms], const Pack<T>& z) {
  Pack<T> sum = c[Table<T>::kTerms - 1];
#pragma GCC unroll 8
  for (int i = Table<T>::kTerms - 2; i >= 0; --i) sum = fma_pack<T>(sum, z, Pack<T>(c[i]));
  return sum;
}

}  // namespace trig

/// sin and cos of the same lanes. Error <= 2 ulp for |x| <= 8192 (float) or 1e9 (double); beyond about 6e6 (1e15)
/// the argument has no meaningful phase and the result may be anything. NaN and infinities give NaN.
/// Cost in AVX-512 f32: about 20 instructions for both.
template <class T>
TILLER_INLINE void sincos(const Pack<T>& x, Pack<T>& sine, Pack<T>& cosine) {
  using C = trig::Table<T>;
  const Pack<T> shifted = fma_pack<T>(x, Pack<T>(0.63661977236758134308), Pack<T>(C::kMagic));
  const Pack<T> turns = shifted - Pack<T>(C::kMagic);
  Pack<T> r = fma_pack<T>(turns, Pack<T>(-C::kPart1), x);
  r = fma_pack<T>(turns, Pack<T>(-C::kPart2), r);
  r = fma_pack<T>(turns, Pack<T>(-C::kPart3), r);
  const Pack<T> z = r * r;
  const Pack<T> s = fma_pack<T>(trig::polynomial<T>(C::kSin, z) * z, r, r);
  const Pack<T> c = fma_pack<T>(trig::polynomial<T>(C::kCos, z) * z, z, fma_pack<T>(z, Pack<T>(-0.5), Pack<T>(1.0)));
  // quadrant q = low bits: odd swaps; bit 1 of q flips the sine, bit 1 of q + 1 the cosine
#ifdef TILLER_PACK_XSIMD
  using Ints = xsimd::batch<typename C::Int, xsimd::default_arch>;
  using Floats = xsimd::batch<T, xsimd::default_arch>;
  constexpr int kSignShift = static_cast<int>(sizeof(T)) * 8 - 2;
  const Ints q = same_bits<Ints>(shifted.v);
  const Ints two(static_cast<typename C::Int>(2)), one(static_cast<typename C::Int>(1));
  // bit 0 moved to the second-highest place reads as 2.0 or 0.0: a float mask without an integer compare
  const auto swap = same_bits<Floats>((q & one) << kSignShift) != Floats(T(0));
  const Floats sine_sign = same_bits<Floats>((q & two) << kSignShift);
  const Floats cosine_sign = same_bits<Floats>(((q + one) & two) << kSignShift);
  sine = Pack<T>(xsimd::select(swap, c.v, s.v) ^ sine_sign);
  cosine = Pack<T>(xsimd::select(swap, s.v, c.v) ^ cosine_sign);
#else
  typename C::Int q;
  std::memcpy(&q, &shifted.v.v, sizeof q);
  const T a = (q & 1) ? c.v.v : s.v.v, b = (q & 1) ? s.v.v : c.v.v;
  sine = Pack<T>((q & 2) ? -a : a);
  cosine = Pack<T>(((q + 1) & 2) ? -b : b);
#endif
}
template <class T>
Pack<T> sin(const Pack<T>& x) {
  Pack<T> s, c;
  sincos(x, s, c);
  return s;
}
template <class T>
Pack<T> cos(const Pack<T>& x) {
  Pack<T> s, c;
  sincos(x, s, c);
  return c;
}

/// Nearest integer, ties to even, for |x| below 2^22 (float) or 2^51 (double).
template <class T>
Pack<T> nearest(const Pack<T>& x) {
  return (x + Pack<T>(trig::Table<T>::kMagic)) - Pack<T>(trig::Table<T>::kMagic);
}

TILLER_ISA_NAMESPACE_END
