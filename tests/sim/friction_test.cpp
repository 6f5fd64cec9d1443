#include <cmath>

#include "plants.hpp"

namespace tiller::sim {
namespace {

TEST(DryFriction, HoldsTheCartBelowItsForceAndLetsGoAbove) {
  PlantOptions o = cart_pole();
  o.effects = {{"coulomb_friction", "", {{"friction_SI", 2.0}}}};
  auto held = make(o);
  command(*held, 1.99);
  held->advance(5.0);
  // sticking is a constraint: what is left is rounding, not a slow creep (a tanh of slope 0.01 m/s would
  // have gone 0.1 m)
  EXPECT_LT(std::fabs(truth(*held)[0]), 1e-9);
  EXPECT_LT(std::fabs(truth(*held)[2]), 1e-9);
  auto moving = make(o);
  command(*moving, 2.5);
  moving->advance(1.0);
  // 0.5 N are left for 1.1 kg; the swinging rod moves the cart by some centimetres about that mean
  EXPECT_NEAR(truth(*moving)[0], 0.5 * 0.5 / 1.1, 0.05);
}

TEST(DryFriction, StopsATurningJointInFiniteTime) {
  const double inertia = 0.5 * 0.5 * 0.5, torque = 0.25, rate = 4.0;
  PlantOptions o = pendulum();
  o.parameters["gravity_m_s2"] = 0;
  o.initial_state["rate_rad_s"] = rate;
  o.effects = {{"coulomb_friction", "joint", {{"friction_SI", torque}}}};
  auto plant = make(o);
  const double stop_s = rate * inertia / torque;  // 2 s
  plant->advance(stop_s / 2);
  // a constant deceleration, which steps integrate to rounding but for the turn of the arm within a step
  EXPECT_NEAR(truth(*plant)[1], rate / 2, 1e-2);
  plant->advance(stop_s / 2 + 0.05);
  const double rest_rad = truth(*plant)[0];
  plant->advance(3.0);
  EXPECT_LT(std::fabs(truth(*plant)[1]), 1e-9);
  EXPECT_NEAR(truth(*plant)[0], rest_rad, 1e-9);
  EXPECT_NEAR(rest_rad, rate * stop_s / 2, 1e-2);
}

TEST(DryFriction, PendulumRestsAwayFromTheBottom) {
  PlantOptions o = pendulum();
  // m g l sin(0.3) = 0.725 Nm
  o.initial_state["angle_rad"] = 0.3;
  o.effects = {{"coulomb_friction", "joint", {{"friction_SI", 0.75}}}};
  auto plant = make(o);
  plant->advance(5.0);
  EXPECT_NEAR(truth(*plant)[0], 0.3, 1e-9);
  o.effects[0].parameters["friction_SI"] = 0.70;
  auto slides = make(o);
  slides->advance(5.0);
  EXPECT_LT(truth(*slides)[0], 0.29);
}

TEST(ViscousFriction, DecaysAsAnExponential) {
  const double inertia = 0.5 * 0.5 * 0.5, coefficient = 0.1, rate = 3.0;
  for (const bool hidden : {false, true}) {  // the plant's own parameter and the hidden effect are one physics
    PlantOptions o = pendulum();
    o.parameters["gravity_m_s2"] = 0;
    o.initial_state["rate_rad_s"] = rate;
    if (hidden) {
      o.effects = {{"viscous_friction", "", {{"damping_SI", coefficient}}}};
    } else {
      o.parameters["damping_Nms"] = coefficient;
    }
    auto plant = make(o);
    plant->advance(2.0);
    const double k = coefficient / inertia, expected = rate * std::exp(-k * 2.0);
    // explicit steps decay as (1 - k h)^n: too fast by k^2 h t / 2 = 0.8^2 * 0.0005 * 2 / 2 = 3.2e-4 of it;
    // the turning of the arm within a step adds a like amount
    EXPECT_NEAR(truth(*plant)[1] / expected, 1, 2e-3);
  }
}

TEST(ViscousFriction, ActsOnThePoleHingeWhenAsked) {
  PlantOptions o = cart_pole();
  o.initial_state["angle_rad"] = 3.141592653589793 + 0.3;
  o.effects = {{"viscous_friction", "pole", {{"damping_SI", 0.02}}}};
  auto plant = make(o);
  const double start = plant->energy_J();
  double before = start;
  for (int i = 0; i < 20; ++i) {
    plant->advance(0.5);
    // 1e-4 J is the swing of the integrator's energy error (energy_test.cpp)
    EXPECT_LT(plant->energy_J(), before + 1e-4);
    before = plant->energy_J();
  }
  EXPECT_NEAR(before, -0.1 * 9.81 * 0.5, 1e-3);  // hangs still
}

TEST(ViscousFriction, TooStiffForTheStepIsRefused) {
  PlantOptions o = cart_pole();
  o.effects = {{"viscous_friction", "cart", {{"damping_SI", 500}}}};
  std::string error;
  EXPECT_EQ(Plant::make(o, error), nullptr);  // 500 * 0.0005 / 1 kg = 0.25 > 0.2
  EXPECT_NE(error.find("cart"), std::string::npos) << error;
  EXPECT_NE(error.find("step_s"), std::string::npos) << error;
  o.step_s = 0.0001;
  EXPECT_NE(Plant::make(o, error), nullptr) << error;
}

}  // namespace
}  // namespace tiller::sim
