#include <gtest/gtest.h>

#include <cmath>

#include "pack_checks.hpp"
#include "scalar/dual.hpp"
#include "scalar/isa.hpp"
#include "scalar/sparse_dual.hpp"

namespace tiller {
#define TILLER_DECLARE(isa) \
  namespace isa {           \
  PackReport check_pack();  \
  }
#ifdef TILLER_TEST_HAS_sse2
inline TILLER_DECLARE(sse2)
#endif
#ifdef TILLER_TEST_HAS_avx2
inline TILLER_DECLARE(avx2)
#endif
#ifdef TILLER_TEST_HAS_avx512
inline TILLER_DECLARE(avx512)
#endif
#ifdef TILLER_TEST_HAS_neon
inline TILLER_DECLARE(neon)
#endif
#if defined(TILLER_TEST_HAS_scalar) || defined(TILLER_TEST_SCALAR_COPY)
inline TILLER_DECLARE(scalar)
#endif

namespace {

void expect_good(const PackReport& r, int f32, int f64) {
  EXPECT_EQ(r.wrong, "");
  EXPECT_EQ(r.width_f32, f32);
  EXPECT_EQ(r.width_f64, f64);
  // two units in the last place of 1, for the reduction and the polynomial
  EXPECT_LE(r.sincos_f32, 2 * 1.2e-7);
  EXPECT_LE(r.sincos_f64, 2 * 2.3e-16);
  // the library's own bounds are 1 ulp or so; four leaves room for other versions of it
  for (double e : {r.exp_f32, r.log_f32, r.tanh_f32, r.atan2_f32}) EXPECT_LE(e, 4 * 1.2e-7);
  for (double e : {r.exp_f64, r.log_f64, r.tanh_f64, r.atan2_f64}) EXPECT_LE(e, 4 * 2.3e-16);
  std::printf("sincos error: f32 %.2g, f64 %.2g\n", r.sincos_f32, r.sincos_f64);
}

#ifdef TILLER_TEST_HAS_sse2
TEST(Pack, Sse2) { expect_good(sse2::check_pack(), 4, 2); }
#endif
#ifdef TILLER_TEST_HAS_avx2
TEST(Pack, Avx2) {
  if (!has_isa(Isa::avx2)) GTEST_SKIP() << "this processor has no AVX2: its copy cannot run here";
  expect_good(avx2::check_pack(), 8, 4);
}
#endif
#ifdef TILLER_TEST_HAS_avx512
TEST(Pack, Avx512) {
  if (!has_isa(Isa::avx512)) GTEST_SKIP() << "this processor has no AVX-512: its copy cannot run here";
  expect_good(avx512::check_pack(), 16, 8);
}
#endif
#ifdef TILLER_TEST_HAS_neon
TEST(Pack, Neon) { expect_good(neon::check_pack(), 4, 2); }
#endif
#if defined(TILLER_TEST_HAS_scalar) || defined(TILLER_TEST_SCALAR_COPY)
TEST(Pack, Scalar) { expect_good(scalar::check_pack(), 1, 1); }
#endif

// At its kinks a dual must give a finite derivative: one infinity would spoil a whole Jacobian.
TEST(Dual, KinksAreFinite) {
  using D = Dual<double, 1>;
  const D zero = D::seed(0.0, 0);
  EXPECT_EQ(sqrt(zero).v, 0.0);
  EXPECT_EQ(sqrt(zero).d[0], 0.0);
  EXPECT_EQ(abs(zero).d[0], 0.0);
  EXPECT_EQ(atan2(zero, D(0.0)).d[0], 0.0);
  EXPECT_EQ(abs(D::seed(-2.0, 0)).d[0], -1.0);
}

TEST(Dual, NestsForSecondDerivatives) {
  using Inner = Dual<double, 1>;
  using Outer = Dual<Inner, 1>;
  const double x = 0.8;
  const Outer v = Outer::seed(Inner::seed(x, 0), 0);
  const Outer f = v * v * sin(v);
  // (x^2 sin x)'' = 2 sin x + 4 x cos x - x^2 sin x
  EXPECT_NEAR(f.d[0].d[0], 2 * std::sin(x) + 4 * x * std::cos(x) - x * x * std::sin(x), 1e-14);
  EXPECT_EQ(value_of(f), x * x * std::sin(x));
}

// One direction with known zeros: the same derivatives as the dual that carries them all.
TEST(SparseDual, IsTheDualOfOneDirection) {
  const auto all = [](auto x, auto y, auto z) {
    decltype(x) s, c;
    sincos(x * y, s, c);
    auto sum = (s * z + c / (z + 3.0)) * x - y * z + exp(z * 0.1) * log(x + 5.0) + tanh(y) * sqrt(x * x + 1.0);
    sum += abs(z - x) * min(x, y) - max(z, y) + select(x > y, x, z) + atan2(z, x) + copysign(x, y) + floor(x) + -y;
    return sum + sin(z) * cos(y) + nearest(y) + 2.0 / (x + 4.0);
  };
  using D = Dual<double, 1>;
  using Sparse = SparseDual<double>;
  for (int i = 0; i < 300; ++i) {
    const double v[3] = {0.3 + 0.01 * i, 1.7 - 0.007 * i, 0.02 * i - 2.5};
    for (int reached = 0; reached < 8; ++reached) {  // which of the three depend on the direction
      D d[3];
      Sparse s[3];
      for (int k = 0; k < 3; ++k) {
        d[k] = (reached >> k) & 1 ? D::seed(v[k], 0) : D(v[k]);
        s[k] = (reached >> k) & 1 ? Sparse::seed(v[k]) : Sparse(v[k]);
      }
      const D want = all(d[0], d[1], d[2]);
      const Sparse got = all(s[0], s[1], s[2]);
      EXPECT_EQ(got.v, want.v);
      EXPECT_NEAR(got.slope(), want.d[0], 1e-14 * (1 + std::abs(want.d[0]))) << reached;
      EXPECT_EQ(got.constant, reached == 0);
    }
  }
}

TEST(Dual, ValueIsThatOfPlainArithmetic) {
  using D = Dual<double, 3>;
  for (int i = 1; i < 1000; ++i) {
    const double a = 0.37 * i, b = 1.0 / i + 0.3;
    EXPECT_EQ((D(a) / D(b)).v, a / b);
    EXPECT_EQ((D(a) * D(b) - D(b)).v, a * b - b);
  }
}

}  // namespace
}  // namespace tiller
