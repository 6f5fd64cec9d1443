// The posterior against exact answers on a linear system: a Kalman filter, and Kalman filters on a grid.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "linear_rig.hpp"
#include "tiller/config.hpp"

namespace {

using rig::GridMarginal;
using rig::Instance;

/// With every parameter fixed each particle is the textbook filter. Tolerance: 200 steps of rounding, no more.
TEST(Exact, OneParticleIsTheKalmanFilter) {
  auto c = rig::config();
  c.priors[0] = rig::fixed(0.9);
  c.posterior.particles = 16;
  const auto log = rig::simulate(c, 0.9, 0.3, 200, 3);
  Instance p(c);
  ASSERT_TRUE(p.fits());
  rig::Kalman kalman(c, log.first);
  ASSERT_EQ(p->start(&log.first), tiller_status_ok);
  double worst = 0.0;
  for (const auto& t : log.transitions) {
    ASSERT_EQ(p->update(t), tiller_status_ok);
    kalman.step(c, 0.9, 0.3, t);
    double mean[2], sd[2];
    p->moments(nullptr, nullptr, mean, sd);
    for (int i = 0; i < 2; ++i) {
      worst = std::fmax(worst, std::fabs(mean[i] - kalman.x[i]));
      worst = std::fmax(worst, std::fabs(sd[i] - p->noise_scale() * std::sqrt(kalman.p[i][i])));
    }
  }
  std::printf("largest difference from the Kalman filter: %.2g\n", worst);
  EXPECT_LT(worst, 1e-12);
}

/// The noise scale is the mean of its inverse gamma posterior, from the test's own innovations.
TEST(Exact, NoiseScaleIsItsPosteriorMean) {
  auto c = rig::config();
  c.priors[0] = rig::fixed(0.9);
  c.posterior.particles = 16;
  const auto log = rig::simulate(c, 0.9, 0.3, 400, 4, 2.5);
  Instance p(c);
  rig::run(*p, log);
  rig::Kalman kalman(c, log.first);
  for (const auto& t : log.transitions) kalman.step(c, 0.9, 0.3, t);
  double sse = 0.0;
  for (double v : kalman.squares) sse += v;
  const double a0 = c.posterior.noise_scale_shape;
  const double expected = std::sqrt((a0 + 0.5 * sse) / (a0 + 0.5 * 400 - 1.0));
  EXPECT_NEAR(p->noise_scale(), expected, 1e-9);
  // the truth is 2.5; 400 innovations tell a deviation to 1/sqrt(800) = 3.5 %, and the prior pulls by 1 %
  EXPECT_NEAR(p->noise_scale(), 2.5, 2.5 * 0.15);
}

struct Gap {
  double mean = 0.0, sd_ratio = 0.0, low = 0.0, high = 0.0;
};

Gap compare(const tiller::Posterior& p, std::uint32_t param, const GridMarginal& exact) {
  double mean[2], sd[2];
  p.moments(mean, sd, nullptr, nullptr);
  return {(mean[param] - exact.mean) / exact.sd, sd[param] / exact.sd,
          (p.quantile(param, 0.05) - exact.quantile(0.05)) / exact.sd,
          (p.quantile(param, 0.95) - exact.quantile(0.95)) / exact.sd};
}

/// Monte-Carlo bounds. N independent draws have a mean off by 1/sqrt(N) deviations, a deviation off by 1/sqrt(2N)
/// of itself and a 5 % quantile off by sqrt(.05 * .95 / N) / .103 deviations. Resampled and moved particles are not
/// independent: half of N is granted. A single run gets 4.5 such deviations, the mean over the runs 4.
struct Bounds {
  explicit Bounds(double particles) : n(0.5 * particles) {}
  double n;
  double mean() const { return 1.0 / std::sqrt(n); }
  double sd() const { return 1.0 / std::sqrt(2.0 * n); }
  double tail() const { return std::sqrt(0.05 * 0.95 / n) / 0.103; }
};

void expect_agreement(const tiller_config_t& base, int steps, int runs, bool both) {
  const Bounds bound(base.posterior.particles);
  for (std::uint32_t param = 0; param < (both ? 2u : 1u); ++param) {
    Gap sum;
    for (int run = 1; run <= runs; ++run) {
      auto c = base;
      c.seed = static_cast<std::uint64_t>(run);
      const double gain = 0.6 + 0.8 * run / runs, damping = both ? 0.7 - 0.5 * run / runs : 0.3;
      const auto log = rig::simulate(c, gain, damping, steps, static_cast<unsigned>(100 + run));
      const rig::GridPosterior exact(c, log, both ? 61 : 201);
      Instance p(c);
      rig::run(*p, log);
      ASSERT_EQ(p->exponent(), 1.0) << "run " << run;
      const Gap gap = compare(*p, param, param == 0 ? exact.gain : exact.damping);
      EXPECT_LT(std::fabs(gap.mean), 4.5 * bound.mean()) << "run " << run << " parameter " << param;
      EXPECT_LT(std::fabs(gap.sd_ratio - 1.0), 4.5 * bound.sd()) << "run " << run << " parameter " << param;
      sum.mean += gap.mean / runs;
      sum.sd_ratio += gap.sd_ratio / runs;
      sum.low += gap.low / runs;
      sum.high += gap.high / runs;
    }
    const double few = 4.0 / std::sqrt(static_cast<double>(runs));
    std::printf(
        "%d steps, window %u, parameter %u, %d runs: mean %+.3f sd, sd ratio %.3f, q05 %+.3f sd, q95 %+.3f sd\n", steps,
        base.posterior.window, param, runs, sum.mean, sum.sd_ratio, sum.low, sum.high);
    EXPECT_LT(std::fabs(sum.mean), few * bound.mean());
    EXPECT_LT(std::fabs(sum.sd_ratio - 1.0), few * bound.sd());
    EXPECT_LT(std::fabs(sum.low), few * bound.tail());
    EXPECT_LT(std::fabs(sum.high), few * bound.tail());
  }
}

tiller::Config large_cloud() {
  auto c = rig::config();
  c.posterior.particles = 1024;
  c.posterior.moves_per_tick = 128;
  return c;
}

TEST(Exact, AgreesWithTheGridInsideTheWindow) { expect_agreement(large_cloud(), 60, 20, false); }

/// Three windows: two thirds of the data stand in the summary, where innovations are linear in the gain.
TEST(Exact, AgreesWithTheGridBeyondTheWindow) { expect_agreement(large_cloud(), 192, 20, false); }

/// Gain and damping: now the filter's gain depends on the parameters and the summary is an approximation. It is
/// held to the same bounds.
TEST(Exact, AgreesWithTheGridBeyondTheWindowWhereTheSummaryIsNotExact) {
  auto c = large_cloud();
  c.priors[1] = rig::uniform(0.0, 1.0);
  expect_agreement(c, 192, 6, true);
}

/// Damping next to its bound, and correlated with the gain by a force that has one sign: a sampler whose proposals are
/// thrown back at the bound one coordinate at a time is 5 to 15 % too wide there.
TEST(Exact, AgreesWithTheGridAtABoundOfCorrelatedParameters) {
  auto c = large_cloud();
  c.priors[1] = rig::uniform(0.0, 1.0);
  c.posterior.window = 128;
  const int runs = 16;
  double mean = 0.0, ratio = 0.0, near_bound = 0.0;
  for (int run = 0; run < runs; ++run) {
    c.seed = static_cast<std::uint64_t>(run) + 1;
    auto log = rig::simulate(c, 1.0, 0.02, 120, static_cast<unsigned>(700 + run));
    const rig::GridPosterior exact(c, log, 61);
    Instance p(c);
    rig::run(*p, log);
    ASSERT_EQ(p->exponent(), 1.0);
    const Gap gap = compare(*p, 1, exact.damping);
    mean += gap.mean / runs;
    ratio += gap.sd_ratio / runs;
    // share below the exact median
    double below = 0.0, params[2], weight;
    for (std::uint32_t i = 0; i < p->size(); ++i) {
      p->particle(i, params, nullptr, &weight);
      below += params[1] < exact.damping.quantile(0.5) ? weight : 0.0;
    }
    near_bound += (below - 0.5) / runs;
  }
  std::printf("at the bound: mean %+.3f sd, sd ratio %.3f, share below the median %+.3f\n", mean, ratio, near_bound);
  const Bounds bound(c.posterior.particles);
  const double few = 4.0 / std::sqrt(static_cast<double>(runs));
  EXPECT_LT(std::fabs(mean), few * bound.mean());
  EXPECT_LT(std::fabs(ratio - 1.0), few * bound.sd());
  EXPECT_LT(std::fabs(near_bound), few * 0.5 * bound.mean());
}

/// A sensor fifty times finer: the prior is hundreds of posterior deviations wide. The data are taken in step by
/// step (tempered, exponent below one), and the result is the exact posterior all the same.
TEST(Exact, TemperingEndsAtTheExactPosterior) {
  auto c = large_cloud();
  c.measurement_sd[0] = 0.0002;
  c.process_sd[0] = 0.00005;
  c.process_sd[1] = 0.001;
  c.initial_state_sd[0] = c.initial_state_sd[1] = 0.001;
  const auto log = rig::simulate(c, 1.2, 0.3, 60, 5);
  Instance p(c);
  ASSERT_EQ(p->start(&log.first), tiller_status_ok);
  int tempered = 0;
  double smallest = 1.0;
  for (const auto& t : log.transitions) {
    const tiller_status_t status = p->update(t);
    ASSERT_TRUE(status == tiller_status_ok || status == tiller_status_tempered);
    ASSERT_EQ(status == tiller_status_tempered, p->exponent() < 1.0);
    // after a resampling the cloud is whole again; before one it keeps the configured share
    ASSERT_GE(p->effective_samples(), 0.5 * c.posterior.particles - 1e-6);
    tempered += status == tiller_status_tempered ? 1 : 0;
    smallest = std::fmin(smallest, p->exponent());
  }
  const rig::GridPosterior exact(c, log);
  const Gap gap = compare(*p, 0, exact.gain);
  std::printf(
      "prior sd %.3f -> %.5f; tempered in %d of 60 updates, exponent down to %.3f; mean %+.3f sd, sd ratio %.3f\n",
      1.0 / std::sqrt(12.0), exact.gain.sd, tempered, smallest, gap.mean, gap.sd_ratio);
  EXPECT_GT(tempered, 0);
  EXPECT_EQ(p->exponent(), 1.0);
  const Bounds bound(c.posterior.particles);
  EXPECT_LT(std::fabs(gap.mean), 4.5 * bound.mean());
  EXPECT_LT(std::fabs(gap.sd_ratio - 1.0), 4.5 * bound.sd());
}

/// Start, run, start again, run: the parameters' knowledge of the first stretch stays. Checked against the sum of
/// both stretches' exact evidences; the noise is believed (large shape), so that the two are independent. After a start
/// in mid-run a state may be as far from where it began as it has ever been.
TEST(Exact, KnowledgeSurvivesAGap) {
  auto c = large_cloud();
  c.posterior.noise_scale_shape = 1e6;
  const auto first = rig::simulate(c, 1.1, 0.3, 100, 21), second = rig::simulate(c, 1.1, 0.3, 40, 22);
  Instance p(c);
  rig::run(*p, first);
  rig::run(*p, second);

  auto again = c;
  double reach[2] = {};
  rig::Kalman truth(c, first.first);
  for (const auto& t : first.transitions) {
    truth.step(c, 1.1, 0.3, t);
    for (int r = 0; r < 2; ++r) reach[r] = std::fmax(reach[r], std::fabs(truth.x[r]));
  }
  for (int r = 0; r < 2; ++r) again.initial_state_sd[r] = std::hypot(c.initial_state_sd[r], reach[r]);

  GridMarginal exact;
  std::vector<double> logs;
  double top = -INFINITY;
  for (int i = 0; i < 2001; ++i) {
    const double gain = 0.5 + (i + 0.5) / 2001;
    rig::Kalman a(c, first.first), b(again, second.first);
    for (const auto& t : first.transitions) a.step(c, gain, 0.3, t);
    for (const auto& t : second.transitions) b.step(c, gain, 0.3, t);
    exact.value.push_back(gain);
    logs.push_back(a.log_evidence(1e6) + b.log_evidence(1e6));
    top = std::fmax(top, logs.back());
  }
  for (double l : logs) exact.weight.push_back(std::exp(l - top));
  exact.finish();
  const Gap gap = compare(*p, 0, exact);
  std::printf("after a gap: mean %+.3f sd, sd ratio %.3f\n", gap.mean, gap.sd_ratio);
  const Bounds bound(c.posterior.particles);
  EXPECT_LT(std::fabs(gap.mean), 4.5 * bound.mean());
  EXPECT_LT(std::fabs(gap.sd_ratio - 1.0), 4.5 * bound.sd());
}

/// 60 % of the measurements missing: the same exact posterior of what is left.
TEST(Exact, MissingMeasurementsAreSkipped) {
  const auto c = large_cloud();
  auto log = rig::simulate(c, 0.7, 0.3, 150, 31);
  std::mt19937_64 random(7);
  int missing = 0;
  for (auto& t : log.transitions)
    if (random() % 10 < 6) t.measured[0] = NAN, ++missing;
  Instance p(c);
  rig::run(*p, log);
  const rig::GridPosterior exact(c, log);
  const Gap gap = compare(*p, 0, exact.gain);
  std::printf("%d of 150 missing: mean %+.3f sd, sd ratio %.3f\n", missing, gap.mean, gap.sd_ratio);
  EXPECT_GT(missing, 70);
  const Bounds bound(c.posterior.particles);
  EXPECT_LT(std::fabs(gap.mean), 4.5 * bound.mean());
  EXPECT_LT(std::fabs(gap.sd_ratio - 1.0), 4.5 * bound.sd());
}

}  // namespace
