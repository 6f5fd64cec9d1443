// Parameters that drift: intervals that hold where a load is filled, and the evidence for it; and where nothing does.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <vector>

#include "linear_rig.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace {

constexpr double kLength_m = 0.5, kGravity_m_s2 = 9.81, kPeriod_s = 0.02;
constexpr int kSeeds = 12, kSteps = 750;

tiller::Config pendulum(bool drifts) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("pendulum")), tiller_status_ok);
  c.period_s = kPeriod_s;
  c.priors[0] = rig::log_normal(0.5, 0.4);
  c.priors[1] = rig::fixed(kLength_m);
  c.priors[2] = rig::uniform(0.0, 0.1);
  c.measurement_sd[0] = 0.002;
  c.process_sd[1] = 0.02;
  c.initial_state_sd[0] = c.initial_state_sd[1] = 0.01;
  c.safety.input_low[0] = -1.5;
  c.safety.input_high[0] = 1.5;
  c.posterior.drift = drifts ? 1 : 0;
  c.posterior.adequacy = 0;
  c.posterior.moves_per_tick = 16;
  return c;
}

/// The mass at a time as a share of what it was.
using Course = std::function<double(double time_s)>;

struct Outcome {
  bool holds = false;
  double width = 0.0, off = 0.0, evidence = 0.0;
};

/// Fifteen seconds of a pendulum with equations of its own (Euler and Cromer, 0.1 ms) whose mass changes, under a
/// torque of three lines, beside a posterior that reads its encoder: the interval of the mass as it is at the end.
Outcome learn(bool drifts, const Course& course, unsigned seed) {
  const tiller::Config c = pendulum(drifts);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  std::uniform_real_distribution<double> u01;
  const double first_kg = 0.35 + 0.3 * u01(random), damping = 0.01 + 0.08 * u01(random);
  double phase[3];
  for (double& p : phase) p = 6.283 * u01(random);
  double angle = 0.01 * n(random), rate = 0.01 * n(random);

  tiller::StepSetup setup;
  EXPECT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  rig::Instance posterior(c, nullptr, tiller::select_rollout(*c.model), &setup);
  const double first = angle + 0.002 * n(random);
  EXPECT_EQ(posterior->start(&first), tiller_status_ok);
  double mass = first_kg;
  for (int k = 0; k < kSteps; ++k) {
    const double t = k * kPeriod_s;
    double torque = 0.0;
    for (int i = 0; i < 3; ++i) torque += 0.4 * std::sin((1.3 + 2.1 * i) * t + phase[i]);
    for (int i = 0; i < 200; ++i) {
      mass = first_kg * course(t + 1e-4 * i);
      rate += 1e-4 * ((torque - damping * rate) / (mass * kLength_m * kLength_m) -
                      kGravity_m_s2 / kLength_m * std::sin(angle));
      angle += 1e-4 * rate;
    }
    tiller::Transition transition;
    transition.period_s = kPeriod_s;
    transition.input[0] = torque;
    transition.measured[0] = angle + 0.002 * n(random);
    EXPECT_TRUE(rig::works(posterior->update(transition)));
  }
  const double low = posterior->quantile(0, 0.05), high = posterior->quantile(0, 0.95);
  double mean[TILLER_MAX_PARAMS], sd[TILLER_MAX_PARAMS];
  posterior->moments(mean, sd, nullptr, nullptr);
  EXPECT_GT(mean[0], low);
  EXPECT_LT(mean[0], high);
  // of a normal law 3.3 deviations lie between these quantiles; a mixture's tails make that less or more
  EXPECT_GT(high - low, 2.0 * sd[0]);
  EXPECT_LT(high - low, 5.0 * sd[0]);
  tiller::PosteriorReport report;
  posterior->report(report);
  return {low <= mass && mass <= high, high - low, std::fabs(mean[0] - mass), report.drift_evidence[0]};
}

struct Sums {
  int hold = 0;
  double width = 0.0, off = 0.0, evidence = 0.0;
};

Sums over_seeds(bool drifts, const Course& course, const char* name) {
  Sums sums;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Outcome one = learn(drifts, course, seed);
    sums.hold += one.holds ? 1 : 0;
    sums.width += one.width / kSeeds;
    sums.off += one.off / kSeeds;
    sums.evidence += one.evidence / kSeeds;
  }
  std::printf("%s, %s: %d of %d intervals of the mass hold, %.4f kg wide, %.4f kg off; evidence %.2f\n", name,
              drifts ? "drifting" : "constant", sums.hold, kSeeds, sums.width, sums.off, sums.evidence);
  return sums;
}

double stays(double) { return 1.0; }
double fills(double t) { return 1.0 + 0.3 * t / (kSteps * kPeriod_s); }
double empties(double t) { return 1.0 - 0.3 * t / (kSteps * kPeriod_s); }
double is_loaded(double t) { return t < 7.5 ? 1.0 : 1.3; }

// Of twelve 90 % intervals fewer than eight hold in 4 of 1,000 cases; of intervals that hold one time in three eight or
// more do in 2 of 100.
constexpr int kHonest = 8, kWrong = 7;

TEST(Drift, AMassThatGrowsOrShrinksIsFollowed) {
  for (const Course& course : {Course(fills), Course(empties)}) {
    const Sums with = over_seeds(true, course, "30 % in 15 s"), without = over_seeds(false, course, "30 % in 15 s");
    EXPECT_GE(with.hold, kHonest);
    EXPECT_LE(without.hold, kWrong) << "or the test shows nothing";
    EXPECT_LT(with.off, 0.5 * without.off);
    EXPECT_GT(with.evidence, 1.0);
  }
}

TEST(Drift, ALoadThatIsPickedUpIsTakenIn) {
  const Sums with = over_seeds(true, is_loaded, "30 % at once"), without = over_seeds(false, is_loaded, "30 % at once");
  EXPECT_GE(with.hold, kHonest);
  EXPECT_LE(without.hold, kWrong) << "or the test shows nothing";
  EXPECT_GT(with.evidence, 1.0);
}

TEST(Drift, WhereNothingDriftsLittleIsLost) {
  const Sums with = over_seeds(true, stays, "nothing"), without = over_seeds(false, stays, "nothing");
  EXPECT_GE(with.hold, kHonest);
  EXPECT_GE(without.hold, kHonest);
  EXPECT_LT(with.off, 0.001);  // a few thousandths of the mass: fifteen seconds do not rule a slow drift out
  EXPECT_LT(with.evidence, 0.0);
}

TEST(Drift, IsAskedOfParametersThatAreLearnt) {
  const auto status = [](const tiller::Config& c) {
    const char* field = "";
    const tiller_status_t s = tiller_config_check(&c, &field);
    if (s != tiller_status_ok) {
      EXPECT_STREQ(field, "posterior.drift");
    }
    return s;
  };
  EXPECT_EQ(status(pendulum(true)), tiller_status_ok);
  tiller::Config known = pendulum(true), none = pendulum(true), other = pendulum(true), sensor = pendulum(true);
  known.posterior.drift = 2;  // the length
  EXPECT_EQ(status(known), tiller_status_bad_posterior);
  none.posterior.drift = 8;
  EXPECT_EQ(status(none), tiller_status_bad_posterior);
  other.posterior.kind = tiller_posterior_transition;
  EXPECT_EQ(status(other), tiller_status_bad_posterior);
  other.posterior.drift = 0;
  other.posterior.kind = tiller_posterior_conjugate;
  other.posterior.disturbance = 1;
  EXPECT_NE(tiller_config_check(&other, nullptr), tiller_status_ok) << "it estimates none";
  sensor.effects[sensor.effect_count++] = {tiller_effect_sensor_bias, 0};
  sensor.priors[sensor.param_count++] = rig::normal(0.0, 0.01);
  EXPECT_EQ(status(sensor), tiller_status_ok);
  sensor.posterior.drift = 8;
  EXPECT_EQ(status(sensor), tiller_status_bad_posterior) << "no state tells how a sensor reads";
}

}  // namespace
