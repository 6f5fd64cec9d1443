// Forces that a model lacks: parameters whose intervals stay honest beside them, and the forces as they were.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "driven_pendulum_rig.hpp"

namespace {

using Plant = rig::DrivenPendulum;

constexpr double kPeriod_s = Plant::kPeriod_s;
constexpr int kSeeds = 12, kSteps = 500;

tiller::Config pendulum(bool discrepancy) {
  tiller::Config c = Plant::config(rig::uniform(0.25, 0.75));
  c.posterior.disturbance = discrepancy ? 1 : 0;
  return c;
}

/// A force of the world's at a time, in N m.
using World = std::function<double(double time_s)>;

World nothing(unsigned) {
  return [](double) { return 0.0; };
}
World constant(unsigned seed) {
  const double force = seed % 2 ? 0.7 : -0.7;
  return [force](double) { return force; };
}
/// Ornstein and Uhlenbeck's, of 0.2 N m and 1 s, drawn every 10 ms and held.
World gusts(unsigned seed) {
  std::mt19937_64 random(1000 + seed);
  std::normal_distribution<double> n;
  std::vector<double> drawn = {n(random)};
  const double keep = std::exp(-0.01);
  while (drawn.size() < 1200) drawn.push_back(keep * drawn.back() + std::sqrt(1.0 - keep * keep) * n(random));
  return [drawn](double t) { return 0.2 * drawn[static_cast<std::size_t>(100.0 * t)]; };
}

struct Outcome {
  bool holds = false;
  double width = 0.0, force_error = 0.0, force_rms = 0.0;
};

/// Ten seconds. Errors of the force are those of the second half.
Outcome learn(bool discrepancy, const World& world, unsigned seed) {
  Plant plant;
  plant.steps = kSteps;
  plant.force_Nm = world;
  Outcome outcome;
  plant.run(pendulum(discrepancy), seed, [&](const tiller::Posterior& posterior, int k, double mass_kg) {
    if (k == kSteps) {
      const double low = posterior.quantile(0, 0.05), high = posterior.quantile(0, 0.95);
      outcome.holds = low <= mass_kg && mass_kg <= high;
      outcome.width = high - low;
      return;
    }
    if (!discrepancy || 2 * k < kSteps) return;
    double force = 0.0;
    (void)posterior.forces(0.0, &force, nullptr);
    const double is = world((k + 1) * kPeriod_s);
    outcome.force_error += (force - is) * (force - is);
    outcome.force_rms += is * is;
  });
  outcome.force_error = std::sqrt(outcome.force_error / (0.5 * kSteps));
  outcome.force_rms = std::sqrt(outcome.force_rms / (0.5 * kSteps));
  return outcome;
}

struct Sums {
  int hold = 0;
  double width = 0.0, force_error = 0.0, force_rms = 0.0;
};

Sums over_seeds(bool discrepancy, World (*world)(unsigned), const char* name) {
  Sums sums;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Outcome one = learn(discrepancy, world(seed), seed);
    sums.hold += one.holds ? 1 : 0;
    sums.width += one.width / kSeeds;
    sums.force_error += one.force_error / kSeeds;
    sums.force_rms += one.force_rms / kSeeds;
  }
  std::printf("%s, %s: %d of %d intervals of the mass hold, %.4f kg wide", name,
              discrepancy ? "with forces" : "without", sums.hold, kSeeds, sums.width);
  if (discrepancy) std::printf("; force off by %.3f of %.3f N m", sums.force_error, sums.force_rms);
  std::printf("\n");
  return sums;
}

// Of twelve 90 % intervals fewer than eight hold in 4 of 1,000 cases; of intervals that hold one time in three eight or
// more do in 2 of 100.
constexpr int kHonest = 8, kWrong = 7;

TEST(Forces, AConstantForceDoesNotMakeAWrongMassCertain) {
  const Sums with = over_seeds(true, constant, "constant"), without = over_seeds(false, constant, "constant");
  EXPECT_GE(with.hold, kHonest);
  EXPECT_LE(without.hold, kWrong) << "or the test shows nothing";
  EXPECT_LT(with.force_error, 0.25 * with.force_rms);
}

TEST(Forces, NorDoGusts) {
  const Sums with = over_seeds(true, gusts, "gusts"), without = over_seeds(false, gusts, "gusts");
  EXPECT_GE(with.hold, kHonest);
  EXPECT_LE(without.hold, kWrong) << "or the test shows nothing";
  EXPECT_LT(with.force_error, 0.75 * with.force_rms);
}

TEST(Forces, AWorldWithoutThemIsLearntAlmostAsWell) {
  const Sums with = over_seeds(true, nothing, "nothing"), without = over_seeds(false, nothing, "nothing");
  EXPECT_GE(with.hold, kHonest);
  EXPECT_GE(without.hold, kHonest);
  EXPECT_LT(with.width, 2.0 * without.width);
  EXPECT_LT(with.force_error, 0.01);
}

/// A drone that hovers level while a wind blows along x, 0.3 N: six joints have forces, the plant's own equations are
/// two (Euler and Cromer, 1 ms).
TEST(Forces, AWindThatPushesADroneIsNoMass) {
  tiller::Config c;
  ASSERT_EQ(tiller_config_default(&c, tiller_find_model("quadrotor")), tiller_status_ok);
  c.period_s = kPeriod_s;
  const double known[] = {0.8, 0.15, 0.004, 0.004, 0.008, 0.02, 0.0};
  for (int i = 0; i < 7; ++i) c.priors[i] = rig::fixed(known[i]);
  c.priors[0] = rig::uniform(0.5, 1.1);
  c.measurement_count = 7;
  for (std::uint32_t i = 0; i < 7; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    c.measurement_sd[i] = 0.002;
  }
  for (std::uint32_t i = 7; i < 13; ++i) c.process_sd[i] = 0.02;
  for (std::uint32_t i = 0; i < 13; ++i) c.initial_state_sd[i] = 0.01;
  c.initial_state[3] = 1.0;
  for (int i = 0; i < 4; ++i) c.safety.input_high[i] = 4.0;
  c.posterior.adequacy = 0;
  c.posterior.disturbance = 1;
  ASSERT_EQ(tiller::Posterior::force_joints(c), 6u);

  tiller::StepSetup setup;
  ASSERT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  rig::Instance posterior(c, nullptr, tiller::select_rollout(*c.model), &setup);
  std::mt19937_64 random(1);
  std::normal_distribution<double> n;
  double place[3] = {}, speed[3] = {};
  tiller::Transition transition;
  const auto measure = [&](double* to) {
    for (int i = 0; i < 3; ++i) to[i] = place[i] + 0.002 * n(random);
    to[3] = 1.0;
    for (int i = 4; i < 7; ++i) to[i] = 0.002 * n(random);
  };
  measure(transition.measured);
  ASSERT_EQ(posterior->start(transition.measured), tiller_status_ok);
  for (int k = 0; k < 200; ++k) {
    const double thrust = known[0] * Plant::kGravity_m_s2 + 0.8 * std::sin(0.15 * k);
    for (int i = 0; i < 20; ++i) {
      speed[0] += 1e-3 * 0.3 / known[0];
      speed[2] += 1e-3 * (thrust / known[0] - Plant::kGravity_m_s2);
      for (int x = 0; x < 3; ++x) place[x] += 1e-3 * speed[x];
    }
    transition.period_s = kPeriod_s;
    for (int i = 0; i < 4; ++i) transition.input[i] = 0.25 * thrust;
    measure(transition.measured);
    ASSERT_TRUE(rig::works(posterior->update(transition)));
  }
  double force[6], sd[6];
  (void)posterior->forces(0.0, force, sd);
  for (int j = 0; j < 6; ++j) std::printf("force %d: %.3f +- %.3f\n", j, force[j], sd[j]);
  EXPECT_NEAR(force[0], 0.3, 0.1);
  EXPECT_NEAR(force[0], 0.3, 4.0 * sd[0]);
  EXPECT_NEAR(force[1], 0.0, 4.0 * sd[1]);
  EXPECT_LE(posterior->quantile(0, 0.005), known[0]);
  EXPECT_GE(posterior->quantile(0, 0.995), known[0]);
}

constexpr double kSlope_m_s = 0.04;

/// A base that a slope pulls along x while it drives in circles.
Outcome drive(bool slips, unsigned seed) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("skid_steer")), tiller_status_ok);
  c.period_s = 0.05;
  c.priors[0] = rig::uniform(0.08, 0.12);
  c.priors[1] = rig::uniform(0.4, 0.9);
  c.priors[2] = rig::fixed(0.0);
  c.measurement_count = 3;
  for (std::uint32_t i = 0; i < 3; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    c.measurement_sd[i] = 0.004;
    c.process_sd[i] = 0.005;
    c.initial_state_sd[i] = 0.01;
  }
  for (int i = 0; i < 2; ++i) {
    c.safety.input_low[i] = -12.0;
    c.safety.input_high[i] = 12.0;
  }
  c.posterior.adequacy = 0;
  c.posterior.disturbance = slips ? 1 : 0;
  EXPECT_EQ(tiller::Posterior::force_joints(c), 0u);
  EXPECT_EQ(tiller::Posterior::slip_states(c), slips ? 7u : 0u);
  tiller::StepSetup setup;
  EXPECT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  rig::Instance posterior(c, nullptr, tiller::select_rollout(*c.model), &setup);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  std::uniform_real_distribution<double> u01;
  const double radius = 0.09 + 0.02 * u01(random), axle = 0.5 + 0.2 * u01(random);
  double x = 0.0, y = 0.0, heading = 0.0;
  const double first[] = {0.004 * n(random), 0.004 * n(random), 0.004 * n(random)};
  EXPECT_EQ(posterior->start(first), tiller_status_ok);
  // half a circle more or less, so that the pull does not average out
  for (int k = 0; k < 160; ++k) {
    const double left = 4.0 + std::sin(0.3 * k), right = 7.0 + std::sin(0.2 * k);
    for (int i = 0; i < 50; ++i) {
      heading += 1e-3 * radius * (right - left) / axle;
      x += 1e-3 * (0.5 * radius * (left + right) * std::cos(heading) + kSlope_m_s);
      y += 1e-3 * 0.5 * radius * (left + right) * std::sin(heading);
    }
    tiller::Transition transition;
    transition.period_s = 0.05;
    transition.input[0] = left;
    transition.input[1] = right;
    transition.measured[0] = x + 0.004 * n(random);
    transition.measured[1] = y + 0.004 * n(random);
    transition.measured[2] = heading + 0.004 * n(random);
    EXPECT_TRUE(rig::works(posterior->update(transition)));
  }
  const double low = posterior->quantile(0, 0.05), high = posterior->quantile(0, 0.95);
  Outcome outcome;
  outcome.holds = low <= radius && radius <= high;
  outcome.width = high - low;
  double slip[3] = {}, sd[3] = {};
  (void)posterior->forces(0.0, slip, sd);
  outcome.force_error = std::fabs(slip[0] - kSlope_m_s);
  if (slips) {
    EXPECT_LT(outcome.force_error, 4.0 * sd[0]) << "seed " << seed;
    EXPECT_LT(std::fabs(slip[1]), 4.0 * sd[1]) << "seed " << seed;
    EXPECT_LT(std::fabs(slip[2]), 4.0 * sd[2]) << "seed " << seed;
  }
  return outcome;
}

/// What no slip explains is noise of the process, which leaves the wheels less sure.
TEST(Forces, ASlipIsNeitherWheelNorNoise) {
  int hold = 0;
  double with = 0.0, without = 0.0, off = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Outcome slips = drive(true, seed);
    off += slips.force_error / kSeeds;
    hold += slips.holds ? 1 : 0;
    with += slips.width / kSeeds;
    without += drive(false, seed).width / kSeeds;
  }
  std::printf("a slope: %d of %d intervals of the wheel's radius hold with slips, %.5f m wide, without %.5f\n", hold,
              kSeeds, with, without);
  std::printf("the slip is off by %.4f of %.2f m/s\n", off, kSlope_m_s);
  EXPECT_GE(hold, kHonest);
  EXPECT_LT(with, 0.8 * without);
}

/// Where nobody looks for forces none are told, and there is no joint that has any.
TEST(Forces, AreThoseOfTheFirstJoints) {
  EXPECT_EQ(tiller::Posterior::force_joints(pendulum(false)), 0u);
  EXPECT_EQ(tiller::Posterior::force_joints(pendulum(true)), 1u);
  tiller::Config other = pendulum(true);
  other.posterior.kind = tiller_posterior_transition;
  EXPECT_EQ(tiller::Posterior::force_joints(other), 0u) << "its coefficients are regressed, not states";
}

}  // namespace
