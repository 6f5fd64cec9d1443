// The same bits on every run and for every number of threads; no heap; the selection for the planner.

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

#include "cart_pole_rig.hpp"
#include "posterior/contraction.hpp"
#include "tiller/config.hpp"
#include "transition_rig.hpp"

// The linker sends every call of these to us (see CMakeLists.txt), from whichever library it comes.
extern "C" {
void* __real_malloc(std::size_t);
void* __real_calloc(std::size_t, std::size_t);
void* __real_realloc(void*, std::size_t);
void __real_free(void*);
}
namespace {
std::atomic<long> heap_calls{0};
}
extern "C" {
void* __wrap_malloc(std::size_t n) {
  ++heap_calls;
  return __real_malloc(n);
}
void* __wrap_calloc(std::size_t n, std::size_t m) {
  ++heap_calls;
  return __real_calloc(n, m);
}
void* __wrap_realloc(void* p, std::size_t n) {
  ++heap_calls;
  return __real_realloc(p, n);
}
void __wrap_free(void* p) {
  ++heap_calls;
  __real_free(p);
}
}
// operator new and delete stand in the C++ library, which was linked without us: they get bodies that are seen.
void* operator new(std::size_t n) {
  void* p = std::malloc(n ? n : 1);
  if (!p) std::abort();
  return p;
}
// not inlined: GCC would pair their free with a new that it does not look into, and warn
__attribute__((noinline)) void operator delete(void* p) noexcept { std::free(p); }
__attribute__((noinline)) void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace {

/// As many threads as asked for, started for each call: slow, and nothing to get wrong.
struct Threads {
  explicit Threads(unsigned count) : n(count) {
    hooks.size = sizeof hooks;
    hooks.version = TILLER_CONFIG_VERSION;
    hooks.context = this;
    hooks.parallel_for = [](void* self, std::uint32_t items, void (*work)(void*, std::uint32_t), void* arg) {
      const unsigned threads = static_cast<Threads*>(self)->n;
      std::vector<std::thread> running;
      for (unsigned t = 0; t < threads; ++t)
        running.emplace_back([=] {
          for (std::uint32_t i = t; i < items; i += threads) work(arg, i);
        });
      for (auto& thread : running) thread.join();
    };
  }
  unsigned n;
  tiller_hooks_t hooks{};
};

std::vector<double> outcome(tiller::Posterior& p) {
  std::vector<double> all = {p.exponent(), p.noise_scale(), p.effective_samples(), p.quantile(1, 0.3)};
  for (std::uint32_t i = 0; i < p.size(); ++i) {
    double params[4], state[4], weight;
    p.particle(i, params, state, &weight);
    all.insert(all.end(), params, params + 4);
    all.insert(all.end(), state, state + 4);
    all.push_back(weight);
  }
  return all;
}

void run(rig::CartPole& p, const rig::CartPoleLog& log) {
  ASSERT_EQ(p->start(log.first), tiller_status_ok);
  for (const auto& t : log.transitions) ASSERT_TRUE(rig::works(p->update(t)));
}

TEST(Determinism, ThreadsAndRepetitionKeepEveryBit) {
  auto c = rig::cart_pole_config();
  c.posterior.particles = 1024;  // enough for the filter step itself to be spread over threads
  c.posterior.window = 32;
  const auto log = rig::simulate_cart_pole(c, 60, 11);
  rig::CartPole plain(c);
  run(plain, log);
  const auto expected = outcome(*plain.instance->operator->());
  for (unsigned count : {1u, 2u, 4u}) {
    Threads threads(count);
    rig::CartPole p(c, &threads.hooks);
    run(p, log);
    EXPECT_EQ(outcome(*p.instance->operator->()), expected) << count << " threads";
  }
  plain->reset();
  run(plain, log);
  EXPECT_EQ(outcome(*plain.instance->operator->()), expected) << "after reset";
  c.seed = 2;
  rig::CartPole other(c);
  run(other, log);
  EXPECT_NE(outcome(*other.instance->operator->()), expected) << "the seed matters";
}

TEST(Determinism, NoHeapInTenThousandUpdates) {
  auto c = rig::config();
  c.priors[1] = rig::uniform(0.0, 1.0);
  c.posterior.particles = 64;
  c.posterior.window = 32;
  c.posterior.moves_per_tick = 8;
  auto log = rig::simulate(c, 0.9, 0.3, 10000, 12);
  rig::Instance p(c);
  const long at_work = heap_calls;
  {
    std::vector<double> proof(100);
    ASSERT_GT(proof.capacity(), 0u);
  }
  ASSERT_GT(heap_calls, at_work) << "the trap itself must work";
  int faults = 0;
  const long before = heap_calls;
  p->reset();
  (void)p->start(&log.first);
  for (std::size_t k = 0; k < log.transitions.size(); ++k) {
    faults += rig::works(p->update(log.transitions[k])) ? 0 : 1;
    double mean[2], sd[2], state[2], covariance[4];
    float params[16], states[16];
    if (k % 100 == 0) {
      p->moments(mean, sd, state, nullptr);
      p->covariance(covariance);
      (void)p->quantile(0, 0.5);
      p->draw(8, k, params, states, nullptr, nullptr);
    }
    if (k % 3000 == 2999) (void)p->start(&log.first);  // closes a window
  }
  EXPECT_EQ(heap_calls, before);
  EXPECT_EQ(faults, 0);
}

std::vector<double> transition_outcome(const tiller_config_t& c, const rig::TransitionLog& log,
                                       const tiller_hooks_t* hooks) {
  rig::Instance p(c, hooks, rig::transition_table());
  EXPECT_TRUE(p.fits());
  EXPECT_EQ(p->start(log.first), tiller_status_ok);
  std::vector<double> all;
  for (const auto& t : log.transitions) {
    EXPECT_TRUE(rig::works(p->update(t)));
    all.insert(all.end(), {p->exponent(), p->noise_scale(), p->effective_samples(), p->log_predictive()});
  }
  for (std::uint32_t i = 0; i < p->size(); ++i) {
    double params[2], weight;
    p->particle(i, params, nullptr, &weight);
    all.insert(all.end(), {params[0], params[1], weight});
  }
  return all;
}

TEST(Determinism, TransitionsKeepEveryBitOnAnyNumberOfThreads) {
  auto c = rig::transition_config();
  c.posterior.disturbance = c.posterior.robust = 1;
  c.posterior.prior_proposal_fraction = 0.05;
  c.posterior.particles = 2048;  // enough for one transition of all particles to be spread over threads with its moves
  c.posterior.moves_per_tick = 256;
  const auto log = rig::simulate_transitions(c, 0.9, 0.3, 150, 14);
  const auto expected = transition_outcome(c, log, nullptr);
  EXPECT_EQ(transition_outcome(c, log, nullptr), expected);
  for (unsigned count : {1u, 2u, 3u}) {
    Threads threads(count);
    EXPECT_EQ(transition_outcome(c, log, &threads.hooks), expected) << count << " threads";
  }
  c.seed = 2;
  EXPECT_NE(transition_outcome(c, log, nullptr), expected) << "the seed matters";
}

TEST(Determinism, NoHeapInTwoThousandTransitions) {
  auto c = rig::transition_config();
  c.posterior.disturbance = c.posterior.robust = 1;
  c.posterior.particles = 64;
  c.posterior.window = 16;
  c.posterior.moves_per_tick = 16;
  auto log = rig::simulate_transitions(c, 0.9, 0.3, 2000, 15);
  for (std::size_t k = 7; k < 2000; k += 40) log.transitions[k].measured[1] = k % 80 == 7 ? NAN : 50.0;
  rig::Instance p(c, nullptr, rig::transition_table());
  int faults = 0;
  const long before = heap_calls;
  p->reset();
  (void)p->start(log.first);
  for (std::size_t k = 0; k < log.transitions.size(); ++k) {
    faults += rig::works(p->update(log.transitions[k])) ? 0 : 1;
    double mean[2], sd[2], state[2], covariance[4];
    float params[16], states[16];
    tiller::PosteriorReport report;
    p->moments(mean, sd, state, nullptr);
    p->covariance(covariance);
    (void)p->quantile(0, 0.5);
    p->draw(8, k, params, states, nullptr, nullptr);
    p->report(report);
    if (k % 500 == 499) (void)p->start(log.first);
  }
  EXPECT_EQ(heap_calls, before);
  EXPECT_EQ(faults, 0);
}

TEST(Determinism, NoHeapInABank) {
  auto c = rig::transition_config();
  c.posterior.particles = 64;
  c.posterior.window = 32;
  c.posterior.moves_per_tick = 8;
  c.posterior.delay_hypotheses = 2;
  c.posterior.forgetting_count = 2;
  c.posterior.forgetting[1] = 0.95;
  c.posterior.adequacy = 1;
  auto log = rig::simulate_transitions(c, 0.7, 0.3, 1000, 12);
  const auto after = rig::simulate_transitions(c, 1.4, 0.3, 1000, 13);
  rig::Instance p(c, nullptr, rig::transition_table());
  const long before = heap_calls;
  (void)p->start(log.first);
  for (std::size_t k = 0; k < 2000; ++k) {
    if (k == 1000) (void)p->start(after.first);
    (void)p->update(k < 1000 ? log.transitions[k] : after.transitions[k - 1000]);
    if (k % 100 != 0) continue;
    double mean[2], sd[2], covariance[4];
    float params[16], states[16];
    tiller::Contraction contraction;
    tiller::PosteriorReport report;
    p->moments(mean, sd, nullptr, nullptr);
    p->covariance(covariance);
    (void)p->quantile(0, 0.5);
    p->draw(8, k, params, states, nullptr, nullptr);
    p->report(report);
    (void)tiller::contract(c, *p, contraction);
  }
  EXPECT_EQ(heap_calls, before);
}

/// Stratified: a particle of weight w is chosen between floor(Mw) - 1 and ceil(Mw) + 1 times; states and parameters
/// of one column belong to one particle; the same tick draws the same.
TEST(Draw, StratifiedAndWhole) {
  const auto c = rig::config();
  const auto log = rig::simulate(c, 0.9, 0.3, 12, 13);
  rig::Instance p(c);
  rig::run(*p, log);
  const std::uint32_t m = 64;
  std::vector<float> params(2 * m), state(2 * m), again(2 * m);
  p->draw(m, 5, params.data(), state.data(), nullptr, nullptr);
  p->draw(m, 5, again.data(), nullptr, nullptr, nullptr);
  EXPECT_EQ(params, again);
  std::vector<int> found(m, 0);
  for (std::uint32_t i = 0; i < p->size(); ++i) {
    double theta[2], x[2], weight;
    p->particle(i, theta, x, &weight);
    int times = 0;
    for (std::uint32_t k = 0; k < m; ++k) {
      if (params[k] != static_cast<float>(theta[0]) || state[k] != static_cast<float>(x[0])) continue;
      EXPECT_EQ(state[m + k], static_cast<float>(x[1]));
      found[k] = 1;
      ++times;
    }
    EXPECT_LE(times, std::ceil(m * weight) + 1);
  }
  for (int hit : found) EXPECT_TRUE(hit);
}

/// A cloud whose weights differ by orders of magnitude: nothing was resampled or moved.
tiller::Config weighted_cloud() {
  auto c = rig::config();
  c.posterior.ess_fraction = 0.01;
  c.posterior.moves_per_tick = 0;
  c.posterior.particles = 64;
  return c;
}

TEST(Draw, ExpectsEachParticleMTimesItsWeight) {
  const auto c = weighted_cloud();
  rig::Instance p(c);
  rig::run(*p, rig::simulate(c, 0.9, 0.3, 25, 13));
  const std::uint32_t m = 8, ticks = 20000;
  std::vector<double> value(p->size()), weight(p->size()), found(p->size(), 0.0);
  for (std::uint32_t i = 0; i < p->size(); ++i) {
    double theta[2];
    p->particle(i, theta, nullptr, &weight[i]);
    value[i] = theta[0];
  }
  std::vector<float> params(2 * m);
  for (std::uint32_t t = 0; t < ticks; ++t) {
    p->draw(m, t, params.data(), nullptr, nullptr, nullptr);
    for (std::uint32_t k = 0; k < m; ++k)
      for (std::uint32_t i = 0; i < p->size(); ++i) found[i] += params[k] == static_cast<float>(value[i]) ? 1.0 : 0.0;
  }
  double heaviest = 0.0, lightest = 1.0;
  for (std::uint32_t i = 0; i < p->size(); ++i) {
    const double expected = m * weight[i] * ticks;
    // the count of one tick varies by at most m w (multinomial); five deviations for 64 particles
    EXPECT_NEAR(found[i], expected, 5.0 * std::sqrt(expected) + 1.0) << i;
    heaviest = std::max(heaviest, weight[i]);
    lightest = std::min(lightest, weight[i]);
  }
  EXPECT_GT(heaviest, 10.0 * lightest);  // the weights did differ
}

/// Variance over ticks of the selection's mean parameter, in shares of what independent draws would have.
double variance_share(rig::Instance& p, std::uint32_t m, std::uint32_t used) {
  double mean = 0.0, variance = 0.0;
  for (std::uint32_t i = 0; i < p->size(); ++i) {
    double theta[2], weight;
    p->particle(i, theta, nullptr, &weight);
    mean += weight * theta[0];
    variance += weight * theta[0] * theta[0];
  }
  variance -= mean * mean;
  const std::uint32_t ticks = 4000;
  std::vector<float> params(2 * m);
  double squares = 0.0;
  for (std::uint32_t t = 0; t < ticks; ++t) {
    p->draw(m, t, params.data(), nullptr, nullptr, nullptr);
    double sum = 0.0;
    for (std::uint32_t k = 0; k < used; ++k) sum += static_cast<double>(params[k]);
    squares += (sum / used - mean) * (sum / used - mean);
  }
  return squares / ticks / (variance / used);
}

TEST(Draw, VariesFarLessThanIndependentDraws) {
  for (const bool weighted : {false, true}) {
    const auto c = weighted ? weighted_cloud() : rig::config();
    rig::Instance p(c);
    rig::run(*p, rig::simulate(c, 0.9, 0.3, 25, 13));
    // Eight slices of a bell: the variance within slices is about 5 % of the whole. Strata over particles as they
    // happen to lie would give about 1 (independent) in the place of it. The first four of the eight columns stand
    // for every second slice, so their mean is off by half a slice at most: still far below independent draws.
    const double all = variance_share(p, 8, 8), first_half = variance_share(p, 8, 4), single = variance_share(p, 1, 1);
    std::printf("%s: variance of the mean of 8: %.3f of independent draws', of the first 4 of 8: %.3f, of 1: %.3f\n",
                weighted ? "uneven weights" : "even weights", all, first_half, single);
    EXPECT_LT(all, 0.15);
    EXPECT_LT(first_half, 0.5);
    EXPECT_LT(single, 1e-6);  // a single one is the mean itself, up to its rounding to f32
  }
}

/// Commands before the next one, newest first: what a delay needs.
TEST(Draw, HistoryIsNewestFirst) {
  auto c = rig::cart_pole_config();
  c.effect_count = 2;
  c.effects[1] = {tiller_effect_input_delay, 0};
  c.param_count = 5;
  c.priors[4] = rig::uniform(0.0, 0.06);
  c.safety.safe_command[0] = 0.25;
  rig::CartPole p(c);
  ASSERT_EQ(p.setup.delay_steps, 3u);
  const double first[2] = {0.0, 3.14};
  ASSERT_EQ(p->start(first), tiller_status_ok);
  for (int k = 1; k <= 2; ++k) {
    tiller::Transition t;
    t.period_s = c.period_s;
    t.input[0] = k;
    t.measured[0] = 0.0;
    t.measured[1] = 3.14;
    ASSERT_TRUE(rig::works(p->update(t)));
  }
  float history[3];
  p->draw(1, 0, nullptr, nullptr, nullptr, history);
  EXPECT_EQ(history[0], 2.0f);
  EXPECT_EQ(history[1], 1.0f);
  EXPECT_EQ(history[2], 0.25f) << "before the start the safe command was in force";
}

}  // namespace
