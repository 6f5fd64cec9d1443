// Bad input, bad models, bad priors: a status, and a posterior that stays as it was or stays sensible.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <vector>

#include "linear_rig.hpp"
#include "posterior/prior.hpp"

namespace {

using rig::Instance;
using tiller::Transition;

std::vector<unsigned char> bytes(const Instance& p) {
  const auto* first = static_cast<const unsigned char*>(p.memory());
  return {first, first + p.size()};
}

struct Cloud {
  std::vector<double> params, weight;
  explicit Cloud(const tiller::Posterior& p) {
    for (std::uint32_t i = 0; i < p.size(); ++i) {
      double both[2], w;
      p.particle(i, both, nullptr, &w);
      params.push_back(both[0]);
      weight.push_back(w);
    }
  }
  bool operator==(const Cloud& other) const { return params == other.params && weight == other.weight; }
};

TEST(Robustness, RefusedInputChangesNotOneByte) {
  const auto c = rig::config();
  const auto log = rig::simulate(c, 0.9, 0.3, 50, 1);
  Instance p(c);
  const auto fresh = bytes(p);
  const double infinite = INFINITY;
  EXPECT_EQ(p->update(log.transitions[0]), tiller_status_wrong_state);
  EXPECT_EQ(p->start(&infinite), tiller_status_sensor_not_finite);
  EXPECT_EQ(bytes(p), fresh);
  rig::run(*p, log);
  const auto before = bytes(p);
  auto refused = [&](auto change) {
    Transition t = log.transitions.back();
    change(t);
    const tiller_status_t status = p->update(t);
    EXPECT_EQ(bytes(p), before);
    return status;
  };
  EXPECT_EQ(refused([](Transition& t) { t.period_s = 0.0; }), tiller_status_time_backwards);
  EXPECT_EQ(refused([](Transition& t) { t.period_s = -0.05; }), tiller_status_time_backwards);
  EXPECT_EQ(refused([](Transition& t) { t.period_s = NAN; }), tiller_status_bad_period);
  EXPECT_EQ(refused([](Transition& t) { t.period_s = INFINITY; }), tiller_status_bad_period);
  EXPECT_EQ(refused([](Transition& t) { t.period_s = 0.51; }), tiller_status_bad_period);
  EXPECT_EQ(refused([](Transition& t) { t.input[0] = NAN; }), tiller_status_command_not_finite);
  EXPECT_EQ(refused([](Transition& t) { t.input[0] = -INFINITY; }), tiller_status_command_not_finite);
  EXPECT_EQ(refused([](Transition& t) { t.measured[0] = INFINITY; }), tiller_status_sensor_not_finite);
  EXPECT_EQ(p->start(&infinite), tiller_status_sensor_not_finite);
  EXPECT_EQ(bytes(p), before);
  EXPECT_EQ(p->update(log.transitions.back()), tiller_status_ok);
}

/// The linear system, except that it blows up where `fails` says so.
bool (*fails)(double gain, double input) = nullptr;
void fragile(const tiller_model_t& m, const tiller::LineariseJob& job) {
  rig::linearise(m, job);
  for (std::uint32_t l = 0; l < job.lanes; ++l)
    if (fails(job.params.data[l], job.control.data[0])) job.next_state[l] = NAN;
}
const tiller::RolloutTable& fragile_table() {
  static const tiller::RolloutTable t = [] {
    tiller::RolloutTable made;
    made.linearise = &fragile;
    return made;
  }();
  return t;
}

TEST(Robustness, WhenEveryParticleBlowsUpThePosteriorIsKept) {
  fails = [](double, double input) { return input > 1e6; };
  const auto c = rig::config();
  const auto log = rig::simulate(c, 0.9, 0.3, 80, 2);
  Instance p(c, nullptr, fragile_table());
  rig::run(*p, log);
  const Cloud before(*p);
  const double scale = p->noise_scale();
  Transition t = log.transitions.back();
  t.input[0] = 1e7;
  EXPECT_EQ(p->update(t), tiller_status_posterior_degenerate);
  EXPECT_TRUE(Cloud(*p) == before);
  EXPECT_EQ(p->noise_scale(), scale);
  // and it goes on from there
  ASSERT_EQ(p->start(&log.first), tiller_status_ok);
  for (const auto& next : log.transitions) EXPECT_TRUE(rig::works(p->update(next)));
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  EXPECT_TRUE(std::isfinite(mean[0]) && sd[0] > 0.0);
}

TEST(Robustness, ParticlesThatBlowUpDieAlone) {
  fails = [](double gain, double) { return gain > 1.0; };
  const auto c = rig::config();
  const auto log = rig::simulate(c, 0.95, 0.3, 20, 3);
  Instance p(c, nullptr, fragile_table());
  ASSERT_EQ(p->start(&log.first), tiller_status_ok);
  for (const auto& t : log.transitions) {
    ASSERT_TRUE(rig::works(p->update(t)));
    for (double gain : Cloud(*p).params) ASSERT_LE(gain, 1.0);
  }
  double mean[2], sd[2], state[2];
  p->moments(mean, sd, state, nullptr);
  EXPECT_TRUE(std::isfinite(mean[0]) && sd[0] > 0.0 && std::isfinite(state[0]) && std::isfinite(state[1]));
}

/// A glitch of a hundred deviations is treated exactly as a missing value: the same bits.
TEST(Robustness, AnOutlierIsAMissingValue) {
  const auto c = rig::config();
  auto glitch = rig::simulate(c, 0.9, 0.3, 120, 4), hole = glitch;
  glitch.transitions[70].measured[0] += 1.0;
  hole.transitions[70].measured[0] = NAN;
  Instance a(c), b(c);
  rig::run(*a, glitch);
  rig::run(*b, hole);
  EXPECT_EQ(a->gated(), 1u);
  EXPECT_EQ(b->gated(), 0u);
  EXPECT_TRUE(Cloud(*a) == Cloud(*b));
}

/// A sensor that was set to a new zero is believed after five values: the state follows.
TEST(Robustness, APersistentChangeIsBelieved) {
  const auto c = rig::config();
  auto log = rig::simulate(c, 0.9, 0.3, 200, 5);
  for (std::size_t k = 100; k < 200; ++k) log.transitions[k].measured[0] += 1.0;
  Instance p(c);
  rig::run(*p, log);
  double mean[2];
  p->moments(nullptr, nullptr, mean, nullptr);
  EXPECT_GE(p->gated(), 5u);
  EXPECT_NEAR(mean[0], log.transitions.back().measured[0], 0.05);
}

/// The truth lies outside of the prior: the cloud gathers at the bound, and stays inside.
TEST(Robustness, PriorThatExcludesTheTruth) {
  const auto c = rig::config();
  const auto log = rig::simulate(c, 3.0, 0.3, 300, 6);
  Instance p(c);
  ASSERT_EQ(p->start(&log.first), tiller_status_ok);
  for (const auto& t : log.transitions) ASSERT_TRUE(rig::works(p->update(t)));
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  std::printf("truth 3, prior up to 1.5: %.4f +- %.4f, noise scale %.2f\n", mean[0], sd[0], p->noise_scale());
  EXPECT_GT(mean[0], 1.45);
  for (double gain : Cloud(*p).params) EXPECT_LE(gain, 1.5);
  EXPECT_GT(p->noise_scale(), 1.5) << "what the parameters cannot explain must show up as noise";
}

/// Nothing moves, nothing is learnt: the posterior is the prior, uniform on [0.5, 1.5].
TEST(Robustness, ZeroExcitation) {
  const auto c = rig::config();
  const auto log = rig::simulate(c, 0.9, 0.3, 400, 7, 1.0, 0.0);
  Instance p(c);
  rig::run(*p, log);
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  std::printf("without excitation: %.3f +- %.3f, %.0f effective of %u, exponent %.2f\n", mean[0], sd[0],
              p->effective_samples(), p->size(), p->exponent());
  const double prior_sd = 1.0 / std::sqrt(12.0);
  // 256 particles, half granted: mean within 4.5 / sqrt(128) deviations
  EXPECT_NEAR(mean[0], 1.0, 4.5 / std::sqrt(128.0) * prior_sd);
  EXPECT_NEAR(sd[0], prior_sd, 4.5 / std::sqrt(256.0) * prior_sd);
  EXPECT_EQ(p->exponent(), 1.0);
}

TEST(Robustness, FrozenKeepsThePriorAndEstimatesTheState) {
  auto c = rig::config();
  c.posterior.enabled = 0;
  const auto log = rig::simulate(c, 1.0, 0.3, 300, 8);
  Instance p(c);
  const Cloud before(*p);
  rig::run(*p, log);
  EXPECT_TRUE(Cloud(*p) == before);
  EXPECT_EQ(p->exponent(), 0.0);
  EXPECT_EQ(p->effective_samples(), 256.0);
  double state[2], sd[2];
  p->moments(nullptr, nullptr, state, sd);
  EXPECT_NEAR(state[0], log.transitions.back().measured[0], 5.0 * c.measurement_sd[0] + 5.0 * sd[0]);
}

TEST(Robustness, NoMovesNoInferredParameterNoMeasurement) {
  const auto base = rig::config();
  const auto log = rig::simulate(base, 0.9, 0.3, 100, 9);
  auto no_moves = base, all_fixed = base, blind = base;
  no_moves.posterior.moves_per_tick = 0;
  all_fixed.priors[0] = rig::fixed(0.9);
  for (const auto* c : {&no_moves, &all_fixed, &blind}) {
    auto data = log;
    if (c == &blind)
      for (auto& t : data.transitions) t.measured[0] = NAN;
    Instance p(*c);
    rig::run(*p, data);
    double mean[2], sd[2], state[2], state_sd[2];
    p->moments(mean, sd, state, state_sd);
    EXPECT_TRUE(std::isfinite(mean[0]) && std::isfinite(state[0]) && state_sd[0] > 0.0);
    EXPECT_EQ(p->exponent(), 1.0);
    EXPECT_EQ(mean[1], 0.3);
    EXPECT_EQ(sd[1], 0.0);
  }
}

/// A prior's quantile function inverts its distribution: drawn at 2,000 even steps, moments are those of the cut
/// normal (closed form for the symmetric cut), bounds hold, and the log-normal stays positive.
TEST(Prior, Quantiles) {
  const tiller_prior_t cut = {tiller_prior_normal, 0, 2.0, 0.5, 1.5, 2.5};  // +- one deviation
  double sum = 0.0, square = 0.0;
  const int n = 2000;
  for (int i = 0; i < n; ++i) {
    const double x = tiller::prior_quantile(cut, (i + 0.5) / n);
    ASSERT_GE(x, 1.5);
    ASSERT_LE(x, 2.5);
    sum += x / n;
    square += (x - 2.0) * (x - 2.0) / n;
  }
  EXPECT_NEAR(sum, 2.0, 1e-9);
  EXPECT_NEAR(std::sqrt(square), 0.5 * 0.53956, 1e-4);  // sqrt(1 - 2 phi(1) / (2 Phi(1) - 1))
  const tiller_prior_t positive = rig::log_normal(0.2, 0.7);
  EXPECT_NEAR(std::exp(tiller::prior_quantile(positive, 0.5)), 0.2, 1e-9);
  EXPECT_NEAR(tiller::prior_quantile(positive, 0.975), std::log(0.2) + 0.7 * 1.959964, 1e-5);
  // far in the tail: between 9 and 10 deviations above the mean
  const tiller_prior_t tail = {tiller_prior_normal, 0, 0.0, 1.0, 9.0, 10.0};
  EXPECT_NEAR(tiller::prior_quantile(tail, 0.5), 9.0 + std::log(2.0) / 9.1, 2e-3);
  EXPECT_EQ(tiller::log_prior(tail, 8.99), -INFINITY);
}

/// Log-normal and cut normal priors through the whole run: bounds hold, and the exact answer differs from the
/// uniform prior's as it must (pulled towards the median).
TEST(Prior, BoundsHoldThroughMoves) {
  auto c = rig::config();
  c.priors[0] = rig::log_normal(1.0, 0.5);
  c.priors[0].low = 0.85;
  const auto log = rig::simulate(c, 0.8, 0.3, 200, 10);
  Instance p(c);
  rig::run(*p, log);
  for (double gain : Cloud(*p).params) ASSERT_GE(gain, 0.85 * (1.0 - 1e-12));
}

}  // namespace
