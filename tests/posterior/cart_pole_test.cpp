// Encoders only, cart-pole, ten seconds of swinging: coverage and sharpening. Simulated by the kernel's double
// rollout (a model error belongs to other tests), random forces, true values drawn from the prior.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "cart_pole_rig.hpp"

namespace {

struct Result {
  int seeds = 0, covered[6] = {};
  double shrink[6] = {};  // geometric mean of prior over posterior deviation
  int at_full_exponent = 0;
};

Result run_seeds(const tiller_config_t& base, int seeds, int steps, double noise_belief = 1.0,
                 std::uint32_t plant_substeps = 1) {
  Result r;
  r.seeds = seeds;
  for (int seed = 1; seed <= seeds; ++seed) {
    auto c = base;
    c.seed = static_cast<std::uint64_t>(seed);
    const auto log = rig::simulate_cart_pole(c, steps, static_cast<unsigned>(seed), 12.0, plant_substeps);
    for (double& sd : c.process_sd) sd *= noise_belief;
    rig::CartPole p(c);
    double mean[6], before[6], after[6];
    p->moments(mean, before, nullptr, nullptr);
    EXPECT_EQ(p->start(log.first), tiller_status_ok);
    for (const auto& t : log.transitions) EXPECT_TRUE(rig::works(p->update(t)));
    p->moments(mean, after, nullptr, nullptr);
    for (std::uint32_t i = 1; i < c.param_count; ++i) {
      r.covered[i] += p->quantile(i, 0.05) <= log.params[i] && log.params[i] <= p->quantile(i, 0.95) ? 1 : 0;
      r.shrink[i] += std::log(before[i] / after[i]) / seeds;
    }
    r.at_full_exponent += p->exponent() == 1.0 ? 1 : 0;
  }
  for (double& s : r.shrink) s = std::exp(s);
  return r;
}

void report(const char* what, const Result& r, std::uint32_t params) {
  std::printf("%s, %d seeds:", what, r.seeds);
  for (std::uint32_t i = 1; i < params; ++i) std::printf("  covered %d, sd / %.0f", r.covered[i], r.shrink[i]);
  std::printf("  (full exponent in %d)\n", r.at_full_exponent);
}

/// Coverage of 90 % intervals: within 3.29 binomial deviations from below (99.9 %; several statements are tested
/// with fixed seeds). Too wide is no failure where the process noise is overstated. Sharpening: five times is asked.
void expect_honest_and_sharp(const Result& r, std::uint32_t params) {
  const double least = 0.9 * r.seeds - 3.29 * std::sqrt(0.09 * r.seeds);
  for (std::uint32_t i = 1; i < params; ++i) {
    EXPECT_GE(r.covered[i], least) << "parameter " << i;
    EXPECT_GE(r.shrink[i], 5.0) << "parameter " << i;
  }
}

TEST(CartPole, WholeRunInTheWindow) {
  auto c = rig::cart_pole_config();
  c.posterior.moves_per_tick = 8;
  const Result r = run_seeds(c, 40, 200);
  report("window 256, 4 s", r, c.param_count);
  expect_honest_and_sharp(r, c.param_count);
}

TEST(CartPole, MostOfTheRunInTheSummary) {
  auto c = rig::cart_pole_config();
  c.posterior.window = 32;
  c.posterior.moves_per_tick = 8;
  const Result r = run_seeds(c, 60, 500);
  report("window 32, 10 s", r, c.param_count);
  expect_honest_and_sharp(r, c.param_count);
}

/// The plant integrates ten times finer than the model, so friction acts a little differently: with process noise
/// for what the model lacks (ten times the simulated) the intervals stay honest and are still sharp.
TEST(CartPole, CoarseModelWithProcessNoiseForIt) {
  auto c = rig::cart_pole_config();
  c.posterior.window = 32;
  c.posterior.moves_per_tick = 8;
  const Result r = run_seeds(c, 20, 500, 10.0, 10);
  report("model ten times coarser than the plant", r, c.param_count);
  expect_honest_and_sharp(r, c.param_count);
}

TEST(CartPole, UnmeasuredRatesAreEstimated) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    auto c = rig::cart_pole_config();
    c.posterior.window = 32;
    const auto log = rig::simulate_cart_pole(c, 200, seed);
    rig::CartPole p(c);
    (void)p->start(log.first);
    for (const auto& t : log.transitions) (void)p->update(t);
    double mean[4], sd[4];
    p->moments(nullptr, nullptr, mean, sd);
    for (std::uint32_t i = 0; i < 4; ++i)
      EXPECT_LT(std::fabs(tiller::state_difference(*c.model, i, mean[i], log.last_state[i])), 3.5 * sd[i])
          << "seed " << seed << " state " << i;
  }
}

/// An effect with a state (actuator lag) and one with memory (input delay), both unknown: reruns carry them.
TEST(CartPole, LagAndDelayAreFound) {
  auto c = rig::cart_pole_config();
  c.effect_count = 3;
  c.effects[1] = {tiller_effect_actuator_lag, 0};
  c.effects[2] = {tiller_effect_input_delay, 0};
  c.param_count = 6;
  c.priors[4] = rig::uniform(0.0, 0.2);   // lag's time constant
  c.priors[5] = rig::uniform(0.0, 0.08);  // delay
  // the likelihood has a kink at every whole period of delay, which the summary's lines do not follow: the data
  // stay in the window
  c.posterior.window = 320;
  c.posterior.moves_per_tick = 16;
  const Result r = run_seeds(c, 20, 300);
  report("with lag and delay, 6 s", r, c.param_count);
  expect_honest_and_sharp(r, c.param_count);
}

}  // namespace
