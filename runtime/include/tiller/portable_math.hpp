#pragma once

// Elementary functions made of +, -, *, / and sqrt alone, so that their bits are the same wherever these are IEEE 754
// doubles, rounded to nearest and not contracted (-ffp-contract=off): the reproducible build on x86-64, aarch64, armhf
// and Cortex-M7. The reductions are the usual ones (Cody and Waite 1980; Muller, Elementary Functions, 2016, ch. 11);
// the kernels are Taylor series, whose coefficients the compiler works out. Errors
// (tests/scalar/portable_math_test.cpp): at most 3 ulp, unless said otherwise. Cost: some 20 to 40 operations each.
//
// The float versions round the double's result: 1 ulp, and right almost everywhere.

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace tiller::portable {

namespace detail {

constexpr double kRound = 6755399441055744.0;  // 1.5 * 2^52: adding it rounds to nearest, the integer in the low bits
constexpr double kLn2High = 6.93147180369123816490e-01, kLn2Low = 1.90821492927058770002e-10;

inline std::uint64_t bits(double x) {
  std::uint64_t word;
  std::memcpy(&word, &x, sizeof word);
  return word;
}
inline double from_bits(std::uint64_t word) {
  double x;
  std::memcpy(&x, &word, sizeof x);
  return x;
}
/// 2^n, |n| <= 1022
inline double power_of_two(int n) { return from_bits(static_cast<std::uint64_t>(n + 1023) << 52); }

/// 1 / k!; every k! up to 22! is exact.
struct InverseFactorials {
  double of[23] = {};
  constexpr InverseFactorials() {
    double factorial = 1.0;
    for (int k = 0; k < 23; ++k) {
      if (k > 0) factorial *= k;
      of[k] = 1.0 / factorial;
    }
  }
};
constexpr InverseFactorials kInverse{};

/// (e^r - 1 - r) / r^2 = 1/2! + r/3! + ... up to r^(last - 2) / last!
inline double exp_tail(double r, int last) {
  double sum = kInverse.of[last];
  for (int k = last - 1; k >= 2; --k) sum = sum * r + kInverse.of[k];
  return sum;
}

/// sin and cos on |r| <= pi/4
inline double sine_kernel(double r) {
  const double z = -r * r;
  double sum = kInverse.of[19];
  for (int k = 17; k >= 3; k -= 2) sum = sum * z + kInverse.of[k];
  return r + r * (z * sum);
}
inline double cosine_kernel(double r) {
  const double z = -r * r;
  double sum = kInverse.of[18];
  for (int k = 16; k >= 4; k -= 2) sum = sum * z + kInverse.of[k];
  return 1.0 + (0.5 * z + z * (z * sum));
}

/// square/3 + square^2/5 + ... up to 1/last: what atanh z / z (square = z^2) and atan z / z (square = -z^2) are above 1
inline double odd_tail(double square, int last) {
  double sum = 1.0 / last;
  for (int k = last - 2; k >= 3; k -= 2) sum = sum * square + 1.0 / k;
  return sum * square;
}

/// atan on [0, 1]: shifted by pi/6 onto |z| <= tan(pi/12), then the series.
inline double atan_unit(double z) {
  const bool shift = z > 0.26794919243112270647;
  if (shift) z = (1.73205080756887729353 * z - 1.0) / (1.73205080756887729353 + z);
  const double angle = z + z * odd_tail(-z * z, 29);
  return shift ? 0.52359877559829887308 + angle : angle;
}

}  // namespace detail

inline double exp(double x) {
  if (!(x < 709.782712893384)) return x != x ? x : std::numeric_limits<double>::infinity();
  if (x < -745.2) return 0.0;
  const double n = (x * 1.44269504088896338700 + detail::kRound) - detail::kRound;
  const double high = x - n * detail::kLn2High, low = n * detail::kLn2Low, r = high - low;
  const double value = 1.0 + (high - (low - r * r * detail::exp_tail(r, 13)));
  // in two steps: 2^n alone may be out of range where the product is not
  const int whole = static_cast<int>(n), half = whole / 2;
  return value * detail::power_of_two(half) * detail::power_of_two(whole - half);
}

inline double expm1(double x) {
  if (std::fabs(x) < 0.5) return x + x * x * detail::exp_tail(x, 16);
  return exp(x) - 1.0;
}

/// log(m 2^n) with m within sqrt(2) of one: Muller, section 11.3, by s = (m - 1) / (m + 1).
inline double log(double x) {
  if (!(x > 0.0)) return x == 0.0 ? -std::numeric_limits<double>::infinity() : std::numeric_limits<double>::quiet_NaN();
  if (x > std::numeric_limits<double>::max()) return x;
  double n = 0.0;
  if (x < std::numeric_limits<double>::min()) {
    x *= 18014398509481984.0;  // 2^54
    n = -54.0;
  }
  const std::uint64_t word = detail::bits(x);
  n += static_cast<double>(static_cast<int>(word >> 52) - 1023);
  double m = detail::from_bits((word & 0x000fffffffffffffu) | 0x3ff0000000000000u);
  if (m > 1.41421356237309504880) {
    m *= 0.5;
    n += 1.0;
  }
  const double f = m - 1.0, s = f / (2.0 + f), half_square = 0.5 * f * f;
  const double sum = 2.0 * detail::odd_tail(s * s, 25);
  return n * detail::kLn2High - ((half_square - (s * (half_square + sum) + n * detail::kLn2Low)) - f);
}

/// Absolute error 1e-16 up to |x| = 1e6; beyond, the argument is first brought within a turn of the rounded 2 pi.
inline void sincos(double x, double& sine, double& cosine) {
  if (!(std::fabs(x) < 1e6)) {
    if (!(std::fabs(x) <= std::numeric_limits<double>::max())) {
      sine = cosine = std::numeric_limits<double>::quiet_NaN();
      return;
    }
    x = std::fmod(x, 6.283185307179586);
  }
  const double shifted = x * 0.63661977236758134308 + detail::kRound, n = shifted - detail::kRound;
  const double r =
      ((x - n * 1.57079632673412561417e+00) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21;
  const double s = detail::sine_kernel(r), c = detail::cosine_kernel(r);
  const unsigned quadrant = static_cast<unsigned>(detail::bits(shifted)) & 3u;
  const double a = (quadrant & 1u) ? c : s, b = (quadrant & 1u) ? s : c;
  sine = (quadrant & 2u) ? -a : a;
  cosine = ((quadrant + 1u) & 2u) ? -b : b;
}
inline double sin(double x) {
  double s, c;
  sincos(x, s, c);
  return s;
}
inline double cos(double x) {
  double s, c;
  sincos(x, s, c);
  return c;
}

inline double tanh(double x) {
  const double a = std::fabs(x);
  if (a > 22.0) return std::copysign(1.0, x);
  const double e = expm1(2.0 * a);
  return std::copysign(e / (e + 2.0), x);
}

inline double atan2(double y, double x) {
  if (x != x || y != y) return x + y;
  const double ay = std::fabs(y), ax = std::fabs(x);
  double angle;
  if (ax == ay)  // both may be infinite, or zero
    angle = ax == 0.0 ? 0.0 : 0.78539816339744830962;
  else
    angle = ay < ax ? detail::atan_unit(ay / ax) : 1.57079632679489661923 - detail::atan_unit(ax / ay);
  return std::copysign(std::signbit(x) ? 3.14159265358979323846 - angle : angle, y);
}

/// For x > 0. Relative error about |y log x| ulp.
inline double pow(double x, double y) {
  if (y == 0.0 || x == 1.0) return 1.0;
  if (y == 1.0) return x;
  return exp(y * log(x));
}

inline double hypot(double x, double y) {
  double large = std::fabs(x), small = std::fabs(y);
  if (large < small) {
    const double kept = large;
    large = small;
    small = kept;
  }
  if (large > std::numeric_limits<double>::max() || large == 0.0) return large;
  const double ratio = small / large;
  return large * std::sqrt(1.0 + ratio * ratio);
}

/// Relative error below 1e-13: series of erf below 1.5, Laplace's continued fraction above (Abramowitz and Stegun
/// 7.1.6, 7.1.14).
inline double erfc(double x) {
  if (x < 0.0) return 2.0 - erfc(-x);
  const double gauss = exp(-x * x);
  if (x < 1.5) {
    double sum = 0.0;
    for (double k = 40.0; k > 0.0; k -= 1.0) sum = (1.0 + sum) * (2.0 * x * x / (2.0 * k + 1.0));
    return 1.0 - 1.12837916709551257390 * x * gauss * (1.0 + sum);
  }
  double fraction = 0.0;
  for (double k = 80.0; k > 0.0; k -= 1.0) fraction = 0.5 * k / (x + fraction);
  return gauss * 0.56418958354775628695 / (x + fraction);
}

inline float sin(float x) { return static_cast<float>(sin(static_cast<double>(x))); }
inline float cos(float x) { return static_cast<float>(cos(static_cast<double>(x))); }
inline float exp(float x) { return static_cast<float>(exp(static_cast<double>(x))); }
inline float expm1(float x) { return static_cast<float>(expm1(static_cast<double>(x))); }
inline float log(float x) { return static_cast<float>(log(static_cast<double>(x))); }
inline float tanh(float x) { return static_cast<float>(tanh(static_cast<double>(x))); }
inline float atan2(float y, float x) {
  return static_cast<float>(atan2(static_cast<double>(y), static_cast<double>(x)));
}
inline float pow(float x, float y) { return static_cast<float>(pow(static_cast<double>(x), static_cast<double>(y))); }
inline float hypot(float x, float y) {
  return static_cast<float>(hypot(static_cast<double>(x), static_cast<double>(y)));
}

}  // namespace tiller::portable
