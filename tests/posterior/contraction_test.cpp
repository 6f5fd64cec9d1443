// What the data have told, direction by direction.

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "linear_rig.hpp"
#include "posterior/contraction.hpp"

namespace {

using tiller::Contraction;

TEST(Contraction, JacobiFindsEigenvectors) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> n;
  for (std::uint32_t d : {1u, 2u, 5u, 16u}) {
    std::vector<double> root(d * d), a(d * d), rotated, v(d * d);
    for (double& x : root) x = n(random);
    for (std::uint32_t r = 0; r < d; ++r)
      for (std::uint32_t c = 0; c < d; ++c)
        for (std::uint32_t k = 0; k < d; ++k) a[r * d + c] += root[r * d + k] * root[c * d + k];
    rotated = a;
    tiller::jacobi_eigen(d, rotated.data(), v.data());
    double trace = 0.0, worst = 0.0;
    for (std::uint32_t i = 0; i < d; ++i) trace += a[i * d + i];
    for (std::uint32_t j = 0; j < d; ++j)
      for (std::uint32_t r = 0; r < d; ++r) {
        double av = 0.0;
        for (std::uint32_t k = 0; k < d; ++k) av += a[r * d + k] * v[k * d + j];
        worst = std::fmax(worst, std::fabs(av - rotated[j * d + j] * v[r * d + j]));
      }
    EXPECT_LT(worst, 1e-12 * trace) << d;  // rounding of d^3 operations
  }
}

/// A known answer: prior unit, posterior narrow along (1, 1) and wide along (1, -1).
TEST(Contraction, KnowsTheWideDirection) {
  const double prior[] = {4.0, 0.0, 0.0, 9.0};
  const double narrow = 0.01, wide = 0.9;
  // in units of the prior's deviations: wide (1, -1) / sqrt 2, narrow (1, 1) / sqrt 2
  const double same = 0.5 * (wide + narrow), other = 0.5 * (narrow - wide);
  const double posterior[] = {4.0 * same, 6.0 * other, 6.0 * other, 9.0 * same};
  Contraction c;
  ASSERT_TRUE(tiller::contract(2, posterior, prior, c));
  EXPECT_NEAR(c.variance_ratio[0], wide, 1e-12);
  EXPECT_NEAR(c.variance_ratio[1], narrow, 1e-12);
  EXPECT_NEAR(c.direction[0] * c.direction[1], -0.5, 1e-12);
  EXPECT_NEAR(c.direction[2] * c.direction[3], 0.5, 1e-12);
}

TEST(Contraction, RefusesWhatIsNoCovariance) {
  Contraction c;
  const double good[] = {1.0, 0.0, 0.0, 1.0}, flat[] = {1.0, 1.0, 1.0, 1.0}, not_finite[] = {NAN, 0.0, 0.0, 1.0};
  EXPECT_FALSE(tiller::contract(2, good, flat, c));
  EXPECT_FALSE(tiller::contract(2, not_finite, good, c));
}

/// A mass that coasts without a push tells its damping and nothing of the input's gain; pushed, it tells both.
TEST(Contraction, FindsWhatWasNotExcited) {
  auto config = rig::config();
  config.priors[1] = rig::uniform(0.1, 2.0);
  config.initial_state[1] = 1.0;
  for (const double force : {0.0, 1.0}) {
    const auto log = rig::simulate(config, 0.9, 1.0, 200, 21, 0.2, force);
    rig::Instance p(config);
    rig::run(*p, log);
    Contraction c;
    ASSERT_TRUE(tiller::contract(config, *p, c));
    ASSERT_EQ(c.d, 2u);
    std::printf("force %g: ratios %.3g %.3g, first direction (%.2f, %.2f)\n", force, c.variance_ratio[0],
                c.variance_ratio[1], c.direction[0], c.direction[1]);
    if (force == 0.0) {
      // nothing is learnt of the gain: 256 particles tell a variance to 9 %, three times that is room
      EXPECT_NEAR(c.variance_ratio[0], 1.0, 0.3);
      EXPECT_GT(std::fabs(c.direction[0]), 0.95);
      EXPECT_LT(c.variance_ratio[1], 0.3);
    } else {
      EXPECT_LT(c.variance_ratio[0], 0.1);
    }
  }
}

/// Gain and damping under a constant push at standstill: only their ratio, the final speed, is told.
TEST(Contraction, FindsTheCombinationThatIsNotIdentified) {
  auto config = rig::config();
  config.priors[0] = rig::log_normal(1.0, 0.3);
  config.priors[1] = rig::log_normal(2.0, 0.3);
  config.initial_state[1] = 0.5;  // the speed at which a push of one and the damping balance
  config.initial_state_sd[1] = 0.001;
  config.process_sd[1] = 0.005;
  rig::Instance p(config);
  std::mt19937_64 random(31);
  std::normal_distribution<double> n;
  double position = 0.0;
  ASSERT_EQ(p->start(&position), tiller_status_ok);
  for (int k = 0; k < 200; ++k) {
    position += config.period_s * 0.5;
    tiller::Transition t;
    t.period_s = config.period_s;
    t.input[0] = 1.0;
    t.measured[0] = position + config.measurement_sd[0] * n(random);
    ASSERT_TRUE(rig::works(p->update(t)));
  }
  Contraction c;
  ASSERT_TRUE(tiller::contract(config, *p, c));
  std::printf("ratios %.3g %.3g, first direction (%.2f, %.2f)\n", c.variance_ratio[0], c.variance_ratio[1],
              c.direction[0], c.direction[1]);
  EXPECT_GT(c.variance_ratio[0], 0.5);
  EXPECT_LT(c.variance_ratio[1], 0.1);
  // both logarithms up together leaves the ratio alone: (1, 1) / sqrt 2
  EXPECT_NEAR(c.direction[0] * c.direction[1], 0.5, 0.05);
}

}  // namespace
