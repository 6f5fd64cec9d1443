// The transition engine against exact posteriors of a linear system, where they can be had on a grid.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "core/rng.hpp"
#include "posterior/transition/evidence.hpp"
#include "tiller/config.hpp"
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
void expect_exact(tiller::Config c, int steps, const char* what, double damping = 0.3) {
  const int runs = 16;
  double bias[2] = {}, ratio[2] = {}, correlation = 0.0;
  for (int seed = 0; seed < runs; ++seed) {
    c.seed = 300u + static_cast<unsigned>(seed);
    const auto log = rig::simulate_transitions(c, 0.9, damping, steps, 40u + static_cast<unsigned>(seed));
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
  c.posterior.disturbance = 0;
  expect_exact(c, 100, "all in the ring");
}

/// The model is affine in its parameters, so the summary is exact: hardly any of 800 transitions are in the ring.
TEST(Transition, ExactFromTheSummaryOfAnAffineModel) {
  auto c = rig::transition_config();
  c.posterior.window = 16;
  c.posterior.disturbance = 0;
  expect_exact(c, 800, "all in the summary");
}

/// Damping next to its bound, and correlated with the gain. Proposals that are thrown back at the bound one coordinate
/// at a time are not symmetric: they make it 5 to 15 % too wide.
TEST(Transition, ExactAtABoundOfCorrelatedParameters) {
  auto c = rig::transition_config();
  c.posterior.window = 128;
  c.posterior.disturbance = 0;
  expect_exact(c, 100, "at a bound", 0.02);
}

/// Estimated noise against what was put in, three times what was configured for one state and a fifth for the other:
/// 800 values tell a deviation to 1 / sqrt(1600) = 2.5 %; four of these.
TEST(Transition, NoiseOfEachState) {
  auto c = rig::transition_config();
  auto truth = c;
  truth.process_sd[0] *= 3.0;
  truth.process_sd[1] *= 0.2;
  const auto log = rig::simulate_transitions(truth, 0.9, 0.3, 800, 3);
  Instance p(c, nullptr, rig::transition_table());
  run(*p, log);
  tiller::PosteriorReport report;
  p->report(report);
  for (int r = 0; r < 2; ++r) EXPECT_NEAR(report.noise_sd[r] / truth.process_sd[r], 1.0, 0.1);
}

/// log density of e (n) where e ~ N(0, s^2 (R + B K B')) and s^2 ~ InvGamma(a0, b), with the whole n x n matrix. R is
/// that of an autoregression of the first order whose innovations have variance one; anew from `restart` on.
double log_multivariate_t(const std::vector<double>& e, const std::vector<float>& basis, double spread, double a0,
                          double b, double rho = 0.0, std::size_t restart = 0) {
  const std::size_t n = e.size();
  std::vector<double> factor(n * n), white(e);
  double log_determinant = 0.0, square = 0.0;
  for (std::size_t r = 0; r < n; ++r) {
    for (std::size_t c = 0; c <= r; ++c) {
      double v = r == c ? 1.0 / (1.0 - rho * rho) : std::pow(rho, static_cast<double>(r - c)) / (1.0 - rho * rho);
      if (r >= restart && c < restart) v = 0.0;
      for (std::size_t i = 0; i < 3; ++i)
        v += spread * spread * static_cast<double>(basis[3 * r + i]) * static_cast<double>(basis[3 * c + i]);
      for (std::size_t k = 0; k < c; ++k) v -= factor[r * n + k] * factor[c * n + k];
      factor[r * n + c] = r == c ? std::sqrt(v) : v / factor[c * n + c];
    }
    for (std::size_t k = 0; k < r; ++k) white[r] -= factor[r * n + k] * white[k];
    white[r] /= factor[r * n + r];
    square += white[r] * white[r];
    log_determinant += 2.0 * std::log(factor[r * n + r]);
  }
  const double shape = a0 + 0.5 * static_cast<double>(n);
  return std::lgamma(shape) - std::lgamma(a0) + a0 * std::log(b) - 0.5 * static_cast<double>(n) * std::log(2 * M_PI) -
         0.5 * log_determinant - shape * std::log(b + 0.5 * square);
}

/// The discrepancy integrated out and the colours summed over, by the sums of a particle, is a mixture of multivariate
/// t over all residuals; of two runs, each stationary from its start.
TEST(Transition, EvidenceWithDiscrepancyIsAMixtureOfMultivariateT) {
  auto c = rig::transition_config();
  c.posterior.disturbance = 1;
  tiller::Evidence evidence(c);
  std::vector<double> matrices(evidence.matrix_count());
  evidence.use(matrices.data());
  ASSERT_EQ(evidence.joints(), 1u);
  ASSERT_EQ(evidence.place_of(0), 1u);
  const std::uint32_t rows = evidence.rows(), lanes = 16, plain = 2 + evidence.columns();
  constexpr std::size_t kRestart = 20;
  std::vector<double> sums(rows * lanes), before(lanes), after(lanes);
  std::vector<double> e[2];
  std::vector<float> basis[2];
  tiller::Rng rng(1, 99, 0);
  const double none = evidence.log_constant();
  evidence.log_likelihood(lanes, sums.data(), lanes, before.data());
  double wander = 0.0;
  std::vector<float> last(6);
  for (std::size_t k = 0; k < 40; ++k) {
    const float weight[2] = {1.0f, 1.0f}, linked = k > 0 && k != kRestart ? 1.0f : 0.0f, links[2] = {linked, linked};
    // of the velocity; then of the position, which nothing pushes here
    const std::vector<float> b{1.0f, static_cast<float>(rng.normal()), rng.normal() < 0 ? -1.0f : 1.0f, 0, 0, 0};
    wander = 0.9 * wander + 0.02 * rng.normal();
    e[0].push_back(0.002 * rng.normal());
    e[1].push_back(wander + 0.05 * static_cast<double>(b[2]));
    std::vector<double> one(rows);
    for (std::uint32_t place = 0; place < 2; ++place) {
      const std::uint32_t r = evidence.pushed(place);
      const float *now = &b[3 * place], *then = &last[3 * place];
      basis[r].insert(basis[r].end(), now, now + 3);
      const double x = e[r].back(), y = linked > 0.0f ? e[r][k - 1] : 0.0;
      one[r] = x * x;
      one[plain + place] = 2.0 * x * y;
      one[plain + evidence.lagged_rows() + place] = linked > 0.0f ? y * y : -x * x;
      for (std::uint32_t i = 0; i < 3; ++i) {
        const double p = static_cast<double>(now[i]), q = linked > 0.0f ? static_cast<double>(then[i]) : 0.0;
        const std::uint32_t at = 3 * place + i;
        one[2 + at] = p * x;
        one[plain + 2 + at] = p * y + q * x;
        one[plain + evidence.lagged_rows() + 2 + at] = linked > 0.0f ? q * y : -p * x;
      }
    }
    for (std::uint32_t i = 0; i < rows; ++i)
      for (std::uint32_t l = 0; l < lanes; ++l) sums[i * lanes + l] += one[i];
    evidence.count({weight, b.data(), links, last.data()});
    last = b;
  }
  evidence.prepare();
  evidence.log_likelihood(lanes, sums.data(), lanes, after.data());
  const double a0 = c.posterior.noise_scale_shape;
  double expected = 0.0;
  for (std::uint32_t r = 0; r < 2; ++r) {
    double sum = 0.0, first = 0.0;
    for (std::uint32_t g = 0; g < tiller::kColours; ++g) {
      const double one = log_multivariate_t(e[r], basis[r], 10.0, a0, a0 * evidence.configured_variance(r),
                                            tiller::kColour[g], kRestart);
      if (g == 0) first = one;
      sum += tiller::kColourPrior[g] * std::exp(one - first);
    }
    expected += first + std::log(sum);
  }
  for (std::uint32_t l = 0; l < lanes; ++l)
    EXPECT_NEAR(after[l] - before[l] + evidence.log_constant() - none, expected, 1e-6);
}

/// With nothing to infer, the predictive densities of a run multiply to the evidence of all its residuals.
TEST(Transition, PredictiveDensitiesMultiplyToTheEvidence) {
  auto c = rig::transition_config();
  c.priors[0] = rig::fixed(0.9);
  c.priors[1] = rig::fixed(0.3);
  c.posterior.disturbance = 0;
  const auto log = rig::simulate_transitions(c, 0.9, 0.3, 60, 4);
  Instance p(c, nullptr, rig::transition_table());
  ASSERT_EQ(p->start(log.first), tiller_status_ok);
  double sum = 0.0, state[2] = {log.first[0], log.first[1]};
  std::vector<double> e[2];
  for (const auto& t : log.transitions) {
    ASSERT_EQ(p->update(t), tiller_status_ok);
    sum += p->log_predictive();
    e[0].push_back(t.measured[0] - state[0] - t.period_s * state[1]);
    e[1].push_back(t.measured[1] - state[1] - t.period_s * (0.9 * t.input[0] - 0.3 * state[1]));
    state[0] = t.measured[0];
    state[1] = t.measured[1];
  }
  double expected = 0.0;
  for (int r = 0; r < 2; ++r)
    expected += log_multivariate_t(e[r], std::vector<float>(180), 1.0, c.posterior.noise_scale_shape,
                                   c.posterior.noise_scale_shape * c.process_sd[r] * c.process_sd[r] * c.period_s);
  EXPECT_NEAR(sum, expected, 1e-3) << "residuals are in single precision";
}

/// With nothing to infer, each predictive density is the Student t of what forgetting has left so far.
TEST(Transition, PredictiveDensitiesAreThoseOfWhatForgettingLeaves) {
  auto c = rig::transition_config();
  c.priors[0] = rig::fixed(0.9);
  c.priors[1] = rig::fixed(0.3);
  c.posterior.disturbance = 0;
  c.posterior.forgetting_count = 1;
  c.posterior.forgetting[0] = 0.9;
  const auto log = rig::simulate_transitions(c, 0.9, 0.3, 60, 4);
  Instance p(c, nullptr, rig::transition_table());
  ASSERT_EQ(p->start(log.first), tiller_status_ok);
  const double a0 = c.posterior.noise_scale_shape;
  double known = 0.0, squares[2] = {}, state[2] = {log.first[0], log.first[1]};
  for (const auto& t : log.transitions) {
    const double e[2] = {t.measured[0] - state[0] - t.period_s * state[1],
                         t.measured[1] - state[1] - t.period_s * (0.9 * t.input[0] - 0.3 * state[1])};
    known *= 0.9;
    double expected = 0.0;
    for (int r = 0; r < 2; ++r) {
      squares[r] *= 0.9;
      const double shape = a0 + 0.5 * known;
      const double scale = a0 * c.process_sd[r] * c.process_sd[r] * t.period_s + 0.5 * squares[r];
      expected += std::lgamma(shape + 0.5) - std::lgamma(shape) - 0.5 * std::log(2.0 * M_PI * scale) -
                  (shape + 0.5) * std::log1p(0.5 * e[r] * e[r] / scale);
      squares[r] += e[r] * e[r];
      state[r] = t.measured[r];
    }
    known += 1.0;
    ASSERT_EQ(p->update(t), tiller_status_ok);
    ASSERT_NEAR(p->log_predictive(), expected, 1e-4) << "residuals are in single precision";
  }
}

struct Coverage {
  int covered90[2] = {}, covered50[2] = {}, runs = 0;
};

/// Truths drawn from the prior; how often the central 90 % and 50 % intervals hold them.
Coverage cover(tiller::Config c, int runs, int steps, double coulomb) {
  Coverage result;
  result.runs = runs;
  for (int k = 0; k < runs; ++k) {
    tiller::Rng rng(77, 99, static_cast<std::uint64_t>(k));
    c.seed = 5000u + static_cast<unsigned>(k);
    const double truth[2] = {0.5 + rng.uniform(), rng.uniform()};
    const auto log =
        rig::simulate_transitions(c, truth[0], truth[1], steps, 9000u + static_cast<unsigned>(k), 1.0, coulomb);
    Instance p(c, nullptr, rig::transition_table());
    EXPECT_EQ(p->start(log.first), tiller_status_ok);
    for (const auto& t : log.transitions) EXPECT_TRUE(rig::works(p->update(t)));
    for (std::uint32_t j = 0; j < 2; ++j) {
      result.covered90[j] += p->quantile(j, 0.05) < truth[j] && truth[j] < p->quantile(j, 0.95) ? 1 : 0;
      result.covered50[j] += p->quantile(j, 0.25) < truth[j] && truth[j] < p->quantile(j, 0.75) ? 1 : 0;
    }
  }
  return result;
}

/// Of 300 runs 270 +- 5.2 and 150 +- 8.7 are expected; four counts within 2.8 deviations each fail a right engine once
/// in fifty choices of seeds.
TEST(Transition, IntervalsCoverAsTheySay) {
  auto c = rig::transition_config();
  c.posterior.particles = 256;
  c.posterior.window = 32;
  c.posterior.moves_per_tick = 64;
  for (std::uint32_t discrepancy = 0; discrepancy < 2; ++discrepancy) {
    c.posterior.disturbance = discrepancy;
    const Coverage got = cover(c, 300, 150, 0.0);
    std::printf("discrepancy %u: 90 %% intervals cover %d, %d of 300, 50 %% intervals %d, %d\n", discrepancy,
                got.covered90[0], got.covered90[1], got.covered50[0], got.covered50[1]);
    for (int j = 0; j < 2; ++j) {
      EXPECT_NEAR(got.covered90[j], 270, 14.6);
      EXPECT_NEAR(got.covered50[j], 150, 24.3);
    }
  }
}

/// Coulomb friction that the model lacks: without the discrepancy the damping's intervals hold the truth hardly ever;
/// with it about 77 +- 4.2 times of 100 (gain) and 83 +- 3.8 (damping), short of 90 because the mass is stopped within
/// a step time and again; not three deviations less. Regressors that know nothing of stopping cover the gain 29 times.
TEST(Transition, HiddenFrictionIsTakenUpByTheDiscrepancy) {
  auto c = rig::transition_config();
  c.process_sd[1] = 0.02;
  c.posterior.particles = 256;
  c.posterior.window = 32;
  c.posterior.moves_per_tick = 64;
  int covered[2][2] = {};
  for (std::uint32_t discrepancy = 0; discrepancy < 2; ++discrepancy) {
    c.posterior.disturbance = discrepancy;
    const Coverage got = cover(c, 100, 300, 0.2);
    for (int j = 0; j < 2; ++j) covered[discrepancy][j] = got.covered90[j];
    std::printf("hidden friction, discrepancy %u: 90 %% intervals cover %d (gain), %d (damping) of 100\n", discrepancy,
                got.covered90[0], got.covered90[1]);
  }
  EXPECT_LE(covered[0][1], 10);
  EXPECT_GE(covered[1][0], 65);
  EXPECT_GE(covered[1][1], 73);
}

}  // namespace
