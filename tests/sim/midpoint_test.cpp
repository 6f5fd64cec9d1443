#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

PlantOptions moving(const std::string& kind, double step_s) {
  PlantOptions o;
  o.kind = kind;
  o.step_s = step_s;
  o.watchdog_timeout_s = 0;
  if (kind == "pendulum") o.initial_state = {{"angle_rad", 0.5}, {"rate_rad_s", 5}};
  if (kind == "cart_pole") o.initial_state = {{"angle_rad", 2.5}, {"rate_rad_s", 4}};
  if (kind == "acrobot" || kind == "two_link_arm")
    o.initial_state = {{"shoulder_rad", 0.5}, {"elbow_rad", 1}, {"elbow_rad_s", -2}};
  if (kind == "planar_quadrotor") o.initial_state = {{"tilt_rad", 0.3}, {"x_m_s", 2}, {"tilt_rad_s", 3}};
  if (kind == "quadrotor") o.initial_state = {{"x_m_s", 2}, {"roll_rad_s", 3}, {"pitch_rad_s", -2}, {"yaw_rad_s", 4}};
  return o;
}

/// States after a second under commands that keep changing.
std::vector<double> end_of(const PlantOptions& options) {
  auto plant = make(options);
  std::vector<double> u(plant->commands().size());
  const double reach = options.kind == "quadrotor" ? 0.1 : 0.5;  // N; half a newton spins it up to 50 rad/s
  for (int k = 0; k < 100; ++k) {
    for (std::size_t i = 0; i < u.size(); ++i) u[i] = reach * std::sin(0.07 * k + static_cast<double>(i));
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
  const auto fine = end_of(moving(GetParam(), 5e-5));
  const double coarse = apart(end_of(moving(GetParam(), 1e-3)), fine);
  const double half = apart(end_of(moving(GetParam(), 5e-4)), fine);
  // 4 for second order; the reference's own error is 1 % of the half step's
  EXPECT_NEAR(coarse / half, 4.0, 0.3) << coarse << " " << half;
  // what the worlds' noises must not show: a third of 3e-4
  EXPECT_LT(half, 1e-4);
}

TEST_P(Midpoint, RepeatsToTheLastBit) {
  const PlantOptions o = moving(GetParam(), 5e-4);
  EXPECT_EQ(end_of(o), end_of(o));
  auto plant = make(o);
  plant->advance(0.3);
  const auto first = truth(*plant);
  plant->reset();
  plant->advance(0.3);
  EXPECT_EQ(truth(*plant), first);
}

TEST_P(Midpoint, KeepsEnergyWithoutFriction) {
  auto plant = make(moving(GetParam(), 5e-4));
  const double start = plant->energy_J();
  double worst = 0;
  for (int k = 0; k < 1000; ++k) {
    plant->advance(0.01);
    worst = std::max(worst, std::fabs(plant->energy_J() - start));
  }
  // ODE's own steps lose 3e-3 J and more here; a quadrotor falls for 10 s, through 6 kJ
  EXPECT_LT(worst, 2e-4);
}

INSTANTIATE_TEST_SUITE_P(Plants, Midpoint,
                         ::testing::Values("pendulum", "cart_pole", "acrobot", "two_link_arm", "planar_quadrotor",
                                           "quadrotor"));

TEST(MidpointSteps, HoldAStuckJointExactly) {
  PlantOptions o = cart_pole();
  o.effects = {{"coulomb_friction", "", {{"friction_SI", 2.0}}}};
  auto plant = make(o);
  command(*plant, 1.99);
  plant->advance(5.0);
  EXPECT_LT(std::fabs(truth(*plant)[0]), 1e-9);
  EXPECT_LT(std::fabs(truth(*plant)[2]), 1e-9);
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
