#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

TEST(Encoder, WithoutErrorsShowsTheTruth) {
  auto plant = make(cart_pole());
  command(*plant, 3.0);
  plant->advance(0.7);
  const auto x = truth(*plant), y = reading(*plant);
  ASSERT_EQ(y.size(), 2u);
  EXPECT_EQ(y[0], x[0]);
  EXPECT_EQ(y[1], x[1]);
}

TEST(Encoder, QuantisationLiesOnTheGridAndNearTheTruth) {
  const double step = 2 * 3.141592653589793 / 4096;
  PlantOptions o = cart_pole();
  o.encoder_step["angle_rad"] = step;
  auto plant = make(o);
  command(*plant, 5.0);
  int distinct = 0;
  double before = 0;
  for (int i = 0; i < 300; ++i) {
    plant->advance(0.005);
    const double seen = reading(*plant)[1], marks = seen / step;
    ASSERT_NEAR(marks, std::round(marks), 1e-9);
    ASSERT_LE(std::fabs(seen - truth(*plant)[1]), step / 2 * (1 + 1e-9));
    ASSERT_EQ(reading(*plant)[0], truth(*plant)[0]);  // the other channel has no such step
    distinct += seen != before;
    before = seen;
  }
  EXPECT_GT(distinct, 100);
}

TEST(Encoder, NoiseHasTheDeviationAsked) {
  const double sd = 0.003;
  PlantOptions o = cart_pole();
  o.encoder_noise_sd["angle_rad"] = sd;
  auto plant = make(o);
  const int n = 4000;
  double sum = 0, square = 0, lag_one = 0, before = 0;
  for (int i = 0; i < n; ++i) {
    plant->advance(0.001);
    const double e = reading(*plant)[1] - truth(*plant)[1];
    sum += e;
    square += e * e;
    lag_one += e * before;
    before = e;
  }
  // n s^2 / sd^2 is chi-square with n degrees: relative deviation sqrt(2 / n) = 2.2 %; four of them pass for
  // all but one seed in 16,000, and the seed is fixed. Mean and lag-one correlation: 1 / sqrt(n), same four.
  EXPECT_NEAR(square / n / (sd * sd), 1, 4 * std::sqrt(2.0 / n));
  EXPECT_NEAR(sum / n / sd, 0, 4 / std::sqrt(n));
  EXPECT_NEAR(lag_one / n / (sd * sd), 0, 4 / std::sqrt(n));
}

TEST(Encoder, ReadingTwiceGivesOneValue) {
  PlantOptions o = cart_pole();
  o.encoder_noise_sd = {{"angle_rad", 0.01}, {"position_m", 0.01}};
  auto plant = make(o);
  plant->advance(0.1);
  EXPECT_EQ(reading(*plant), reading(*plant));
}

TEST(Encoder, NoiseOfOneChannelLeavesTheOtherAlone) {
  PlantOptions one = cart_pole();
  one.encoder_noise_sd["angle_rad"] = 0.01;
  PlantOptions both = one;
  both.encoder_noise_sd["position_m"] = 0.01;
  auto a = make(one), b = make(both);
  for (int i = 0; i < 50; ++i) {
    a->advance(0.01);
    b->advance(0.01);
    ASSERT_EQ(reading(*a)[1], reading(*b)[1]);
    ASSERT_NE(reading(*a)[0], reading(*b)[0]);
    ASSERT_NE(reading(*b)[0] - truth(*b)[0], reading(*b)[1] - truth(*b)[1]);
  }
}

TEST(Encoder, LatencyShowsThePast) {
  const double latency_s = 0.012;
  PlantOptions o = cart_pole();
  o.measurement_latency_s = latency_s;
  auto plant = make(o);
  command(*plant, 4.0);
  std::vector<double> angles = {truth(*plant)[1]};
  for (int i = 1; i <= 400; ++i) {
    plant->advance(0.001);
    angles.push_back(truth(*plant)[1]);
    const int shown = std::max(0, i - 12);
    ASSERT_EQ(plant->measured_us(), (i - 12) * 1000);
    ASSERT_EQ(reading(*plant)[1], angles[static_cast<std::size_t>(shown)]) << i;
  }
}

TEST(Encoder, LatencyBetweenPhysicsStepsInterpolates) {
  PlantOptions o = cart_pole();
  o.measurement_latency_s = 0.00275;  // 5.5 steps of 0.5 ms
  auto plant = make(o);
  command(*plant, 4.0);
  plant->advance(0.2);
  auto twin = make(cart_pole());
  command(*twin, 4.0);
  twin->advance(0.197);
  const double before = truth(*twin)[0];
  twin->advance(0.0005);
  const double after = truth(*twin)[0];
  EXPECT_NEAR(reading(*plant)[0], (before + after) / 2, 1e-12);
}

TEST(ProcessNoise, MovesTheCartAsARandomWalkOfMomentum) {
  // momentum after t is the sum of t / 1 ms independent impulses: deviation sd * 1 ms * sqrt(t / 1 ms)
  const double sd = 5.0, t = 0.5;
  double square = 0;
  const int runs = 200;
  for (int seed = 1; seed <= runs; ++seed) {
    PlantOptions o = cart_pole();
    o.step_s = 0.001;
    o.process_noise_sd = sd;
    o.seed = static_cast<std::uint64_t>(seed);
    auto plant = make(o);
    plant->advance(t);
    const auto x = truth(*plant);
    const double momentum = 1.1 * x[2] + 0.05 * std::cos(x[1]) * x[3];
    square += momentum * momentum;
  }
  const double expected = sd * 0.001 * std::sqrt(t / 0.001);
  // chi-square again: 200 runs, relative deviation 10 %, four of them
  EXPECT_NEAR(square / runs / (expected * expected), 1, 0.4);
}

TEST(ProcessNoise, IsTheSameForceAtAFinerStep) {
  PlantOptions coarse = cart_pole();
  coarse.process_noise_sd = 5;
  coarse.step_s = 0.001;
  PlantOptions fine = coarse;
  fine.step_s = 0.0005;
  auto a = make(coarse), b = make(fine);
  a->advance(1.0);
  b->advance(1.0);
  EXPECT_NEAR(truth(*a)[2], truth(*b)[2], 2e-3);  // first-order difference; another draw would give 0.15
}

std::vector<double> noisy_run(std::uint64_t seed) {
  PlantOptions o = cart_pole();
  o.seed = seed;
  o.encoder_noise_sd = {{"angle_rad", 0.01}, {"position_m", 0.002}};
  o.process_noise_sd = 1;
  auto plant = make(o);
  std::vector<double> all;
  for (int i = 0; i < 100; ++i) {
    const double u = 3 * std::sin(0.2 * i);
    plant->apply(&u);
    plant->advance(0.01);
    for (const double y : reading(*plant)) all.push_back(y);
  }
  return all;
}

TEST(Seed, SameSeedSameBitsOtherSeedOtherNoise) {
  EXPECT_EQ(noisy_run(7), noisy_run(7));
  const auto a = noisy_run(7), b = noisy_run(8);
  for (std::size_t i = 0; i < a.size(); ++i) ASSERT_NE(a[i], b[i]);
}

TEST(Seed, ResetRepeatsTheRun) {
  PlantOptions o = cart_pole();
  o.encoder_noise_sd["angle_rad"] = 0.01;
  o.process_noise_sd = 2;
  o.effects = {{"actuator_lag", "", {{"time_constant_s", 0.03}}}, {"coulomb_friction", "", {{"friction_SI", 0.3}}}};
  auto plant = make(o);
  std::vector<double> first;
  for (int round = 0; round < 2; ++round) {
    for (int i = 0; i < 60; ++i) {
      command(*plant, 4 * std::sin(0.3 * i));
      plant->advance(0.01);
      if (round == 0) {
        first.push_back(reading(*plant)[1]);
      } else {
        ASSERT_EQ(reading(*plant)[1], first[static_cast<std::size_t>(i)]) << i;
      }
    }
    plant->reset();
    ASSERT_EQ(plant->time_us(), 0);
    ASSERT_EQ(motor(*plant), 0);
  }
}

}  // namespace
}  // namespace tiller::sim
