#include <cmath>
#include <limits>

#include "plants.hpp"

// A free body with two rotors: closed formulas, since nothing couples but the tilt of the thrust.

namespace tiller::sim {
namespace {

constexpr double g = 9.81;
constexpr double mass = 0.5, arm = 0.2, inertia = 0.008;  // the plant's own defaults

PlantOptions quadrotor() {
  PlantOptions o;
  o.kind = "planar_quadrotor";
  o.watchdog_timeout_s = 0;
  return o;
}

void thrust(Plant& plant, double left_N, double right_N) {
  const double both[] = {left_N, right_N};
  plant.apply(both);
}

TEST(PlanarQuadrotor, FallsAndFlies) {
  PlantOptions o = quadrotor();
  auto falling = make(o);
  falling->advance(1.0);
  EXPECT_NEAR(truth(*falling)[1], -g / 2, 1e-9);  // a parabola, which second-order steps follow exactly
  EXPECT_NEAR(truth(*falling)[4], -g, 1e-9);
  auto hovering = make(o);
  thrust(*hovering, mass * g / 2, mass * g / 2);
  hovering->advance(5.0);
  for (const double value : truth(*hovering)) EXPECT_NEAR(value, 0, 1e-9);
}

// The rates after the first step are the accelerations times the step, to rounding.
TEST(PlanarQuadrotor, ThrustPushesAlongTheBody) {
  for (const double tilt : {0.0, 0.4, -1.2, 2.8}) {
    PlantOptions o = quadrotor();
    o.initial_state["tilt_rad"] = tilt;
    auto plant = make(o);
    thrust(*plant, 1.0, 3.0);
    plant->advance(o.step_s);
    const auto x = truth(*plant);
    EXPECT_NEAR(x[3], o.step_s * -4.0 * std::sin(tilt) / mass, 1e-12);
    EXPECT_NEAR(x[4], o.step_s * (4.0 * std::cos(tilt) / mass - g), 1e-12);
    EXPECT_NEAR(x[5], o.step_s * arm * 2.0 / inertia, 1e-12);  // the right rotor lifts the right side
  }
}

TEST(PlanarQuadrotor, DragDecaysAsAnExponential) {
  PlantOptions o = quadrotor();
  o.parameters = {{"drag_Ns_m", 0.3}, {"gravity_m_s2", 0.0}};
  o.initial_state = {{"x_m_s", 2.0}, {"z_m_s", -1.0}};
  auto plant = make(o);
  plant->advance(2.0);
  const double share = std::exp(-0.3 / mass * 2.0);
  // drag at the rate carried forward to the middle of the step: off by (c / m)^3 h^2 t / 2 = 5e-8 of itself, and by the
  // first step, which has no last one, (c h / m)^2 / 2 = 5e-8
  EXPECT_NEAR(truth(*plant)[3], 2.0 * share, 2.0 * share * 2e-7);
  EXPECT_NEAR(truth(*plant)[4], -share, share * 2e-7);
}

TEST(PlanarQuadrotor, KeepsItsEnergyWhileNothingPushes) {
  PlantOptions o = quadrotor();
  o.initial_state = {{"x_m_s", 3.0}, {"z_m_s", 6.0}, {"tilt_rad_s", 9.0}};
  auto plant = make(o);
  const double start = plant->energy_J();
  plant->advance(1.0);
  EXPECT_NEAR(plant->energy_J(), start, 1e-6);  // of 20 J
  EXPECT_NEAR(truth(*plant)[2], 9.0, 1e-6);     // and turns at its rate, beyond half a turn
  plant->advance(1.0);
  EXPECT_NEAR(truth(*plant)[2], 18.0, 1e-6);
}

TEST(PlanarQuadrotor, EachRotorHasItsOwnLine) {
  PlantOptions o = quadrotor();
  o.effects = {{"actuator_lag", "right_N", {{"time_constant_s", 0.1}}}};
  auto plant = make(o);
  thrust(*plant, 2.0, 2.0);
  plant->advance(0.1);
  double made[2];
  plant->motor(made);
  EXPECT_EQ(made[0], 2.0);
  EXPECT_NEAR(made[1], 2.0 * (1 - std::exp(-1.0)), 0.01);  // the mean over the last step
  EXPECT_LT(truth(*plant)[2], 0) << "the left side rises";
  // half a bad command is a bad command
  thrust(*plant, std::numeric_limits<double>::quiet_NaN(), 3.0);
  plant->advance(0.01);
  plant->motor(made);
  EXPECT_EQ(made[0], 2.0);
  EXPECT_EQ(plant->dropped_commands(), 1u);
}

TEST(PlanarQuadrotor, DryFrictionHoldsEveryAxis) {
  PlantOptions o = quadrotor();
  o.initial_state = {{"tilt_rad", 0.3}};
  o.effects = {{"coulomb_friction", "x", {{"friction_SI", 20.0}}},
               {"coulomb_friction", "z", {{"friction_SI", 20.0}}},
               {"coulomb_friction", "tilt", {{"friction_SI", 20.0}}}};
  auto plant = make(o);
  thrust(*plant, 1.0, 4.0);
  plant->advance(1.0);
  EXPECT_NEAR(truth(*plant)[0], 0, 1e-9);
  EXPECT_NEAR(truth(*plant)[1], 0, 1e-9);
  EXPECT_NEAR(truth(*plant)[2], 0.3, 1e-9);
}

}  // namespace
}  // namespace tiller::sim
