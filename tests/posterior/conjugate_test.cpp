// The engine in closed form on a linear system with both states measured: against batch least squares, its calibration,
// what it refuses, and the other engines.

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "transition_rig.hpp"

// The linker sends every call of these to us (see CMakeLists.txt), from whichever library it comes.
extern "C" {
void* __real_malloc(std::size_t);
}
namespace {
std::atomic<long> heap_calls{0};
}
extern "C" {
void* __wrap_malloc(std::size_t n) {
  ++heap_calls;
  return __real_malloc(n);
}
}
// operator new stands in the C++ library, which was linked without us: it gets a body that is seen.
void* operator new(std::size_t n) {
  void* p = std::malloc(n ? n : 1);
  if (!p) std::abort();
  return p;
}
// not inlined: GCC would pair their free with a new that it does not look into, and warn
__attribute__((noinline)) void operator delete(void* p) noexcept { std::free(p); }
__attribute__((noinline)) void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace {

using rig::Instance;

/// The rig with both states measured, and normal priors of gain and damping.
tiller::Config config() {
  tiller::Config c = rig::config();
  c.priors[0] = rig::normal(1.0, 0.3);
  c.priors[1] = rig::normal(0.4, 0.2);
  c.measurement_count = 2;
  c.measured_state[0] = 1;  // in an order of their own
  c.measured_state[1] = 0;
  c.measurement_sd[0] = c.measurement_sd[1] = 1e-6;
  c.process_sd[0] = 0.002;
  c.process_sd[1] = 0.05;
  c.posterior.kind = tiller_posterior_conjugate;
  c.posterior.delay_hypotheses = c.posterior.forgetting_count = 1;
  c.posterior.forgetting[0] = 1.0;
  return c;
}

struct Track {
  double first[2] = {};  // as measured: velocity, position
  std::vector<tiller::Transition> transitions;
};

/// The system of linear_rig.hpp with process noise alone; periods vary by a tenth.
/// `dry` is a friction that the model lacks.
Track simulate(const tiller_config_t& c, double gain, double damping, int steps, unsigned seed, double noise = 1.0,
               double dry = 0.0) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  double x[2] = {0.1, -0.2};
  Track run;
  run.first[0] = x[1];
  run.first[1] = x[0];
  double u = 0.0;
  for (int k = 0; k < steps; ++k) {
    if (k % 5 == 0) u = n(random);
    tiller::Transition t;
    const double dt = t.period_s = c.period_s * (1.0 + 0.1 * (k % 3 - 1));
    t.input[0] = u;
    const double position = x[0] + dt * x[1] + noise * std::sqrt(dt) * c.process_sd[0] * n(random);
    x[1] += dt * (gain * u - damping * x[1] - dry * std::tanh(x[1] / 0.01)) +
            noise * std::sqrt(dt) * c.process_sd[1] * n(random);
    x[0] = position;
    t.measured[0] = x[1];
    t.measured[1] = x[0];
    run.transitions.push_back(t);
  }
  return run;
}

void feed(tiller::Posterior& p, const Track& run) {
  ASSERT_EQ(p.start(run.first), tiller_status_ok);
  for (const auto& t : run.transitions) ASSERT_EQ(p.update(t), tiller_status_ok);
}

/// Bayes' rule for the velocity's rows, with the noise known to be `scale` times the configured one.
struct LeastSquares {
  long double mean[2], covariance[2][2];
  LeastSquares(const tiller_config_t& c, const Track& run, double scale) {
    long double a[2][2] = {}, b[2] = {};
    for (int j = 0; j < 2; ++j) {
      a[j][j] = 1.0L / (static_cast<long double>(c.priors[j].b) * c.priors[j].b);
      b[j] = a[j][j] * c.priors[j].a;
    }
    double velocity = run.first[0];
    for (const auto& t : run.transitions) {
      const long double dt = t.period_s, x[2] = {dt * t.input[0], -dt * velocity}, y = t.measured[0] - velocity;
      const long double variance = static_cast<long double>(scale) * scale * c.process_sd[1] * c.process_sd[1] * dt;
      for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j) a[i][j] += x[i] * x[j] / variance;
        b[i] += x[i] * y / variance;
      }
      velocity = t.measured[0];
    }
    const long double determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    covariance[0][0] = a[1][1] / determinant;
    covariance[1][1] = a[0][0] / determinant;
    covariance[0][1] = covariance[1][0] = -a[0][1] / determinant;
    for (int i = 0; i < 2; ++i) mean[i] = covariance[i][0] * b[0] + covariance[i][1] * b[1];
  }
};

// With a0 = 1e6 the noise is as good as known: s^2 = 1 to 1e-3 by its prior, and to 1e-3 of the mean's distance from
// the prior's it enters. So the noise that the engine itself found goes into the reference; what is left of its spread
// (1e-3) squared times the prior's share is below 1e-8 of a deviation.
TEST(Conjugate, IsBatchLeastSquares) {
  auto c = config();
  c.posterior.noise_scale_shape = 1e6;
  const Track run = simulate(c, 0.8, 0.3, 500, 3);
  Instance p(c);
  ASSERT_TRUE(p.fits());
  feed(*p, run);
  const LeastSquares want(c, run, p->noise_scale());
  double mean[2], sd[2], covariance[4];
  p->moments(mean, sd, nullptr, nullptr);
  p->covariance(covariance);
  for (int i = 0; i < 2; ++i) {
    const double deviation = std::sqrt(static_cast<double>(want.covariance[i][i]));
    EXPECT_NEAR((mean[i] - static_cast<double>(want.mean[i])) / deviation, 0.0, 1e-6);
    EXPECT_NEAR(sd[i] / deviation, 1.0, 1e-6);
    // a normal law by now: its quantiles
    EXPECT_NEAR(p->quantile(static_cast<std::uint32_t>(i), 0.95), mean[i] + 1.6448536269514722 * sd[i], 1e-5 * sd[i]);
    EXPECT_NEAR(p->quantile(static_cast<std::uint32_t>(i), 0.5), mean[i], 1e-5 * sd[i]);
  }
  EXPECT_NEAR(covariance[1] / static_cast<double>(want.covariance[0][1]), 1.0, 1e-6);
  EXPECT_EQ(covariance[1], covariance[2]);
}

// Wide priors, noise unknown: least squares of the velocity's rows and Student's t, whatever the scale, to 1e-9. The
// position's rows have no parameter in them but tell the noise.
TEST(Conjugate, IsStudentsLawUnderWidePriors) {
  for (const double noise : {0.1, 1.0, 7.0}) {
    auto c = config();
    c.priors[0] = rig::normal(1.0, 1e6);
    c.priors[1] = rig::normal(0.4, 1e6);
    c.posterior.noise_scale_shape = 2.0;
    const Track run = simulate(c, 0.8, 0.3, 200, 8, noise);
    Instance p(c);
    feed(*p, run);
    const LeastSquares unit(c, run, 1.0);
    long double squares = 0.0L;
    double before[2] = {run.first[0], run.first[1]};
    for (const auto& t : run.transitions) {
      const long double dt = t.period_s, root = std::sqrt(dt);
      const long double velocity =
          before[0] + dt * (unit.mean[0] * t.input[0] - unit.mean[1] * static_cast<long double>(before[0]));
      const long double position = before[1] + dt * before[0];
      const long double ev = (t.measured[0] - velocity) / (c.process_sd[1] * root);
      const long double ex = (t.measured[1] - position) / (c.process_sd[0] * root);
      squares += ev * ev + ex * ex;
      std::memcpy(before, t.measured, sizeof before);
    }
    const double variance = static_cast<double>((2.0L + 0.5L * squares) / (2.0L + 0.5L * (400 - 2) - 1.0L));
    double mean[2], sd[2];
    p->moments(mean, sd, nullptr, nullptr);
    EXPECT_NEAR(p->noise_scale() / std::sqrt(variance), 1.0, 1e-9);
    for (int i = 0; i < 2; ++i) {
      const double deviation = std::sqrt(variance * static_cast<double>(unit.covariance[i][i]));
      // 1e6 prior deviations cost ten digits in one place: doubles at 1e6 are 1e-10 fine
      EXPECT_NEAR(mean[i], static_cast<double>(unit.mean[i]), 1e-8);
      EXPECT_NEAR(sd[i] / deviation, 1.0, 1e-8);
    }
  }
}

// Truth and noise from their priors, 30 transitions, 2,000 runs: each central interval holds the truth as often as it
// says, within 4.5 binomial deviations.
TEST(Conjugate, IntervalsAreCalibrated) {
  auto c = config();
  c.posterior.noise_scale_shape = 3.0;
  c.posterior.particles = 16;
  const int runs = 2000;
  const double levels[] = {0.5, 0.9, 0.99};
  int inside[2][3] = {};
  std::mt19937_64 random(100001);
  std::normal_distribution<double> normal;
  std::gamma_distribution<double> gamma(3.0, 1.0 / 3.0);
  Instance p(c);
  for (int r = 0; r < runs; ++r) {
    const double truth[2] = {1.0 + 0.3 * normal(random), 0.4 + 0.2 * normal(random)};
    const double noise = std::sqrt(1.0 / gamma(random));
    p->reset();
    feed(*p, simulate(c, truth[0], truth[1], 30, static_cast<unsigned>(r + 100001), noise));
    for (std::uint32_t i = 0; i < 2; ++i)
      for (int l = 0; l < 3; ++l)
        inside[i][l] +=
            truth[i] >= p->quantile(i, 0.5 - 0.5 * levels[l]) && truth[i] <= p->quantile(i, 0.5 + 0.5 * levels[l]);
  }
  for (int i = 0; i < 2; ++i)
    for (int l = 0; l < 3; ++l) {
      std::printf("parameter %d, %.0f %% interval: %.2f %%\n", i, 100 * levels[l], 100.0 * inside[i][l] / runs);
      EXPECT_NEAR(double(inside[i][l]) / runs, levels[l], 4.5 * std::sqrt(levels[l] * (1 - levels[l]) / runs));
    }
}

// What has not been excited keeps the prior's own width, however small the noise turns out to be.
TEST(Conjugate, WhatTheDataDoNotTellKeepsItsPrior) {
  auto c = config();
  Track run = simulate(c, 0.8, 0.3, 400, 5);
  double velocity = run.first[0] = -2.0, position = run.first[1] = 0.0;
  for (auto& t : run.transitions) {  // exactly the model, and the gain never shows
    t.input[0] = 0.0;
    position += t.period_s * velocity;
    velocity -= t.period_s * 0.3 * velocity;
    t.measured[0] = velocity;
    t.measured[1] = position;
  }
  Instance p(c);
  feed(*p, run);
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  EXPECT_NEAR(mean[0], 1.0, 1e-9);
  EXPECT_NEAR(sd[0], 0.3, 1e-9);
  EXPECT_NEAR(p->quantile(0, 0.95), 1.0 + 0.3 * 1.6448536269514722, 1e-9);
  EXPECT_LT(sd[1], 0.05);
}

// Particles are draws from the law: their moments are its own, and they move with it.
TEST(Conjugate, ParticlesAreTheLaw) {
  auto c = config();
  c.posterior.particles = 1024;
  const Track run = simulate(c, 0.8, 0.3, 100, 6);
  Instance p(c);
  feed(*p, run);
  double mean[2], sd[2], sum[2] = {}, square[2] = {}, total = 0.0;
  p->moments(mean, sd, nullptr, nullptr);
  std::vector<double> values[2];
  for (std::uint32_t k = 0; k < p->size(); ++k) {
    double params[2], state[2], weight;
    p->particle(k, params, state, &weight);
    EXPECT_EQ(state[0], run.transitions.back().measured[1]);
    total += weight;
    for (int i = 0; i < 2; ++i) {
      sum[i] += weight * params[i];
      square[i] += weight * (params[i] - mean[i]) * (params[i] - mean[i]);
      values[i].push_back(params[i]);
    }
  }
  EXPECT_NEAR(total, 1.0, 1e-12);
  for (int i = 0; i < 2; ++i) {
    // their own mean and covariance are taken out; what is left is the noise scale's spread over the particles
    EXPECT_NEAR(sum[i], mean[i], 0.01 * sd[i]);
    EXPECT_NEAR(std::sqrt(square[i]) / sd[i], 1.0, 0.02);
    std::sort(values[i].begin(), values[i].end());
    for (const double q : {0.05, 0.25, 0.5, 0.75, 0.95})
      EXPECT_NEAR(values[i][static_cast<std::size_t>(q * 1024)], p->quantile(static_cast<std::uint32_t>(i), q),
                  0.12 * sd[i]);
  }
  std::vector<float> params(2 * 8), state(2 * 8);
  p->draw(8, 1, params.data(), state.data(), nullptr, nullptr);
  for (int k = 0; k < 8; ++k) {
    EXPECT_NEAR(double(params[static_cast<std::size_t>(k)]), mean[0], 5.0 * sd[0]);
    EXPECT_EQ(state[static_cast<std::size_t>(8 + k)], static_cast<float>(run.transitions.back().measured[0]));
  }
  p->draw(1, 1, params.data(), nullptr, nullptr, nullptr);
  EXPECT_EQ(params[1], static_cast<float>(mean[1]));
}

// A gain that doubles in mid-run: with a tenth of the data's weight left after 45 transitions the law has followed
// after 60, without forgetting it has not.
TEST(Conjugate, ForgettingFollowsAChange) {
  for (const double rate : {1.0, 0.95}) {
    auto c = config();
    c.posterior.forgetting[0] = rate;
    Track run = simulate(c, 0.6, 0.3, 300, 12, 0.2);
    Track after = simulate(c, 1.2, 0.3, 60, 13, 0.2);
    Instance p(c);
    feed(*p, run);
    ASSERT_EQ(p->start(after.first), tiller_status_ok);
    for (const auto& t : after.transitions) ASSERT_EQ(p->update(t), tiller_status_ok);
    double mean[2], sd[2];
    p->moments(mean, sd, nullptr, nullptr);
    std::printf("rate %.2f: gain %.3f +- %.3f, truth 1.2\n", rate, mean[0], sd[0]);
    if (rate == 1.0)
      EXPECT_LT(mean[0], 1.0);
    else
      EXPECT_NEAR(mean[0], 1.2, 4.0 * sd[0]);
  }
}

// ---- adequacy ------------------------------------------------------------------------------------

// Twenty runs of 1,000 transitions each: the level is one alarm in a hundred runs of 10,000, so none is expected. A dry
// friction of 0.5 N/kg takes 0.025 m/s from every step, more than two deviations of its noise (0.011 m/s), of which the
// damping explains a part: every run is found out.
TEST(Conjugate, SaysWhenTheModelIsWrong) {
  auto c = config();
  c.model = &rig::transition_model();
  c.posterior.adequacy = 1;
  c.posterior.particles = 16;
  int false_alarms = 0, alarms = 0, ticks = 0;
  for (unsigned r = 0; r < 20; ++r) {
    Instance right(c), wrong(c);
    feed(*right, simulate(c, 0.8, 0.3, 1000, 100001 + r));
    ASSERT_NE(right->adequacy(), nullptr);
    false_alarms += right->adequacy()->state() == tiller_adequacy_inadequate;
    const Track run = simulate(c, 0.8, 0.3, 400, 100001 + r, 1.0, 0.5);
    ASSERT_EQ(wrong->start(run.first), tiller_status_ok);
    for (const auto& t : run.transitions) {
      ASSERT_EQ(wrong->update(t), tiller_status_ok);
      ticks += wrong->adequacy()->state() != tiller_adequacy_inadequate;
    }
    alarms += wrong->adequacy()->state() == tiller_adequacy_inadequate && wrong->adequacy()->channel() == 0;
  }
  std::printf("alarms: %d of 20 without reason, %d of 20 with, after %d ticks\n", false_alarms, alarms, ticks / 20);
  EXPECT_EQ(false_alarms, 0);
  EXPECT_GE(alarms, 19);
}

// ---- missing and bad data ------------------------------------------------------------------------

std::vector<double> told(tiller::Posterior& p) {
  std::vector<double> all(12);
  p.moments(&all[0], &all[2], nullptr, nullptr);
  p.covariance(&all[4]);
  all[8] = p.noise_scale();
  p.particle(3, &all[9], nullptr, &all[11]);
  return all;
}

TEST(Conjugate, MissingValuesAreLeftOut) {
  const auto c = config();
  Track run = simulate(c, 0.8, 0.3, 300, 9);
  for (std::size_t k = 0; k < run.transitions.size(); k += 4) run.transitions[k].measured[k % 2] = NAN;
  Instance p(c);
  feed(*p, run);
  double mean[2], sd[2], state[2], state_sd[2];
  p->moments(mean, sd, state, state_sd);
  EXPECT_NEAR(mean[0], 0.8, 4.5 * sd[0]);
  EXPECT_NEAR(mean[1], 0.3, 4.5 * sd[1]);
  EXPECT_LT(sd[0], 0.2);
  // a state that is not measured goes on by the model, and is known less well
  tiller::Transition t = run.transitions.back();
  const double last = t.measured[1];
  t.measured[0] = NAN;
  t.measured[1] = last + t.period_s * state[1];
  ASSERT_EQ(p->update(t), tiller_status_ok);
  double next[2], next_sd[2];
  p->moments(mean, nullptr, next, next_sd);
  EXPECT_EQ(next[0], t.measured[1]);
  EXPECT_NEAR(next[1], state[1] + t.period_s * (mean[0] * t.input[0] - mean[1] * state[1]), 1e-9);
  EXPECT_GT(next_sd[1], 100.0 * state_sd[1]);
}

TEST(Conjugate, BadInputIsRefusedAndLeavesNoTrace) {
  const auto c = config();
  const Track run = simulate(c, 0.8, 0.3, 50, 2);
  Instance p(c);
  EXPECT_EQ(p->update(run.transitions[0]), tiller_status_wrong_state);
  const double infinite[2] = {INFINITY, 0.0};
  EXPECT_EQ(p->start(infinite), tiller_status_sensor_not_finite);
  feed(*p, run);
  const auto before = told(*p);
  const auto refused = [&](tiller_status_t want, auto change) {
    tiller::Transition t = run.transitions[7];
    change(t);
    EXPECT_EQ(p->update(t), want);
    EXPECT_EQ(told(*p), before);
  };
  refused(tiller_status_bad_period, [](auto& t) { t.period_s = NAN; });
  refused(tiller_status_bad_period, [](auto& t) { t.period_s = 10.0; });
  refused(tiller_status_time_backwards, [](auto& t) { t.period_s = 0.0; });
  refused(tiller_status_time_backwards, [](auto& t) { t.period_s = -0.05; });
  refused(tiller_status_command_not_finite, [](auto& t) { t.input[0] = NAN; });
  refused(tiller_status_sensor_not_finite, [](auto& t) { t.measured[0] = INFINITY; });
  // nothing measured: taken in, nothing learnt
  tiller::Transition t = run.transitions[7];
  t.measured[0] = NAN;
  t.measured[1] = NAN;
  ASSERT_EQ(p->update(t), tiller_status_ok);
  EXPECT_EQ(told(*p)[0], before[0]);
  EXPECT_EQ(told(*p)[2], before[2]);
}

// Finite, but its square is not: the state believes it, the parameters do not.
TEST(Conjugate, ValuesBeyondReasonTeachNothing) {
  const auto c = config();
  const Track run = simulate(c, 0.8, 0.3, 50, 2);
  Instance p(c);
  feed(*p, run);
  const auto before = told(*p);
  tiller::Transition t = run.transitions[7];
  t.measured[0] = 1e200;
  EXPECT_EQ(p->update(t), tiller_status_posterior_degenerate);
  EXPECT_EQ(told(*p), before);
  EXPECT_EQ(p->update(run.transitions[8]), tiller_status_posterior_degenerate);  // begins at that value
  EXPECT_EQ(told(*p), before);
  EXPECT_EQ(p->update(run.transitions[9]), tiller_status_ok);
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  EXPECT_TRUE(std::isfinite(mean[0]) && std::isfinite(sd[1]));
}

TEST(Conjugate, NothingToInferIsNoHarm) {
  auto c = config();
  c.priors[0] = rig::fixed(0.8);
  c.priors[1] = rig::fixed(0.3);
  c.posterior.noise_scale_shape = 2.0;
  Instance p(c);
  feed(*p, simulate(c, 0.8, 0.3, 400, 3, 2.0));
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  EXPECT_EQ(mean[0], 0.8);
  EXPECT_EQ(sd[1], 0.0);
  EXPECT_NEAR(p->noise_scale(), 2.0, 4.5 * 2.0 / std::sqrt(2.0 * 800.0));  // of 800 rows
}

TEST(Conjugate, ARepeatedRunHasTheSameBitsAndNoHeap) {
  const auto c = config();
  const Track run = simulate(c, 0.8, 0.3, 200, 14);
  Instance p(c), q(c);
  feed(*p, run);
  const auto first = told(*p);
  p->reset();
  q->reset();
  const long before = heap_calls;
  (void)q->start(run.first);
  for (const auto& t : run.transitions) (void)q->update(t);
  float drawn[2 * 8];
  q->draw(8, 3, drawn, nullptr, nullptr, nullptr);
  (void)q->quantile(1, 0.3);
  EXPECT_EQ(heap_calls, before);
  feed(*p, run);
  EXPECT_EQ(told(*p), first);
  EXPECT_EQ(told(*q), first);
  std::vector<double> trap(5);
  EXPECT_GT(heap_calls, before) << "the trap itself must work";
}

TEST(Conjugate, FrozenKeepsThePrior) {
  auto c = config();
  c.posterior.enabled = 0;
  Instance p(c);
  const auto prior = told(*p);
  feed(*p, simulate(c, 0.8, 0.3, 50, 4));
  EXPECT_EQ(told(*p), prior);
  EXPECT_EQ(p->exponent(), 0.0);
}

// ---- which configurations have a closed form -----------------------------------------------------

const char* refusal(const tiller_config_t& c, const tiller::RolloutTable& table = rig::table()) {
  tiller::StepSetup setup;
  if (c.model->kernels && tiller::make_step_setup(c, setup) != tiller_status_ok) return "setup";
  const char* field = "";
  const tiller_status_t status = tiller::Posterior::check(c, setup, table, &field);
  EXPECT_EQ(status, *field ? tiller_status_bad_posterior : tiller_status_ok);
  return field;
}

TEST(Conjugate, RefusesWhatItCannotDo) {
  EXPECT_STREQ(refusal(config()), "");
  const auto with = [](auto change) {
    tiller::Config c = config();
    change(c);
    return std::string(refusal(c));
  };
  EXPECT_EQ(with([](auto& c) { c.measurement_count = 1; }), "measured_state");
  EXPECT_EQ(with([](auto& c) { c.measured_state[0] = 0; }), "measured_state");
  EXPECT_EQ(with([](auto& c) { c.process_sd[0] = c.process_sd[1] = 0.0; }), "process_sd");
  EXPECT_EQ(with([](auto& c) { c.priors[1] = rig::uniform(0.1, 0.5); }), "priors");
  EXPECT_EQ(with([](auto& c) { c.priors[1] = rig::log_normal(0.1, 0.5); }), "priors");
  EXPECT_EQ(with([](auto& c) { c.priors[1].low = 0.0; }), "priors");
  EXPECT_EQ(with([](auto& c) { c.posterior.delay_hypotheses = 2; }), "posterior.delay_hypotheses");
  EXPECT_EQ(with([](auto& c) { c.posterior.forgetting_count = 2; }), "posterior.forgetting");
  EXPECT_EQ(with([](auto& c) { c.priors[1] = rig::fixed(0.3); }), "");
}

// The pendulum is affine in its damping, not in mass or length, and in the damping only under an integrator that
// evaluates the dynamics once.
TEST(Conjugate, AffinityIsFoundOut) {
  const auto pendulum = [](int unknown, std::uint32_t integrator, std::uint32_t substeps) {
    tiller::Config c = config();
    c.model = tiller_find_model("pendulum");
    c.integrator = integrator;
    c.substeps = substeps;
    c.body = {0.0, -9.81, 0.0, 0.0};
    c.param_count = 3;
    const double values[] = {0.7, 0.5, 0.1};
    for (int i = 0; i < 3; ++i) c.priors[i] = i == unknown ? rig::normal(values[i], 0.05) : rig::fixed(values[i]);
    return std::string(refusal(c, tiller::select_rollout(*c.model)));
  };
  EXPECT_EQ(pendulum(2, tiller_integrator_semi_implicit_euler, 1), "");
  EXPECT_EQ(pendulum(2, tiller_integrator_semi_implicit_euler, 3), "posterior.kind");
  EXPECT_EQ(pendulum(2, tiller_integrator_rk4, 1), "posterior.kind");
  EXPECT_EQ(pendulum(0, tiller_integrator_semi_implicit_euler, 1), "posterior.kind");
  EXPECT_EQ(pendulum(1, tiller_integrator_semi_implicit_euler, 1), "posterior.kind");
}

// ---- the other engines ---------------------------------------------------------------------------

// Their model is the same where the sensors are far better than a step's noise. `transition` gives each state a noise
// of its own; with two hundred transitions that moves the mean by less than what is allowed here.
class OtherEngine : public ::testing::TestWithParam<std::uint32_t> {};
INSTANTIATE_TEST_SUITE_P(Engines, OtherEngine, ::testing::Values(tiller_posterior_filter, tiller_posterior_transition));

TEST_P(OtherEngine, AgreesOnALinearSystem) {
  auto c = config();
  c.posterior.particles = 1024;
  c.posterior.moves_per_tick = 128;
  c.posterior.robust = c.posterior.disturbance = 0;
  c.posterior.ess_fraction = 0.5;
  auto other = c;
  other.posterior.kind = GetParam();
  other.priors[0].low = other.priors[1].low = -10.0;
  other.priors[0].high = other.priors[1].high = 10.0;
  const tiller::RolloutTable& table =
      GetParam() == tiller_posterior_transition ? rig::transition_table() : rig::table();
  double shift = 0.0, ratio = 0.0;
  const int runs = 4;
  for (int r = 0; r < runs; ++r) {
    const Track run = simulate(c, 0.8, 0.3, 200, static_cast<unsigned>(40 + r));
    Instance exact(c), sampled(other, nullptr, table);
    feed(*exact, run);
    ASSERT_EQ(sampled->start(run.first), tiller_status_ok);
    for (const auto& t : run.transitions) ASSERT_TRUE(rig::works(sampled->update(t)));
    double mean[2], sd[2], other_mean[2], other_sd[2];
    exact->moments(mean, sd, nullptr, nullptr);
    sampled->moments(other_mean, other_sd, nullptr, nullptr);
    for (int i = 0; i < 2; ++i) {
      shift = std::fmax(shift, std::fabs(other_mean[i] - mean[i]) / sd[i]);
      ratio = std::fmax(ratio, std::fabs(std::log(other_sd[i] / sd[i])));
    }
  }
  std::printf("largest shift %.3f deviations, largest ratio of deviations %.3f\n", shift, std::exp(ratio));
  // half of 1,024 particles independent: 4.5 / sqrt(512) of a mean, 4.5 / sqrt(1024) of a deviation
  EXPECT_LT(shift, 0.2);
  EXPECT_LT(ratio, 0.14);
}

}  // namespace
