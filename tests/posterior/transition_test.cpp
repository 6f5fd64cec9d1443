// The transition engine against exact posteriors of a linear system, where they can be had on a grid.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "transition_rig.hpp"

namespace {

using rig::Instance;
using rig::TransitionLog;

void run(tiller::Posterior& p, const TransitionLog& log) {
  ASSERT_EQ(p.start(log.first), tiller_status_ok);
  for (const auto& t : log.transitions) ASSERT_TRUE(rig::works(p.update(t)));
}

/// log of the integral over v = log s^2 of prod N(e_k; 0, s^2) InvGamma(s^2; a0, b), by the trapezoidal rule.
double integrate_noise(double a0, double b, double n, double squares) {
  const auto integrand = [&](double v) { return -(a0 + 0.5 * n) * v - (b + 0.5 * squares) * std::exp(-v); };
  const double mode = std::log((b + 0.5 * squares) / (a0 + 0.5 * n)), width = 1.0 / std::sqrt(a0 + 0.5 * n);
  double sum = 0.0;
  for (int i = -80; i <= 80; ++i) sum += std::exp(integrand(mode + 0.15 * i * width) - integrand(mode));
  return integrand(mode) + std::log(sum * width);
}

/// Moments of gain and damping under uniform priors, numerically, over a grid that closes in.
struct Grid {
  double mean[2] = {}, sd[2] = {}, correlation = 0.0;

  Grid(const tiller_config_t& c, const TransitionLog& log) {
    double low[2] = {c.priors[0].low, c.priors[1].low}, high[2] = {c.priors[0].high, c.priors[1].high};
    for (int pass = 0; pass < 5; ++pass) {
      lay(c, log, low, high, pass < 4 ? 61 : 121);
      for (int j = 0; j < 2; ++j) {
        const double reach = std::fmax(7.0 * sd[j], (high[j] - low[j]) / 20.0);
        low[j] = std::fmax(c.priors[j].low, mean[j] - reach);
        high[j] = std::fmin(c.priors[j].high, mean[j] + reach);
      }
    }
  }

 private:
  void lay(const tiller_config_t& c, const TransitionLog& log, const double* low, const double* high, int points) {
    // velocity residuals are a - gain b + damping v: their squares need six sums only
    double sums[3][3] = {}, squares = 0.0;
    double velocity = log.first[1], position = log.first[0];
    for (const auto& t : log.transitions) {
      const double row[3] = {t.measured[1] - velocity, -t.period_s * t.input[0], t.period_s * velocity};
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) sums[i][j] += row[i] * row[j];
      squares += std::pow(t.measured[0] - position - t.period_s * velocity, 2);
      position = t.measured[0];
      velocity = t.measured[1];
    }
    const double n = static_cast<double>(log.transitions.size()), a0 = c.posterior.noise_scale_shape;
    const double b = a0 * c.process_sd[1] * c.process_sd[1] * c.period_s;
    double top = -INFINITY, total = 0.0, m[2] = {}, s[2][2] = {};
    std::vector<double> logs;
    for (int i = 0; i < points * points; ++i) {
      const double theta[3] = {1.0, low[0] + (high[0] - low[0]) * (i % points + 0.5) / points,
                               low[1] + (high[1] - low[1]) * (i / points + 0.5) / points};
      double e = 0.0;
      for (int r = 0; r < 3; ++r)
        for (int k = 0; k < 3; ++k) e += theta[r] * sums[r][k] * theta[k];
      logs.push_back(integrate_noise(a0, b, n, e));
      top = std::fmax(top, logs.back());
    }
    for (int i = 0; i < points * points; ++i) {
      const double at[2] = {low[0] + (high[0] - low[0]) * (i % points + 0.5) / points,
                            low[1] + (high[1] - low[1]) * (i / points + 0.5) / points};
      const double w = std::exp(logs[static_cast<std::size_t>(i)] - top);
      total += w;
      for (int r = 0; r < 2; ++r) {
        m[r] += w * at[r];
        for (int k = 0; k < 2; ++k) s[r][k] += w * at[r] * at[k];
      }
    }
    for (int r = 0; r < 2; ++r) mean[r] = m[r] / total;
    for (int r = 0; r < 2; ++r) sd[r] = std::sqrt(s[r][r] / total - mean[r] * mean[r]);
    correlation = (s[0][1] / total - mean[0] * mean[1]) / (sd[0] * sd[1]);
  }
};

struct Moments {
  double mean[2], sd[2], correlation;
  explicit Moments(const tiller::Posterior& p) {
    p.moments(mean, sd, nullptr, nullptr);
    double c[4];
    p.covariance(c);
    correlation = c[1] / std::sqrt(c[0] * c[3]);
  }
};

/// Over several seeds, so that N particles' own noise (1 / sqrt(N) of a deviation a run) averages out: what is left
/// is bias. 16 runs of 1,024 particles: .008 for the mean, .0055 for the deviation, if particles were independent;
/// five of these are allowed.
void expect_exact(tiller_config_t c, int steps, const char* what) {
  const int runs = 16;
  double bias[2] = {}, ratio[2] = {}, correlation = 0.0;
  for (int seed = 0; seed < runs; ++seed) {
    c.seed = 300u + static_cast<unsigned>(seed);
    const auto log = rig::simulate_transitions(c, 0.9, 0.3, steps, 40u + static_cast<unsigned>(seed));
    Instance p(c, nullptr, rig::transition_table());
    run(*p, log);
    EXPECT_EQ(p->exponent(), 1.0);
    const Grid exact(c, log);
    const Moments got(*p);
    for (int j = 0; j < 2; ++j) {
      bias[j] += (got.mean[j] - exact.mean[j]) / exact.sd[j] / runs;
      ratio[j] += got.sd[j] / exact.sd[j] / runs;
    }
    correlation += (got.correlation - exact.correlation) / runs;
  }
  std::printf("%s: means off by %.4f, %.4f deviations, deviations %.4f, %.4f of the exact, correlation %.4f off\n",
              what, bias[0], bias[1], ratio[0], ratio[1], correlation);
  for (int j = 0; j < 2; ++j) {
    EXPECT_NEAR(bias[j], 0.0, 0.04);
    EXPECT_NEAR(ratio[j], 1.0, 0.03);
  }
  EXPECT_NEAR(correlation, 0.0, 0.03);
}

TEST(Transition, ExactWhileTheRingHoldsAll) {
  auto c = rig::transition_config();
  c.posterior.window = 128;
  c.posterior.discrepancy = 0;
  expect_exact(c, 100, "all in the ring");
}

/// The model is affine in its parameters, so the summary is exact: hardly any of 800 transitions are in the ring.
TEST(Transition, ExactFromTheSummaryOfAnAffineModel) {
  auto c = rig::transition_config();
  c.posterior.window = 16;
  c.posterior.discrepancy = 0;
  expect_exact(c, 800, "all in the summary");
}

}  // namespace
