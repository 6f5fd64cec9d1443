// The reproducible build's own elementary functions against long double (64 bits of mantissa on x86; where long double
// is double, the reference's own rounding adds half an ulp, which the bounds leave room for).

#include "tiller/portable_math.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>

#include "core/rng.hpp"

namespace tiller {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

/// |value - truth| in units of the last place of truth
double ulps(double value, long double truth) {
  const double rounded = static_cast<double>(truth);
  if (value == rounded) return 0.0;
  const double place = std::nextafter(std::fabs(rounded), kInf) - std::fabs(rounded);
  return static_cast<double>(std::fabs((static_cast<long double>(value) - truth) / place));
}

/// Largest error over `count` arguments, uniform on [low, high]
template <class F, class G>
double worst(double low, double high, F f, G truth, int count = 50000) {
  Rng rng(7, 1, 0);
  double largest = 0.0;
  for (int i = 0; i < count; ++i) {
    const double x = low + (high - low) * rng.uniform();
    largest = std::fmax(largest, ulps(f(x), truth(static_cast<long double>(x))));
  }
  return largest;
}

#define EXPECT_WITHIN(limit, low, high, name)                                                               \
  do {                                                                                                      \
    const double error = worst(                                                                             \
        low, high, [](double x) { return portable::name(x); }, [](long double x) { return std::name(x); }); \
    std::printf("%-6s on [%g, %g]: %.2f ulp\n", #name, double(low), double(high), error);                   \
    EXPECT_LE(error, limit) << #name;                                                                       \
  } while (false)

TEST(PortableMath, ErrorsAreBelowThreeUlp) {
  EXPECT_WITHIN(3.0, -700.0, 700.0, exp);
  EXPECT_WITHIN(3.0, -1.0, 1.0, exp);
  EXPECT_WITHIN(3.0, -2.0, 2.0, expm1);
  EXPECT_WITHIN(3.0, 1e-300, 10.0, log);
  EXPECT_WITHIN(3.0, 0.5, 2.0, log);
  EXPECT_WITHIN(3.0, -0.78, 0.78, sin);
  EXPECT_WITHIN(3.0, -0.78, 0.78, cos);
  EXPECT_WITHIN(3.0, -3.0, 3.0, tanh);
  EXPECT_WITHIN(1e3, 0.0, 20.0, erfc);  // 1e-13, as it promises
}

TEST(PortableMath, SineAndCosineKeepTheirAbsoluteErrorFarOut) {
  Rng rng(7, 2, 0);
  long double largest = 0.0L;
  for (int i = 0; i < 50000; ++i) {
    const double x = 2e6 * (rng.uniform() - 0.5);
    double s, c;
    portable::sincos(x, s, c);
    largest = std::fmax(largest, std::fabs(static_cast<long double>(s) - std::sin(static_cast<long double>(x))));
    largest = std::fmax(largest, std::fabs(static_cast<long double>(c) - std::cos(static_cast<long double>(x))));
  }
  EXPECT_LE(largest, 2.5e-16L);
  for (const double x : {1e6, 1e9, 1e18, 1e300}) EXPECT_LE(std::fabs(portable::sin(x)), 1.0) << x;
}

TEST(PortableMath, FunctionsOfTwoArguments) {
  Rng rng(7, 3, 0);
  double angle = 0.0, length = 0.0, power = 0.0;
  for (int i = 0; i < 50000; ++i) {
    const double x = 4.0 * (rng.uniform() - 0.5), y = 4.0 * (rng.uniform() - 0.5);
    const long double lx = x, ly = y;
    angle = std::fmax(angle, ulps(portable::atan2(y, x), std::atan2(ly, lx)));
    length = std::fmax(length, ulps(portable::hypot(x, y), std::hypot(lx, ly)));
    power = std::fmax(power, ulps(portable::pow(std::fabs(x) + 1.0, y), std::pow(std::fabs(lx) + 1.0L, ly)));
  }
  EXPECT_LE(angle, 3.0);
  EXPECT_LE(length, 2.0);
  EXPECT_LE(power, 8.0);  // |y log x| <= 2 log 3 = 2.2 ulp from the product, and exp's own
}

TEST(PortableMath, EndsOfTheRange) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double x : {0.25, 3.0, kInf}) {
    EXPECT_EQ(portable::pow(x, 0.0), 1.0) << x;
    EXPECT_EQ(portable::pow(x, 1.0), x) << "as it stands, no rounding of a logarithm";
  }
  for (const double y : {-3.0, 0.5, 1e300}) EXPECT_EQ(portable::pow(1.0, y), 1.0) << y;
  EXPECT_EQ(portable::hypot(0.0, -0.0), 0.0);
  EXPECT_EQ(portable::hypot(-kInf, 1.0), kInf);
  EXPECT_EQ(portable::hypot(2.0, kInf), kInf);
  EXPECT_TRUE(std::isnan(portable::atan2(1.0, nan)));
  EXPECT_EQ(portable::exp(-kInf), 0.0);
  EXPECT_EQ(portable::exp(kInf), kInf);
  EXPECT_EQ(portable::exp(0.0), 1.0);
  EXPECT_EQ(portable::exp(-745.0), std::exp(-745.0));  // denormal
  EXPECT_EQ(portable::log(0.0), -kInf);
  EXPECT_EQ(portable::log(1.0), 0.0);
  EXPECT_EQ(portable::log(kInf), kInf);
  EXPECT_NEAR(portable::log(5e-324), std::log(5e-324), 1e-12);
  EXPECT_EQ(portable::tanh(kInf), 1.0);
  EXPECT_EQ(portable::tanh(-40.0), -1.0);
  EXPECT_EQ(portable::erfc(-kInf), 2.0);
  for (const double y : {0.0, -0.0, 1.0, -1.0, kInf, -kInf})
    for (const double x : {0.0, -0.0, 1.0, -1.0, kInf, -kInf}) {
      EXPECT_LE(ulps(portable::atan2(y, x), std::atan2(y, x)), 1.0) << y << ' ' << x;
      EXPECT_EQ(std::signbit(portable::atan2(y, x)), std::signbit(y)) << y << ' ' << x;
    }
  for (const double bad : {nan, kInf}) {
    EXPECT_TRUE(std::isnan(portable::sin(bad)));
    EXPECT_TRUE(std::isnan(portable::cos(bad)));
  }
  EXPECT_TRUE(std::isnan(portable::exp(nan)));
  EXPECT_TRUE(std::isnan(portable::expm1(nan)));
  EXPECT_TRUE(std::isnan(portable::log(nan)));
  EXPECT_TRUE(std::isnan(portable::log(-1.0)));
  EXPECT_TRUE(std::isnan(portable::tanh(nan)));
  EXPECT_TRUE(std::isnan(portable::atan2(nan, 1.0)));
  EXPECT_TRUE(std::isnan(portable::hypot(nan, 1.0)));
}

/// The bits themselves: a checksum over 1e5 results, the same on every target that runs this test.
TEST(PortableMath, BitsAreThoseOfEveryTarget) {
  std::uint64_t hash = 14695981039346656037ull;
  std::uint32_t state = 1u;
  const auto take = [&](double value) { hash = (hash ^ portable::detail::bits(value)) * 1099511628211ull; };
  for (int i = 0; i < 10000; ++i) {
    state = state * 1664525u + 1013904223u;
    const double x = (static_cast<double>(state) - 2147483648.0) * (40.0 / 2147483648.0), a = std::fabs(x) + 1e-9;
    double s, c;
    portable::sincos(x, s, c);
    for (const double value :
         {s, c, portable::exp(x), portable::expm1(0.1 * x), portable::log(a), portable::tanh(x),
          portable::atan2(x, 3.0), portable::pow(a, 0.7), portable::hypot(x, 2.0), portable::erfc(0.1 * x)})
      take(value);
  }
  EXPECT_EQ(hash, 0xb0c19d2615e712f9ull);
}

}  // namespace
}  // namespace tiller
