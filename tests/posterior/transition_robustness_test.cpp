// Bad input to the transition engine: a status each, and the posterior stays what it was.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <vector>

#include "core/rng.hpp"
#include "posterior/packed_matrix.hpp"
#include "posterior/transition/transition_lanes.hpp"
#include "posterior/transition/transition_posterior.hpp"
#include "transition_rig.hpp"

namespace {

using rig::Instance;
using rig::TransitionLog;
using tiller::Transition;

const tiller::RolloutTable& table() { return rig::transition_table(); }

/// Parameters and weights of every particle.
struct Particles {
  std::vector<double> params, weights;
  explicit Particles(const tiller::Posterior& p) {
    for (std::uint32_t i = 0; i < p.size(); ++i) {
      double params_i[2], weight;
      p.particle(i, params_i, nullptr, &weight);
      params.insert(params.end(), params_i, params_i + 2);
      weights.push_back(weight);
    }
  }
  bool operator==(const Particles& other) const { return params == other.params && weights == other.weights; }
};

std::vector<unsigned char> bytes(const Instance& p) {
  const auto* first = static_cast<const unsigned char*>(p.memory());
  return {first, first + p.size()};
}

void run(tiller::Posterior& p, const TransitionLog& log) {
  ASSERT_EQ(p.start(log.first), tiller_status_ok);
  for (const auto& t : log.transitions) ASSERT_TRUE(rig::works(p.update(t)));
}

tiller_status_t check(const tiller_config_t& c, const tiller::StepSetup& setup, const tiller::RolloutTable& rollouts,
                      std::string& field) {
  const char* name = "";
  const tiller_status_t status = tiller::Posterior::check(c, setup, rollouts, &name);
  field = name;
  return status;
}

TEST(TransitionRobustness, WhatItCannotTakeInIsRefusedBeforehand) {
  std::string field;
  tiller::StepSetup setup;
  const auto good = rig::transition_config();
  EXPECT_EQ(check(good, setup, table(), field), tiller_status_ok);
  auto partial = good;
  partial.measurement_count = 1;
  EXPECT_EQ(check(partial, setup, table(), field), tiller_status_bad_posterior);
  EXPECT_EQ(field, "measurement");
  auto twice = good;
  twice.measured_state[1] = 0;
  EXPECT_EQ(check(twice, setup, table(), field), tiller_status_bad_posterior);
  EXPECT_EQ(field, "measurement");
  setup.effect_state_count = 1;
  EXPECT_EQ(check(good, setup, table(), field), tiller_status_bad_posterior);
  EXPECT_EQ(field, "effects");
}

TEST(EveryEngine, TellsNothingOfAParticleThatIsNotThere) {
  for (const std::uint32_t forgettings : {1u, 2u})  // the second: a bank of engines
    for (std::uint32_t kind = 0; kind < tiller_posterior_kind_count; ++kind) {
      if (forgettings > 1 && kind != tiller_posterior_transition) continue;
      auto c = rig::transition_config();
      c.posterior.kind = kind;
      c.posterior.particles = 64;
      c.priors[0] = rig::normal(1.0, 0.3);
      c.priors[1] = rig::normal(0.4, 0.2);
      c.posterior.forgetting_count = forgettings;
      c.posterior.forgetting[1] = 0.9;
      Instance p(c, nullptr, table());
      const double first[2] = {};
      ASSERT_EQ(p->start(first), tiller_status_ok) << tiller::posterior_name(kind);
      const std::uint32_t n = p->size();
      double params[2] = {7.0, 7.0}, state[2] = {7.0, 7.0}, weight = 7.0;
      for (const std::uint32_t index : {n, n + 1, UINT32_MAX}) p->particle(index, params, state, &weight);
      for (const double untouched : {params[0], params[1], state[0], state[1], weight})
        EXPECT_EQ(untouched, 7.0) << tiller::posterior_name(kind);
      p->particle(n - 1, params, state, &weight);
      EXPECT_TRUE(params[1] != 7.0 && state[1] != 7.0 && weight != 7.0) << tiller::posterior_name(kind);
    }
}

TEST(EngineOfStates, BeginsWithTheNoiseThatIsConfigured) {
  for (const std::uint32_t kind : {tiller_posterior_transition, tiller_posterior_conjugate}) {
    auto c = rig::transition_config();
    c.posterior.kind = kind;
    c.posterior.particles = 64;
    c.posterior.noise_scale_shape = 5.0;
    c.priors[0] = rig::normal(1.0, 0.3);
    c.priors[1] = rig::normal(0.4, 0.2);
    const auto log = rig::simulate_transitions(c, 0.9, 0.3, 40, 1, 5.0);
    tiller::RolloutTable rollouts = table();
    rollouts.linearise = rig::table().linearise;
    Instance p(c, nullptr, rollouts);
    const double fresh = p->noise_scale();
    EXPECT_NEAR(fresh, 1.0, 0.15) << tiller::posterior_name(kind) << ": a mean or root mean of what the prior has";
    run(*p, log);
    EXPECT_GT(p->noise_scale(), 1.5) << tiller::posterior_name(kind);
    p->reset();
    EXPECT_EQ(p->noise_scale(), fresh) << tiller::posterior_name(kind);
  }
}

TEST(PackedMatrix, TimesItsInverseIsTheUnitMatrix) {
  constexpr std::uint32_t kSize = 4;
  const double rows[kSize][kSize] = {
      {4.0, 1.0, -0.5, 0.2}, {1.0, 3.0, 0.7, -0.3}, {-0.5, 0.7, 2.0, 0.4}, {0.2, -0.3, 0.4, 1.0}};
  double packed[kSize * (kSize + 1) / 2], inverse[kSize * (kSize + 1) / 2], log_determinant, *to = packed;
  for (std::uint32_t r = 0; r < kSize; ++r)
    for (std::uint32_t c = r; c < kSize; ++c) *to++ = rows[r][c];
  tiller::invert_packed(kSize, packed, inverse, log_determinant);
  for (std::uint32_t r = 0; r < kSize; ++r) {
    double product[kSize];
    tiller::multiply_packed(kSize, inverse, rows[r], product);  // a row is a column
    for (std::uint32_t c = 0; c < kSize; ++c) EXPECT_NEAR(product[c], r == c ? 1.0 : 0.0, 1e-14);
    double expected = 0.0;
    for (std::uint32_t c = 0; c < kSize; ++c) expected += product[c] * rows[r][c];
    EXPECT_NEAR(tiller::quadratic_packed(kSize, inverse, rows[r]), expected, 1e-14);
  }
  // by Gaussian elimination
  double a[kSize][kSize], determinant = 1.0;
  std::copy(&rows[0][0], &rows[0][0] + kSize * kSize, &a[0][0]);
  for (std::uint32_t p = 0; p < kSize; ++p) {
    determinant *= a[p][p];
    for (std::uint32_t r = p + 1; r < kSize; ++r) {
      const double factor = a[r][p] / a[p][p];
      for (std::uint32_t c = p; c < kSize; ++c) a[r][c] -= factor * a[p][c];
    }
  }
  EXPECT_NEAR(log_determinant, std::log(determinant), 1e-14);
}

TEST(TransitionLanes, MeanErrorsAreThoseOfParticlesThatCount) {
  constexpr std::uint32_t kLanes = 32, kStates = 3;
  tiller::Rng rng(1, 1, 0);
  double sums[kStates * kLanes], weight[kLanes];
  for (double& s : sums) s = 10.0 * rng.uniform();
  for (double& w : weight) w = rng.uniform();
  sums[5] = std::nan("");  // of one state: its particle counts in none
  sums[2 * kLanes + 17] = HUGE_VAL;
  weight[20] = 0.0;
  tiller::EvidenceJob job;
  job.nx = kStates;
  job.lanes = job.stride = kLanes;
  job.sums = sums;
  for (std::uint32_t r = 0; r < kStates; ++r) job.half_precision[r] = 0.5 + r;
  double mean[kStates], before[kStates];
  ASSERT_TRUE(tiller::transition_table().mean_errors(job, weight, mean, before));
  double total = 0.0, expected[kStates] = {};
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    if (l == 5 || l == 17) continue;
    total += weight[l];
    for (std::uint32_t r = 0; r < kStates; ++r) expected[r] += weight[l] * sums[r * kLanes + l];
  }
  for (std::uint32_t r = 0; r < kStates; ++r) {
    EXPECT_NEAR(mean[r], expected[r] / total, 1e-12 * expected[r]) << r;
    EXPECT_NEAR(before[r], expected[r] / total, 1e-12 * expected[r]) << r << ": no discrepancy takes a share";
  }
  std::fill(weight, weight + kLanes, 0.0);
  EXPECT_FALSE(tiller::transition_table().mean_errors(job, weight, mean, before));
}

TEST(TransitionRobustness, RefusedTransitionsChangeNothing) {
  const auto c = rig::transition_config();
  const auto log = rig::simulate_transitions(c, 0.9, 0.3, 60, 1);
  Instance p(c, nullptr, table());
  EXPECT_EQ(p->update(log.transitions[0]), tiller_status_wrong_state);
  run(*p, log);
  const auto before = bytes(p);
  const auto refused = [&](auto spoil) {
    Transition t = log.transitions.back();
    spoil(t);
    return p->update(t);
  };
  EXPECT_EQ(refused([](Transition& t) { t.period_s = 0.0; }), tiller_status_time_backwards);  // repeated
  EXPECT_EQ(refused([](Transition& t) { t.period_s = -0.05; }), tiller_status_time_backwards);
  EXPECT_EQ(refused([](Transition& t) { t.period_s = NAN; }), tiller_status_bad_period);
  EXPECT_EQ(refused([](Transition& t) { t.period_s = INFINITY; }), tiller_status_bad_period);
  EXPECT_EQ(refused([](Transition& t) { t.period_s = 0.51; }), tiller_status_bad_period);
  EXPECT_EQ(refused([](Transition& t) { t.input[0] = NAN; }), tiller_status_command_not_finite);
  EXPECT_EQ(refused([](Transition& t) { t.input[0] = INFINITY; }), tiller_status_command_not_finite);
  EXPECT_EQ(refused([](Transition& t) { t.measured[1] = -INFINITY; }), tiller_status_sensor_not_finite);
  const double infinite[2] = {0.0, INFINITY};
  EXPECT_EQ(p->start(infinite), tiller_status_sensor_not_finite);
  EXPECT_EQ(bytes(p), before);
  EXPECT_EQ(p->update(log.transitions.back()), tiller_status_ok);
}

/// A value so large that no residual's square is a number: all weights would be zero.
TEST(TransitionRobustness, WhenNoParticleIsFiniteThePosteriorIsKept) {
  const auto c = rig::transition_config();
  const auto log = rig::simulate_transitions(c, 0.9, 0.3, 80, 2);
  Instance p(c, nullptr, table());
  run(*p, log);
  const Particles before(*p);
  const double scale = p->noise_scale();
  Transition t = log.transitions.back();
  t.measured[1] = 1e200;
  EXPECT_EQ(p->update(t), tiller_status_posterior_degenerate);
  EXPECT_TRUE(Particles(*p) == before);
  EXPECT_EQ(p->noise_scale(), scale);
  ASSERT_EQ(p->start(log.first), tiller_status_ok);
  for (const auto& next : log.transitions) EXPECT_TRUE(rig::works(p->update(next)));
  EXPECT_EQ(p->exponent(), 1.0);
}

/// The linear system, not finite for gains above one.
void fragile(const tiller_model_t& m, const tiller::ResidualJob& job) {
  rig::linear_residual(m, job);
  for (std::uint32_t k = 0; k < job.count; ++k)
    for (std::uint32_t l = 0; l < job.lanes; ++l)
      if (job.params.data[l] > 1.0f) {
        if (job.residual) job.residual[(k * 2 + 1) * job.lanes + l] = NAN;
        if (job.squared) job.squared[job.lanes + l] = NAN;
      }
}

TEST(TransitionRobustness, ParticlesThatBlowUpDieAlone) {
  const auto c = rig::transition_config();
  tiller::RolloutTable rollouts = table();
  rollouts.residual = &fragile;
  const auto log = rig::simulate_transitions(c, 0.98, 0.3, 300, 3);
  Instance p(c, nullptr, rollouts);
  ASSERT_EQ(p->start(log.first), tiller_status_ok);
  for (const auto& t : log.transitions) {
    ASSERT_TRUE(rig::works(p->update(t)));
    const Particles now(*p);
    for (std::size_t i = 0; i < now.params.size(); i += 2) ASSERT_LE(now.params[i], 1.0 + 1e-7);
  }
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  EXPECT_NEAR(mean[0], 0.98, 5.0 * sd[0]);
}

/// Glitches of a hundred deviations hardly move the posterior when transitions are weighed, and ruin it when they are
/// not: a fiftieth of the transitions, the end of each wrong for one tick (so that the next one's beginning is wrong
/// too).
TEST(TransitionRobustness, OutliersAreDoubted) {
  auto c = rig::transition_config();
  c.posterior.disturbance = 0;
  double off[2] = {}, widened[2] = {};
  for (unsigned seed = 0; seed < 8; ++seed) {
    const auto clean = rig::simulate_transitions(c, 0.9, 0.3, 400, 20 + seed);
    auto spoilt = clean;
    for (std::size_t k = 25; k < 400; k += 50)
      spoilt.transitions[k].measured[1] += (k % 100 ? 100.0 : -100.0) * c.process_sd[1] * std::sqrt(c.period_s);
    for (unsigned robust = 0; robust < 2; ++robust) {
      c.posterior.robust = robust;
      c.seed = seed;
      Instance with(c, nullptr, table()), without(c, nullptr, table());
      run(*with, spoilt);
      run(*without, clean);
      double mean[2][2], sd[2][2];
      with->moments(mean[0], sd[0], nullptr, nullptr);
      without->moments(mean[1], sd[1], nullptr, nullptr);
      off[robust] += std::fabs(mean[0][0] - mean[1][0]) / sd[1][0] / 8;
      widened[robust] += sd[0][0] / sd[1][0] / 8;
      if (robust) {
        EXPECT_EQ(with->gated(), 16u) << "each glitch spoils two transitions";
      }
    }
  }
  std::printf("glitches: mean off by %.2f deviations (%.2f unweighed), deviation %.2f (%.2f) of the clean one\n",
              off[1], off[0], widened[1], widened[0]);
  EXPECT_LT(off[1], 0.5);
  EXPECT_LT(widened[1], 1.15);
  EXPECT_GT(widened[0], 3.0) << "else this test shows nothing";
}

/// Six in a row that nobody explains are believed: the noise scale then says so.
TEST(TransitionRobustness, APersistentChangeIsBelieved) {
  auto c = rig::transition_config();
  c.posterior.robust = 1;
  auto log = rig::simulate_transitions(c, 0.9, 0.3, 200, 5);
  for (std::size_t k = 100; k < 200; ++k) log.transitions[k].measured[1] += k % 2 ? 5.0 : -5.0;
  Instance p(c, nullptr, table());
  run(*p, log);
  EXPECT_GE(p->gated(), 5u);
  EXPECT_LE(p->gated(), 10u);
  EXPECT_GT(p->noise_scale(), 20.0);
}

/// 60 % of all samples missing: 16 % of the transitions are left, and the posterior is that of those alone.
TEST(TransitionRobustness, MissingSamples) {
  auto c = rig::transition_config();
  c.posterior.disturbance = 0;
  auto log = rig::simulate_transitions(c, 0.9, 0.3, 1500, 6);
  tiller::Rng rng(6, 99, 0);
  for (auto& t : log.transitions)
    if (rng.uniform() < 0.6) t.measured[0] = t.measured[1] = NAN;
  Instance p(c, nullptr, table()), whole(c, nullptr, table());
  run(*p, log);
  run(*whole, rig::simulate_transitions(c, 0.9, 0.3, 1500, 6));
  double mean[2], sd[2], state[2], state_sd[2], whole_sd[2];
  p->moments(mean, sd, state, state_sd);
  whole->moments(nullptr, whole_sd, nullptr, nullptr);
  std::printf("60 %% missing: gain %.4f +- %.4f, deviation %.2f of the whole record's\n", mean[0], sd[0],
              sd[0] / whole_sd[0]);
  EXPECT_NEAR(mean[0], 0.9, 3.5 * sd[0]);
  EXPECT_NEAR(sd[0] / whole_sd[0], std::sqrt(1.0 / 0.16), 0.5);
  EXPECT_TRUE(std::isfinite(state[0]) && std::isfinite(state[1]) && state_sd[0] > 0.0 && state_sd[1] > 0.0);
}

/// One row missing at the end of each transition leaves the other row's information: velocities alone tell the gain.
/// The transition after it begins at a guess and is left out.
TEST(TransitionRobustness, MissingRowsAreLeftOutRowByRow) {
  auto c = rig::transition_config();
  c.posterior.disturbance = 0;
  auto log = rig::simulate_transitions(c, 0.9, 0.3, 600, 7), half = log;
  for (std::size_t k = 0; k < half.transitions.size(); k += 2) half.transitions[k].measured[0] = NAN;
  auto ends = log;
  for (std::size_t k = 1; k < ends.transitions.size(); k += 2) ends.transitions[k].measured[0] = NAN;
  Instance rows(c, nullptr, table());
  ASSERT_EQ(rows->start(log.first), tiller_status_ok);
  for (const auto& t : half.transitions) ASSERT_TRUE(rig::works(rows->update(t)));
  const auto& transitions = static_cast<const tiller::TransitionPosterior&>(*rows).transitions();
  EXPECT_EQ(transitions.evidence().known(0), 0.0);
  EXPECT_EQ(transitions.evidence().known(1), 300.0);
  double mean[2], sd[2];
  rows->moments(mean, sd, nullptr, nullptr);
  EXPECT_NEAR(mean[0], 0.9, 3.5 * sd[0]);
}

/// The truth lies outside of the prior: the cloud gathers at the bound, and the noise scale says what is left.
TEST(TransitionRobustness, PriorThatExcludesTheTruth) {
  auto c = rig::transition_config();
  c.posterior.disturbance = 0;
  const auto log = rig::simulate_transitions(c, 4.0, 0.3, 400, 8);
  Instance p(c, nullptr, table());
  run(*p, log);
  double mean[2];
  p->moments(mean, nullptr, nullptr, nullptr);
  EXPECT_GT(mean[0], 1.49);
  const Particles now(*p);
  for (std::size_t i = 0; i < now.params.size(); i += 2) EXPECT_LE(now.params[i], 1.5);
  EXPECT_GT(p->noise_scale(), 1.5);
  EXPECT_EQ(p->exponent(), 1.0);
}

/// Nothing moves, nothing is learnt: the posterior is the prior.
TEST(TransitionRobustness, ZeroExcitation) {
  const auto c = rig::transition_config();
  TransitionLog still{{0.0, 0.0}, {}};
  Transition t;
  t.period_s = c.period_s;
  still.transitions.assign(300, t);
  Instance p(c, nullptr, table());
  run(*p, still);
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  const double prior_sd = 1.0 / std::sqrt(12.0);
  EXPECT_NEAR(mean[0], 1.0, 4.5 / std::sqrt(512.0) * prior_sd);
  EXPECT_NEAR(sd[0], prior_sd, 4.5 / std::sqrt(1024.0) * prior_sd);
  EXPECT_EQ(p->exponent(), 1.0);
}

TEST(TransitionRobustness, SixteenParticlesAndNoMoves) {
  for (std::uint32_t moves : {0u, 8u, 16u}) {
    auto c = rig::transition_config();
    c.posterior.particles = 16;
    c.posterior.moves_per_tick = moves;
    c.posterior.window = 16;
    const auto log = rig::simulate_transitions(c, 0.9, 0.3, 300, 9);
    Instance p(c, nullptr, table());
    run(*p, log);
    double mean[2], sd[2];
    p->moments(mean, sd, nullptr, nullptr);
    EXPECT_TRUE(std::isfinite(mean[0]) && std::isfinite(sd[0]));
    double sum = 0.0;
    for (double w : Particles(*p).weights) sum += w;
    EXPECT_NEAR(sum, 1.0, 1e-9);
    EXPECT_TRUE(p.fits());
  }
}

TEST(TransitionRobustness, FrozenKeepsThePrior) {
  auto c = rig::transition_config();
  c.posterior.enabled = 0;
  const auto log = rig::simulate_transitions(c, 1.0, 0.3, 200, 10);
  Instance p(c, nullptr, table());
  const Particles before(*p);
  run(*p, log);
  EXPECT_TRUE(Particles(*p) == before);
  EXPECT_EQ(p->exponent(), 0.0);
  EXPECT_EQ(p->effective_samples(), 1024.0);
  double state[2];
  p->moments(nullptr, nullptr, state, nullptr);
  EXPECT_EQ(state[0], log.transitions.back().measured[0]);
}

TEST(TransitionRobustness, NothingToInfer) {
  auto c = rig::transition_config();
  c.priors[0] = rig::fixed(0.9);
  c.priors[1] = rig::fixed(0.3);
  const auto log = rig::simulate_transitions(c, 0.9, 0.3, 400, 11);
  Instance p(c, nullptr, table());
  run(*p, log);
  double mean[2], sd[2];
  p->moments(mean, sd, nullptr, nullptr);
  EXPECT_EQ(mean[0], 0.9);
  EXPECT_EQ(sd[0], 0.0);
  EXPECT_NEAR(p->noise_scale(), 1.0, 0.2);
}

}  // namespace
