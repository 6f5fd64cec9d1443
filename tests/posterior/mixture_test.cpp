// The joint prior: density and draws against what stands here in plain loops, and the posterior under it against the
// same posterior under the marginals that it can stand for.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "linear_rig.hpp"
#include "posterior/prior.hpp"
#include "tiller/config.hpp"

namespace {

using rig::Instance;

/// A mixture with the arrays that it points to.
struct Joint {
  std::vector<double> weight, mean, root;
  tiller_mixture_t mixture{};

  Joint(std::uint32_t d, std::vector<double> w, std::vector<double> m, std::vector<double> r)
      : weight(std::move(w)), mean(std::move(m)), root(std::move(r)) {
    mixture = {
        sizeof mixture, TILLER_CONFIG_VERSION, static_cast<std::uint32_t>(weight.size()), d, weight.data(), mean.data(),
        root.data()};
  }
  Joint(const Joint&) = delete;
  Joint& operator=(const Joint&) = delete;
};

/// Three components over (gain, log damping).
struct Three : Joint {
  Three()
      : Joint(2, {0.2, 0.5, 0.3}, {0.8, -1.5, 1.0, -1.2, 1.3, -0.9},
              {0.05, 0.0, 0.1, 0.2, 0.1, 0.0, -0.3, 0.05, 0.02, 0.0, 0.0, 0.3}) {}
};

tiller::Config config_with(const Joint& joint) {
  auto c = rig::config();
  c.priors[0] = rig::uniform(-10.0, 10.0);
  c.priors[1] = rig::log_normal(0.3, 5.0);
  c.prior_mixture = &joint.mixture;
  return c;
}

/// N(v; m, L L') for d = 2 by the determinant and the adjugate.
double normal_density(const double* v, const double* m, const double* l) {
  const double a = l[0] * l[0], b = l[0] * l[2], c = l[2] * l[2] + l[3] * l[3];
  const double det = a * c - b * b, x = v[0] - m[0], y = v[1] - m[1];
  return std::exp(-0.5 * (c * x * x - 2.0 * b * x * y + a * y * y) / det) / (2.0 * M_PI * std::sqrt(det));
}

double density(const Joint& j, const double* v) {
  double sum = 0.0;
  for (std::size_t c = 0; c < j.weight.size(); ++c)
    sum += j.weight[c] * normal_density(v, &j.mean[2 * c], &j.root[4 * c]);
  return sum;
}

/// Up to one constant. Tolerance: rounding of a few dozen operations.
TEST(Mixture, DensityIsTheSumOfNormals) {
  const Three joint;
  const auto c = config_with(joint);
  const tiller::PriorDistribution law(c);
  const double origin[2] = {1.0, -1.2};
  const double constant = law.log_density(origin) - std::log(density(joint, origin));
  for (double x = 0.6; x < 1.5; x += 0.07) {
    for (double y = -2.2; y < 0.0; y += 0.13) {
      const double v[2] = {x, y};
      ASSERT_NEAR(law.log_density(v) - constant, std::log(density(joint, v)), 1e-10) << x << " " << y;
    }
  }
  // far away the nearest component alone counts, without underflow
  const double far[2] = {9.0, 40.0};
  EXPECT_TRUE(std::isfinite(law.log_density(far)));
  EXPECT_LT(law.log_density(far), -1e4);
}

TEST(Mixture, NothingOutsideOfTheBounds) {
  const Three joint;
  auto c = config_with(joint);
  c.priors[0] = rig::uniform(0.75, 1.3);
  c.priors[1].low = 0.2;
  const tiller::PriorDistribution law(c);
  const double inside[2] = {1.0, std::log(0.21)}, below[2] = {1.0, std::log(0.19)}, above[2] = {1.31, -1.0};
  EXPECT_TRUE(std::isfinite(law.log_density(inside)));
  EXPECT_EQ(law.log_density(below), -INFINITY);
  EXPECT_EQ(law.log_density(above), -INFINITY);
  const double nan[2] = {NAN, -1.0};
  EXPECT_EQ(law.log_density(nan), -INFINITY);
}

TEST(Mixture, CovarianceIsWithinAndBetween) {
  const Three joint;
  const auto c = config_with(joint);
  const tiller::PriorDistribution law(c);
  double expected[4] = {}, mean[2] = {}, got[4];
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t j = 0; j < 2; ++j) mean[j] += joint.weight[k] * joint.mean[2 * k + j];
  for (std::size_t k = 0; k < 3; ++k) {
    const double *l = &joint.root[4 * k], *m = &joint.mean[2 * k], w = joint.weight[k];
    expected[0] += w * (l[0] * l[0] + (m[0] - mean[0]) * (m[0] - mean[0]));
    expected[1] += w * (l[0] * l[2] + (m[0] - mean[0]) * (m[1] - mean[1]));
    expected[3] += w * (l[2] * l[2] + l[3] * l[3] + (m[1] - mean[1]) * (m[1] - mean[1]));
  }
  expected[2] = expected[1];
  law.covariance(got);
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(got[i], expected[i], 1e-14);
  EXPECT_NEAR(law.spread(0), std::sqrt(expected[0]), 1e-14);
  EXPECT_NEAR(law.spread(1), std::sqrt(expected[3]), 1e-14);

  auto marginals = c;
  marginals.prior_mixture = nullptr;
  tiller::PriorDistribution(marginals).covariance(got);
  EXPECT_DOUBLE_EQ(got[0], 400.0 / 12.0);
  EXPECT_EQ(got[1], 0.0);
  EXPECT_DOUBLE_EQ(got[3], 25.0);
}

/// Mean and covariance of `count` draws, the expectation of `of` under them.
struct Moments {
  double mean[2] = {}, square[4] = {};
  Moments(const double* v, std::uint32_t count) {
    for (std::uint32_t k = 0; k < count; ++k)
      for (std::uint32_t j = 0; j < 2; ++j) mean[j] += v[j * count + k] / count;
    for (std::uint32_t k = 0; k < count; ++k)
      for (std::uint32_t i = 0; i < 4; ++i)
        square[i] += (v[i / 2 * count + k] - mean[i / 2]) * (v[i % 2 * count + k] - mean[i % 2]) / count;
  }
};

/// The particles' draw is stratified: the means of 512 lie within a tenth of what independent draws would be off by
/// (a deviation over the root of 512), the covariances, whose strata are not products, within 5 %.
TEST(Mixture, DrawsHaveItsMoments) {
  const Three joint;
  const auto c = config_with(joint);
  const tiller::PriorDistribution law(c);
  double expected[4];
  law.covariance(expected);
  const double mean[2] = {0.2 * 0.8 + 0.5 * 1.0 + 0.3 * 1.3, -0.2 * 1.5 - 0.5 * 1.2 - 0.3 * 0.9};
  constexpr std::uint32_t kCount = 512;
  for (std::uint64_t seed = 100001; seed < 100011; ++seed) {
    std::vector<double> v(2 * kCount);
    std::vector<std::uint32_t> index(kCount);
    law.draw(seed, kCount, v.data(), index.data());
    const Moments m(v.data(), kCount);
    for (std::size_t j = 0; j < 2; ++j)
      EXPECT_LT(std::fabs(m.mean[j] - mean[j]), 0.1 * law.spread(static_cast<std::uint32_t>(j)) / std::sqrt(512.0));
    for (std::size_t i = 0; i < 4; ++i)
      EXPECT_NEAR(m.square[i], expected[i],
                  0.05 * law.spread(static_cast<std::uint32_t>(i / 2)) * law.spread(static_cast<std::uint32_t>(i % 2)));
    // no component keeps to itself: either half alone has the whole's mean, to 5 independent deviations
    double half = 0.0;
    for (std::uint32_t k = 0; k < kCount / 2; ++k) half += v[k] / (kCount / 2);
    EXPECT_LT(std::fabs(half - mean[0]), 5.0 * law.spread(0) / std::sqrt(256.0));
  }
}

/// Single draws under cuts follow density and bounds: the shares of 20,000 draws in the cells of a grid against the
/// density integrated there by the midpoint rule, by chi-square (99.9 % quantile of 35 degrees of freedom: 66.6).
TEST(Mixture, CutDrawsFollowTheDensity) {
  const Three joint;
  auto c = config_with(joint);
  c.priors[0] = rig::uniform(0.78, 1.32);
  c.priors[1].low = std::exp(-1.6);
  c.priors[1].high = std::exp(-0.7);
  const tiller::PriorDistribution law(c);
  constexpr int kSide = 6, kFine = 40, kDraws = 20000;
  std::vector<double> mass(kSide * kSide), seen(kSide * kSide);
  double sum = 0.0;
  for (int i = 0; i < kSide * kFine; ++i) {
    for (int j = 0; j < kSide * kFine; ++j) {
      const double v[2] = {0.78 + 0.54 * (i + 0.5) / (kSide * kFine), -1.6 + 0.9 * (j + 0.5) / (kSide * kFine)};
      const double here = density(joint, v);
      mass[static_cast<std::size_t>(i / kFine * kSide + j / kFine)] += here;
      sum += here;
    }
  }
  const auto cell = [](double x, double y) {
    const int i = static_cast<int>((x - 0.78) / 0.54 * kSide), j = static_cast<int>((y + 1.6) / 0.9 * kSide);
    return static_cast<std::size_t>(i * kSide + j);
  };
  const auto chi_square = [&](const char* what) {
    double chi = 0.0, pooled_mass = 0.0, pooled_seen = 0.0;
    for (std::size_t i = 0; i < mass.size(); ++i) {
      const double expected = mass[i] / sum * kDraws;
      if (expected < 10.0) {
        pooled_mass += expected;
        pooled_seen += seen[i];
      } else {
        chi += (seen[i] - expected) * (seen[i] - expected) / expected;
      }
    }
    if (pooled_mass > 0.0) chi += (pooled_seen - pooled_mass) * (pooled_seen - pooled_mass) / pooled_mass;
    EXPECT_LT(chi, 66.6) << what;
    std::fill(seen.begin(), seen.end(), 0.0);
  };
  tiller::Rng rng(100001, 77, 0);
  for (int k = 0; k < kDraws; ++k) {
    double v[2];
    law.draw_one(rng, v);
    ASSERT_TRUE(v[0] >= 0.78 && v[0] <= 1.32 && v[1] >= -1.6 && v[1] <= -0.7);
    ++seen[cell(v[0], v[1])];
  }
  chi_square("single draws");
  std::vector<double> v(2 * 200);
  std::vector<std::uint32_t> index(200);
  for (std::uint64_t seed = 0; seed < kDraws / 200; ++seed) {
    law.draw(100001 + seed, 200, v.data(), index.data());
    for (std::size_t k = 0; k < 200; ++k) {
      ASSERT_TRUE(v[k] >= 0.78 && v[k] <= 1.32 && v[200 + k] >= -1.6 && v[200 + k] <= -0.7);
      ++seen[cell(v[k], v[200 + k])];
    }
  }
  chi_square("stratified draws");
}

/// Hardly anything of the mixture lies within the bounds: the draws end all the same, within them.
TEST(Mixture, BoundsThatLeaveLittleAreKept) {
  const Joint joint(2, {1.0}, {0.0, 0.0}, {1.0, 0.0, 0.0, 1.0});
  auto c = config_with(joint);
  c.priors[0] = rig::uniform(-1e-6, 1e-6);
  c.priors[1] = rig::uniform(0.0, 1e-6);
  const tiller::PriorDistribution law(c);
  tiller::Rng rng(1, 77, 0);
  for (int k = 0; k < 1000; ++k) {
    double v[2];
    law.draw_one(rng, v);
    ASSERT_TRUE(std::fabs(v[0]) <= 1e-6 && v[1] >= 0.0 && v[1] <= 1e-6);
  }
}

/// One uncorrelated component is the product of normal marginals: the whole run is the same, to the last bit.
TEST(Mixture, OneComponentIsTheNormalPrior) {
  auto plain = rig::config();
  plain.priors[0] = rig::normal(0.9, 0.3);
  plain.priors[1] = rig::log_normal(0.35, 0.4);
  const Joint joint(2, {1.0}, {0.9, std::log(0.35)}, {0.3, 0.0, 0.0, 0.4});
  auto mixed = plain;
  mixed.prior_mixture = &joint.mixture;
  // other widths: they must not count beside the mixture
  mixed.priors[0].b = 0.1;
  mixed.priors[1].b = 0.1;
  for (unsigned seed = 100001; seed < 100004; ++seed) {
    const auto log = rig::simulate(plain, 1.0, 0.3, 200, seed);
    Instance a(plain), b(mixed);
    ASSERT_TRUE(a.fits() && b.fits());
    a->reset();
    b->reset();
    rig::run(*a, log);
    rig::run(*b, log);
    double mean_a[2], mean_b[2], sd_a[2], sd_b[2];
    a->moments(mean_a, sd_a, nullptr, nullptr);
    b->moments(mean_b, sd_b, nullptr, nullptr);
    for (int i = 0; i < 2; ++i) {
      EXPECT_EQ(mean_a[i], mean_b[i]);
      EXPECT_EQ(sd_a[i], sd_b[i]);
    }
    EXPECT_EQ(a->resamplings(), b->resamplings());
    EXPECT_LT(sd_a[0], 0.1);  // something was learnt
  }
}

/// Two components far apart, data that tell them apart weakly: the posterior's weight of the right one is what Bayes'
/// rule says, from evidence by Kalman filters on a grid.
TEST(Mixture, TwoComponentsAreWeighedByTheEvidence) {
  auto c = rig::config();
  c.priors[0] = rig::normal(1.0, 1.0);
  const Joint joint(1, {0.7, 0.3}, {0.85, 1.15}, {0.05, 0.05});
  c.prior_mixture = &joint.mixture;
  c.posterior.particles = 1024;
  c.posterior.moves_per_tick = 128;
  double worst = 0.0;
  for (unsigned seed = 100001; seed < 100009; ++seed) {
    const auto log = rig::simulate(c, 1.0, 0.3, 20, seed, 1.0, 0.15);
    double upper = 0.0, sum = 0.0, top = -INFINITY;
    for (int pass = 0; pass < 2; ++pass) {
      for (int i = 0; i < 400; ++i) {
        const double gain = 0.6 + 0.8 * (i + 0.5) / 400;
        rig::Kalman filter(c, log.first);
        for (const auto& t : log.transitions) filter.step(c, gain, 0.3, t);
        const double a = (gain - 0.85) / 0.05, b = (gain - 1.15) / 0.05;
        const double prior = 0.7 * std::exp(-0.5 * a * a) + 0.3 * std::exp(-0.5 * b * b);
        const double log_density = filter.log_evidence(c.posterior.noise_scale_shape) + std::log(prior);
        if (pass == 0) {
          top = std::fmax(top, log_density);
        } else {
          sum += std::exp(log_density - top);
          upper += gain > 1.0 ? std::exp(log_density - top) : 0.0;
        }
      }
    }
    Instance p(c);
    p->reset();
    rig::run(*p, log);
    double share = 0.0;
    for (std::uint32_t k = 0; k < p->size(); ++k) {
      double params[2], weight;
      p->particle(k, params, nullptr, &weight);
      share += params[0] > 1.0 ? weight : 0.0;
    }
    std::printf("seed %u: share of the upper component %.3f, exact %.3f\n", seed, share, upper / sum);
    worst = std::fmax(worst, std::fabs(share - upper / sum));
  }
  // 512 effective particles tell a share of a half to .022; 2.3 such deviations for the worst of eight
  EXPECT_LT(worst, 0.05);
}

}  // namespace
