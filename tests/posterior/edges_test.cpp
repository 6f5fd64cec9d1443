// What every engine promises at its edges: reads out of range and of nothing, refusals that change nothing, a period
// without a measurement, and what an engine says against a configuration.

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "transition_rig.hpp"

namespace {

using rig::Instance;

/// The rig's system in plain loops, with what each of the engines asks of a table.
const tiller::RolloutTable& whole_table() {
  static const tiller::RolloutTable made = [] {
    tiller::RolloutTable t = rig::transition_table();
    t.linearise = &rig::linearise;
    return t;
  }();
  return made;
}

constexpr std::uint32_t kBank = tiller_posterior_kind_count;  // transition, with two hypotheses of delay side by side

/// Both states measured; the gain is unknown, the damping known.
tiller::Config config_of(std::uint32_t engine) {
  tiller::Config c = rig::config();
  c.priors[0] = rig::normal(1.0, 0.3);
  c.priors[1] = rig::fixed(0.3);
  c.measurement_count = 2;
  for (std::uint32_t i = 0; i < 2; ++i) {
    c.measured_state[i] = i;
    c.measurement_sd[i] = 1e-3;
  }
  c.posterior.kind = engine == kBank ? std::uint32_t{tiller_posterior_transition} : engine;
  c.posterior.delay_hypotheses = engine == kBank ? 2 : 1;
  c.posterior.forgetting_count = 1;
  c.posterior.forgetting[0] = 1.0;
  return c;
}

tiller::Transition steady(double input = 0.5) {
  tiller::Transition t;
  t.period_s = 0.05;
  t.input[0] = input;
  return t;
}

class Edges : public ::testing::TestWithParam<std::uint32_t> {
 protected:
  Edges() : config(config_of(GetParam())), posterior(config, nullptr, whole_table()) {}
  /// Twenty transitions of a gain of 1.2.
  void learn() {
    const double first[2] = {0.0, 0.0};
    ASSERT_EQ(posterior->start(first), tiller_status_ok);
    double x = 0.0, v = 0.0;
    for (int k = 0; k < 20; ++k) {
      tiller::Transition t = steady(k % 4 < 2 ? 1.0 : -1.0);
      x += 0.05 * v;
      v += 0.05 * (1.2 * t.input[0] - 0.3 * v);
      t.measured[0] = x;
      t.measured[1] = v;
      ASSERT_TRUE(rig::works(posterior->update(t))) << k;
    }
  }
  std::vector<double> present() {
    std::vector<double> all(8);
    posterior->moments(&all[0], &all[2], &all[4], &all[6]);
    all.push_back(posterior->quantile(0, 0.3));
    return all;
  }
  tiller::Config config;
  Instance posterior;
};

INSTANTIATE_TEST_SUITE_P(Engines, Edges, ::testing::Range(std::uint32_t{0}, kBank + 1), [](const auto& p) {
  return p.param == kBank ? std::string("bank") : std::string(tiller::posterior_name(p.param));
});

TEST_P(Edges, AQuantileIsOfAParameterAndBetweenZeroAndOne) {
  learn();
  EXPECT_TRUE(std::isnan(posterior->quantile(config.param_count, 0.5)));
  for (const double q : {-1e-9, 1.0 + 1e-9, std::nan("")}) EXPECT_TRUE(std::isnan(posterior->quantile(0, q))) << q;
  for (const double q : {0.0, 0.5, 1.0}) {
    EXPECT_TRUE(std::isfinite(posterior->quantile(0, q))) << q;
    EXPECT_EQ(posterior->quantile(1, q), 0.3) << "what is known";
  }
  EXPECT_LE(posterior->quantile(0, 0.0), posterior->quantile(0, 0.2));
  EXPECT_LE(posterior->quantile(0, 0.8), posterior->quantile(0, 1.0));
}

TEST_P(Edges, ReadsFillWhatIsAskedForAndNothingElse) {
  learn();
  const std::uint32_t n = posterior->size();
  double params[2] = {7.0, 7.0}, state[2] = {7.0, 7.0}, weight = 7.0;
  posterior->particle(n, params, state, &weight);
  for (const double v : {params[0], params[1], state[0], state[1], weight}) EXPECT_EQ(v, 7.0) << "no such particle";
  posterior->particle(0, nullptr, nullptr, nullptr);
  double alone[2], whole[2], rest[2], total = 0.0;
  posterior->particle(n - 1, whole, state, &weight);
  posterior->particle(n - 1, alone, nullptr, nullptr);
  EXPECT_EQ(std::memcmp(alone, whole, sizeof whole), 0);
  posterior->particle(n - 1, nullptr, rest, nullptr);
  EXPECT_EQ(std::memcmp(rest, state, sizeof state), 0);
  for (std::uint32_t i = 0; i < n; ++i) {
    double each = 0.0;
    posterior->particle(i, nullptr, nullptr, &each);
    total += each;
  }
  EXPECT_NEAR(total, 1.0, 1e-9);
  posterior->moments(nullptr, nullptr, nullptr, nullptr);
  double mean[2], sd[2], one[2];
  posterior->moments(mean, sd, nullptr, nullptr);
  posterior->moments(one, nullptr, nullptr, nullptr);
  EXPECT_EQ(std::memcmp(one, mean, sizeof mean), 0);
  posterior->moments(nullptr, one, nullptr, nullptr);
  EXPECT_EQ(std::memcmp(one, sd, sizeof sd), 0);
  posterior->moments(nullptr, nullptr, mean, sd);
  posterior->moments(nullptr, nullptr, one, nullptr);
  EXPECT_EQ(std::memcmp(one, mean, sizeof mean), 0);
}

/// A single draw is the mean; parts of a draw are those of the whole.
TEST_P(Edges, ADrawGivesTheRowsThatAreAskedFor) {
  learn();
  double mean[2], state_mean[2];
  posterior->moments(mean, nullptr, state_mean, nullptr);
  float params[2], state[2];
  posterior->draw(1, 3, params, state, nullptr, nullptr);
  EXPECT_FLOAT_EQ(params[0], static_cast<float>(mean[0]));
  EXPECT_FLOAT_EQ(params[1], 0.3f);
  EXPECT_NEAR(state[0], state_mean[0], 1e-6);
  posterior->draw(1, 3, nullptr, nullptr, nullptr, nullptr);
  float all[16], again[16], states[16];
  posterior->draw(8, 4, all, states, nullptr, nullptr);
  posterior->draw(8, 4, again, nullptr, nullptr, nullptr);
  EXPECT_EQ(std::memcmp(again, all, sizeof all), 0);
  posterior->draw(8, 4, nullptr, again, nullptr, nullptr);
  EXPECT_EQ(std::memcmp(again, states, sizeof states), 0);
  const double origin[TILLER_MAX_STATES] = {2.0, -1.0};
  posterior->set_origin(origin);
  posterior->draw(8, 4, nullptr, again, nullptr, nullptr);
  for (int k = 0; k < 8; ++k) {
    EXPECT_NEAR(again[k], states[k] - 2.0f, 1e-5) << k;
    EXPECT_NEAR(again[8 + k], states[8 + k] + 1.0f, 1e-5) << k;
  }
}

TEST_P(Edges, WhatIsRefusedChangesNothing) {
  EXPECT_EQ(posterior->update(steady()), tiller_status_wrong_state);
  EXPECT_EQ(posterior->skip(steady()), tiller_status_wrong_state);
  const double endless[2] = {0.0, HUGE_VAL};
  EXPECT_EQ(posterior->start(endless), tiller_status_sensor_not_finite);
  EXPECT_FALSE(posterior->started());
  learn();
  const std::vector<double> before = present();
  const struct {
    tiller_status_t status;
    void (*spoil)(tiller::Transition&);
    bool of_measurement;
  } cases[] = {{tiller_status_time_backwards, [](tiller::Transition& t) { t.period_s = 0.0; }, false},
               {tiller_status_time_backwards, [](tiller::Transition& t) { t.period_s = -0.05; }, false},
               {tiller_status_bad_period, [](tiller::Transition& t) { t.period_s = NAN; }, false},
               {tiller_status_bad_period, [](tiller::Transition& t) { t.period_s = 0.51; }, false},
               {tiller_status_command_not_finite, [](tiller::Transition& t) { t.input[0] = NAN; }, false},
               {tiller_status_command_not_finite, [](tiller::Transition& t) { t.input[0] = -HUGE_VAL; }, false},
               {tiller_status_sensor_not_finite, [](tiller::Transition& t) { t.measured[1] = HUGE_VAL; }, true}};
  for (const auto& c : cases) {
    tiller::Transition t = steady();
    c.spoil(t);
    EXPECT_EQ(posterior->update(t), c.status);
    EXPECT_EQ(present(), before) << c.status;
    if (c.of_measurement) continue;
    EXPECT_EQ(posterior->skip(t), c.status);
    EXPECT_EQ(present(), before) << c.status;
  }
}

/// The state moves on under the input, the parameters stay, and what is not measured is not read.
TEST_P(Edges, APeriodWithoutAMeasurementTeachesNothing) {
  learn();
  const std::vector<double> before = present();
  tiller::Transition t = steady(0.0);
  t.measured[0] = HUGE_VAL;
  EXPECT_EQ(posterior->skip(t), tiller_status_ok);
  const std::vector<double> after = present();
  for (int i = 0; i < 4; ++i)
    EXPECT_NEAR(after[static_cast<std::size_t>(i)], before[static_cast<std::size_t>(i)], 1e-12);
  EXPECT_NEAR(after[4], before[4] + 0.05 * before[5], 1e-4);
  EXPECT_GE(after[6], before[6]) << "and is less certain";
  t.measured[0] = t.measured[1] = NAN;  // an update that measures nothing moves the state as well
  EXPECT_TRUE(rig::works(posterior->update(t)));
  EXPECT_NEAR(present()[4], after[4] + 0.05 * after[5], 1e-4);
}

TEST_P(Edges, AnEngineRefusesWhatItDoesNotKnow) {
  const tiller::PosteriorTable& engine = *tiller::find_posterior(config.posterior.kind);
  tiller::StepSetup setup;
  setup.period_s = 0.05;
  const auto refused = [&](void (*ask)(tiller::Config&)) -> std::string {
    tiller::Config c = config;
    ask(c);
    const char* field = "";
    const tiller_status_t status = tiller::Posterior::check(c, setup, whole_table(), &field);
    return status == tiller_status_ok ? "" : field;
  };
  EXPECT_EQ(refused([](tiller::Config&) {}), "");
  EXPECT_EQ(refused([](tiller::Config& c) { c.posterior.kind = tiller_posterior_kind_count; }), "posterior.kind");
  const auto expect = [&](bool knows, const char* field, void (*ask)(tiller::Config&)) {
    EXPECT_EQ(refused(ask), knows ? "" : field);
  };
  expect(engine.hypotheses, "posterior.delay_hypotheses", [](tiller::Config& c) { c.posterior.delay_hypotheses = 2; });
  expect(engine.hypotheses, "posterior.forgetting", [](tiller::Config& c) { c.posterior.forgetting_count = 2; });
  if (!engine.disturbances) {
    EXPECT_EQ(refused([](tiller::Config& c) { c.posterior.disturbance = 1; }), "posterior.disturbance");
  }
  if (!engine.drifts) {
    EXPECT_EQ(refused([](tiller::Config& c) { c.posterior.drift = 1; }), "posterior.drift");
  }
}

TEST(Engines, AKindThatThereIsNotHasNothing) {
  constexpr std::uint32_t kNone = tiller_posterior_kind_count;
  EXPECT_EQ(tiller::find_posterior(kNone), nullptr);
  EXPECT_EQ(tiller::posterior_name(kNone), nullptr);
  EXPECT_EQ(tiller::posterior_help(kNone), nullptr);
  tiller::Config c = config_of(tiller_posterior_filter);
  c.posterior.kind = kNone;
  EXPECT_EQ(tiller::Posterior::force_joints(c), 0u);
  EXPECT_EQ(tiller::Posterior::slip_states(c), 0u);
  tiller::Arena measure;
  EXPECT_EQ(tiller::Posterior::lay_out(measure, c, {}, whole_table(), nullptr), nullptr);
  EXPECT_EQ(measure.used(), 0u);
}

/// A block that is a little short makes no posterior, and nothing is written behind it.
TEST_P(Edges, ABlockThatIsShortMakesNone) {
  tiller::StepSetup setup;
  setup.period_s = 0.05;
  const std::size_t size = posterior.size();
  std::vector<unsigned char> block(size + 128, 0xAB);
  void* start = block.data();
  std::size_t space = block.size();
  auto* base = static_cast<unsigned char*>(std::align(64, size, start, space));
  tiller::Arena arena(base, size - 1);
  EXPECT_EQ(tiller::Posterior::lay_out(arena, config, setup, whole_table(), nullptr), nullptr);
  EXPECT_FALSE(arena.fits());
  EXPECT_EQ(base[size - 1], 0xAB);
}

}  // namespace
