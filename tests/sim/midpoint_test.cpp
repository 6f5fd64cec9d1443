#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

PlantOptions swinging(const std::string& kind, double step_s, bool midpoint) {
  PlantOptions o;
  o.kind = kind;
  o.step_s = step_s;
  o.midpoint = midpoint;
  o.watchdog_timeout_s = 0;
  if (kind == "pendulum") o.initial_state = {{"angle_rad", 0.5}, {"rate_rad_s", 5}};
  if (kind == "cart_pole") o.initial_state = {{"angle_rad", 2.5}, {"rate_rad_s", 4}};
  if (kind == "two_link_arm") o.initial_state = {{"shoulder_rad", 0.5}, {"elbow_rad", 1}, {"elbow_rad_s", -2}};
  return o;
}

/// States after a second under commands that keep changing.
std::vector<double> end_of(const PlantOptions& options) {
  auto plant = make(options);
  std::vector<double> u(plant->commands().size());
  for (int k = 0; k < 100; ++k) {
    for (std::size_t i = 0; i < u.size(); ++i) u[i] = 0.5 * std::sin(0.07 * k + static_cast<double>(i));
    plant->apply(u.data());
    plant->advance(0.01);
  }
  return truth(*plant);
}

double apart(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::fabs(a[i] - b[i]));
  return most;
}

class Midpoint : public ::testing::TestWithParam<const char*> {};

TEST_P(Midpoint, ErrorFallsWithTheSquareOfTheStep) {
  const auto fine = end_of(swinging(GetParam(), 5e-5, true));
  const double coarse = apart(end_of(swinging(GetParam(), 1e-3, true)), fine);
  const double half = apart(end_of(swinging(GetParam(), 5e-4, true)), fine);
  // 4 for second order; the reference's own error is 1 % of the half step's
  EXPECT_NEAR(coarse / half, 4.0, 0.3) << coarse << " " << half;
  // what the worlds' noises must not show: a third of 3e-4
  EXPECT_LT(half, 1e-4);
}

TEST_P(Midpoint, GoesWhereFinePlainStepsGo) {
  const auto midpoint = end_of(swinging(GetParam(), 1e-4, true));
  const auto once = end_of(swinging(GetParam(), 1e-4, false)), twice = end_of(swinging(GetParam(), 5e-5, false));
  std::vector<double> limit = twice;  // plain steps are of first order: this is their limit but for the second
  for (std::size_t i = 0; i < limit.size(); ++i) limit[i] += twice[i] - once[i];
  EXPECT_LT(apart(midpoint, limit), 1e-4);
  EXPECT_GT(apart(midpoint, once), 2 * apart(midpoint, limit));  // else the limit would say nothing
}

TEST_P(Midpoint, RepeatsToTheLastBit) {
  const PlantOptions o = swinging(GetParam(), 5e-4, true);
  EXPECT_EQ(end_of(o), end_of(o));
  auto plant = make(o);
  plant->advance(0.3);
  const auto first = truth(*plant);
  plant->reset();
  plant->advance(0.3);
  EXPECT_EQ(truth(*plant), first);
}

TEST_P(Midpoint, KeepsEnergyWithoutFriction) {
  auto plant = make(swinging(GetParam(), 5e-4, true));
  const double start = plant->energy_J();
  double worst = 0;
  for (int k = 0; k < 1000; ++k) {
    plant->advance(0.01);
    worst = std::max(worst, std::fabs(plant->energy_J() - start));
  }
  // plain steps lose 3e-3 J and more here (energy_test.cpp)
  EXPECT_LT(worst, 2e-4);
}

INSTANTIATE_TEST_SUITE_P(Plants, Midpoint, ::testing::Values("pendulum", "cart_pole", "two_link_arm"));

TEST(MidpointSteps, HoldAStuckJointExactly) {
  PlantOptions o = cart_pole();
  o.midpoint = true;
  o.effects = {{"coulomb_friction", "", {{"friction_SI", 2.0}}}};
  auto plant = make(o);
  command(*plant, 1.99);
  plant->advance(5.0);
  EXPECT_LT(std::fabs(truth(*plant)[0]), 1e-9);
  EXPECT_LT(std::fabs(truth(*plant)[2]), 1e-9);
}

TEST(MidpointSteps, AreRefusedWhereThereAreNone) {
  PlantOptions o;
  o.kind = "planar_quadrotor";
  o.midpoint = true;
  std::string error;
  EXPECT_EQ(Plant::make(o, error), nullptr);
  EXPECT_NE(error.find("midpoint"), std::string::npos) << error;
}

TEST(RateSensors, StandBehindThoseForPositions) {
  PlantOptions o = pendulum();
  o.rates = true;
  o.initial_state["rate_rad_s"] = 2.0;
  o.encoder_noise_sd["rate_rad_s"] = 0.1;
  auto plant = make(o);
  ASSERT_EQ(plant->measurements().size(), 2u);
  EXPECT_EQ(plant->measurements()[1].name, "rate_rad_s");
  EXPECT_NEAR(reading(*plant)[1], 2.0, 0.5);  // five deviations
  EXPECT_NE(reading(*plant)[1], 2.0);
  double clean[2];
  plant->measure_clean(clean);
  EXPECT_EQ(clean[1], 2.0);
}

TEST(StartTime, ProcessNoiseGoesByTheClock) {
  PlantOptions o = pendulum();
  o.midpoint = true;
  o.process_noise_sd = 1.0;
  auto whole = make(o);
  whole->advance(1.0);
  const auto x = truth(*whole);
  o.start_us = 1'000'000;
  o.initial_state = {{"angle_rad", x[0]}, {"rate_rad_s", x[1]}};
  auto rest = make(o);
  whole->advance(1.0);
  rest->advance(1.0);
  EXPECT_NEAR(truth(*rest)[0], truth(*whole)[0], 1e-9);
  EXPECT_EQ(rest->time_us(), 2'000'000);
}

}  // namespace
}  // namespace tiller::sim
