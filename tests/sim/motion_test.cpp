#include <cmath>

#include "plants.hpp"

// Closed formulas that any pendulum and any cart with a rod obey.

namespace tiller::sim {
namespace {

constexpr double pi = 3.141592653589793;

/// Mean period between the first and the last of n upward crossings of the given angle.
double period_s(Plant& plant, std::size_t angle, double centre_rad, int n) {
  const double h = plant.options().step_s;
  double first = -1, last = -1, before = truth(plant)[angle] - centre_rad;
  for (int crossings = 0; crossings <= n;) {
    plant.advance(h);
    const double now = truth(plant)[angle] - centre_rad;
    if (before < 0 && now >= 0) {
      last = 1e-6 * static_cast<double>(plant.time_us()) - h * now / (now - before);
      if (crossings++ == 0) first = last;
    }
    before = now;
    if (plant.time_us() > 120'000'000) return -1;
  }
  return (last - first) / n;
}

// At 0.02 rad the period is longer than at zero by angle^2 / 16 = 2.5e-5 of itself. The integrator shifts it
// by (omega h)^2 / 24 < 1e-6. 5e-5 holds both.
constexpr double amplitude_rad = 0.02;
constexpr double period_tolerance = 5e-5;

TEST(Motion, PendulumPeriod) {
  for (const double length_m : {0.2, 0.5, 1.3}) {
    PlantOptions o = pendulum();
    o.parameters["length_m"] = length_m;
    o.initial_state["angle_rad"] = amplitude_rad;
    auto plant = make(o);
    const double expected = 2 * pi * std::sqrt(length_m / 9.81);
    EXPECT_NEAR(period_s(*plant, 0, 0, 20) / expected, 1, period_tolerance) << length_m;
  }
}

TEST(Motion, PendulumPeriodDoesNotDependOnMass) {
  PlantOptions o = pendulum();
  o.initial_state["angle_rad"] = amplitude_rad;
  o.parameters["mass_kg"] = 0.1;
  const double light = period_s(*make(o), 0, 0, 5);
  o.parameters["mass_kg"] = 7;
  EXPECT_NEAR(period_s(*make(o), 0, 0, 5) / light, 1, 1e-9);  // rounding alone
}

TEST(Motion, HangingCartPolePeriod) {
  const double M = 1.2, m = 0.3, l = 0.4, g = 9.81;
  PlantOptions o = cart_pole();
  o.parameters = {{"cart_mass_kg", M}, {"pole_mass_kg", m}, {"half_length_m", l}};
  o.initial_state["angle_rad"] = pi + amplitude_rad;
  auto plant = make(o);
  // linear about hanging, cart free: phi'' = -g phi / (l (4/3 - m / (M + m)))
  const double omega = std::sqrt(g / (l * (4.0 / 3.0 - m / (M + m))));
  EXPECT_NEAR(period_s(*plant, 1, pi, 20) * omega / (2 * pi), 1, period_tolerance);
}

TEST(Motion, PoleFallsToTheSideItLeansTo) {
  PlantOptions o = cart_pole();
  o.initial_state["angle_rad"] = 0.05;
  auto plant = make(o);
  plant->advance(0.5);
  // grows as 0.05 cosh(3.9 t): 0.18 rad
  EXPECT_NEAR(truth(*plant)[1], 0.18, 0.02);
  EXPECT_LT(truth(*plant)[0], 0);  // nothing pushes sideways: the cart goes the other way
}

TEST(Motion, PushToTheRightLeansThePoleBack) {
  PlantOptions o = cart_pole();
  o.initial_state["angle_rad"] = 0;
  auto plant = make(o);
  command(*plant, 5);
  plant->advance(0.1);
  EXPECT_GT(truth(*plant)[0], 0);
  EXPECT_LT(truth(*plant)[1], 0);
}

TEST(Motion, PositiveTorqueTurnsThePendulumCounterClockwise) {
  auto plant = make(pendulum());
  command(*plant, 0.1);
  plant->advance(0.1);
  EXPECT_GT(truth(*plant)[0], 0);
}

// The rate after the first step is the instantaneous acceleration times the step, to rounding: 1e-9 relative
// leaves room for ODE's solver, ten digits are enough to tell any wrong formula.
constexpr double first_step_tolerance = 1e-9;

TEST(Motion, ForceOnTheCartWhilePoleIsUprightOrHangs) {
  const double M = 1.0, m = 0.1, F = 2.0;
  for (const double angle : {0.0, pi}) {
    PlantOptions o = cart_pole();
    o.initial_state["angle_rad"] = angle;
    auto plant = make(o);
    command(*plant, F);
    plant->advance(o.step_s);
    // a rod hinged at its end and pushed across answers with a quarter of its mass
    EXPECT_NEAR(truth(*plant)[2] / (o.step_s * F / (M + m / 4)), 1, first_step_tolerance);
  }
}

TEST(Motion, ForceOnTheCartWhilePoleIsHorizontal) {
  const double M = 1.0, m = 0.1, F = 2.0;
  PlantOptions o = cart_pole();
  o.parameters["gravity_m_s2"] = 0;
  o.initial_state["angle_rad"] = pi / 2;
  auto plant = make(o);
  command(*plant, F);
  plant->advance(o.step_s);
  // pushed along its length the rod answers with all of it
  EXPECT_NEAR(truth(*plant)[2] / (o.step_s * F / (M + m)), 1, first_step_tolerance);
}

TEST(Motion, MomentumAlongTheRailIsForceTimesTime) {
  const double M = 1.0, m = 0.1, l = 0.5, F = 4.0;
  PlantOptions o = cart_pole();
  o.initial_state["angle_rad"] = 2.5;
  auto plant = make(o);
  command(*plant, F);
  plant->advance(1.5);
  const auto x = truth(*plant);
  const double momentum = (M + m) * x[2] + m * l * std::cos(x[1]) * x[3];
  // second order: m l rate (rate h)^2 / 12 = 0.1 * 0.5 * 7 * 1e-6 = 4e-7 Ns at the 7 rad/s that it reaches
  EXPECT_NEAR(momentum, F * 1.5, 2e-6);
}

TEST(Motion, TurnsAreCounted) {
  PlantOptions o = pendulum();
  o.parameters["gravity_m_s2"] = 0;
  o.initial_state["rate_rad_s"] = -30;
  auto plant = make(o);
  plant->advance(2.0);
  EXPECT_NEAR(truth(*plant)[0], -60, 1e-6);  // free rotation: 9.5 turns at a constant rate
  PlantOptions far = pendulum();
  far.initial_state["angle_rad"] = 20.0;  // a start beyond one turn is kept as it is
  EXPECT_DOUBLE_EQ(truth(*make(far))[0], 20.0);
}

}  // namespace
}  // namespace tiller::sim
